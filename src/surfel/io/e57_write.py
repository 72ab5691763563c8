"""Writing an E57 file: one scan, its values in streams of whole bytes."""

from __future__ import annotations

import hashlib
import re
import struct
from typing import Any, BinaryIO
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from surfel.core.box import corners
from surfel.io.columns import flat_columns
from surfel.io.content import Content
from surfel.io.e57_pages import DATA, HEADER, MAGIC, PAGE, paged
from surfel.io.e57_tree import OWN, OWN_SPACE, SPACE

_NORMALS_SPACE = "http://www.libe57.org/E57_NOR_surface_normals.txt"
_PACKET = 60_000
_STANDARD = {
    "intensity": "intensity", "row_index": "rowIndex", "column_index": "columnIndex", "return_index": "returnIndex",
    "return_count": "returnCount", "time_stamp": "timeStamp",
}  # fmt: skip
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")


def written(stream: BinaryIO, content: Content) -> list[str]:
    """Write a content as one scan and return what could not be kept."""
    lost = content.lost_without("normals", "colors", "radii", "attributes")
    columns = _columns(content, lost)
    section, points_at = _section(columns, len(content.points)), HEADER
    xml = _description(content, columns, points_at).encode()
    body = section + b"\0" * (-len(section) % 4)
    xml_at = HEADER + len(body)
    size = -(-(xml_at + len(xml)) // DATA) * PAGE
    head = struct.pack("<8s2I4Q", MAGIC, 1, 0, size, _physical(xml_at), len(xml), PAGE)
    stream.write(paged(head + body + xml))
    return lost


def _columns(content: Content, lost: list[str]) -> list[tuple[str, NDArray[Any]]]:
    """Return the values of a point by their names in the file."""
    columns: list[tuple[str, NDArray[Any]]] = [
        (f"cartesian{axis}", content.points[:, i].astype(np.float64)) for i, axis in enumerate("XYZ")
    ]
    if content.normals is not None:
        columns += [(f"nor:normal{axis}", content.normals[:, i]) for i, axis in enumerate("XYZ")]
    colors = content.colors
    if colors is not None:
        if colors.shape[1] == 4:
            lost.append("alpha of the colors")
        columns += [(f"color{name}", colors[:, i]) for i, name in enumerate(("Red", "Green", "Blue"))]
    rest: dict[str, NDArray[Any]] = dict(content.attributes)
    if content.radii is not None:
        rest = {"radius": content.radii, **rest}
    names = {name for name, _ in columns}
    for name, values in rest.items():
        kind, flat = values.dtype, flat_columns(values)
        if kind.kind not in "fiub" or kind.itemsize > 8 or (kind == np.uint64 and flat.size and flat.max() >= 1 << 63):
            lost.append(f"attribute {name!r} of type {kind}")
            continue
        for i in range(flat.shape[1]):
            own = name if values.ndim == 1 else f"{name}_{i}"
            written_as = _STANDARD.get(own, OWN + own)
            if not _NAME.fullmatch(own) or written_as in names:
                lost.append(f"attribute {own!r}, a name that E57 cannot hold")
                continue
            names.add(written_as)
            columns.append((written_as, flat[:, i]))
    return [(name, _plain(values)) for name, values in columns]


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    """Return values of a type that takes whole bytes."""
    kind = values.dtype
    if kind.kind == "b":
        return values.astype("u1")
    if kind == np.float16:
        return values.astype("<f4")
    if kind == np.uint64:
        return values.astype("<i8")
    return np.ascontiguousarray(values, kind.newbyteorder("<"))


def _bits(values: NDArray[Any]) -> bytes:
    """Return values as they are stored: whole numbers less the least of their type."""
    if values.dtype.kind != "i":
        return values.tobytes()
    raw: NDArray[Any] = values.view(values.dtype.str.replace("i", "u"))
    raw = raw ^ raw.dtype.type(1 << (8 * raw.dtype.itemsize - 1))
    return raw.tobytes()


def _section(columns: list[tuple[str, NDArray[Any]]], count: int) -> bytes:
    """Return the section of the points: its header, an index of one packet, and the packets."""
    row = sum(values.dtype.itemsize for _, values in columns)
    step = max(1, (_PACKET - 6 - 2 * len(columns)) // row)
    packets = []
    for first in range(0, count, step):
        streams = [_bits(values[first : first + step]) for _, values in columns]
        body = struct.pack(f"<H{len(streams)}H", len(streams), *map(len, streams)) + b"".join(streams)
        size = -(-(4 + len(body)) // 4) * 4
        packets.append(struct.pack("<BBH", 1, 0, size - 1) + body.ljust(size - 4, b"\0"))
    data = b"".join(packets)
    place = HEADER + 32
    index_at = place + len(data)
    index = struct.pack("<BBHHB9xQQ", 0, 0, 31, 1, 0, 0, _physical(place))
    head = struct.pack("<B7x3Q", 1, 32 + len(data) + len(index), _physical(place), _physical(index_at))
    return head + data + index


def _description(content: Content, columns: list[tuple[str, NDArray[Any]]], place: int) -> str:
    digest = hashlib.blake2b(content.points.tobytes(), digest_size=16).hexdigest()
    guids = [f"{{{d[:8]}-{d[8:12]}-{d[12:16]}-{d[16:20]}-{d[20:]}}}" for d in (digest, digest[::-1])]
    crs = content.frame.crs if content.frame is not None else ""
    fields = "\n".join(_field(name, values) for name, values in columns)
    bounds = ""
    if len(content.points):
        low, high = corners(content.points).tolist()
        bounds = "".join(
            f'<{axis}Minimum type="Float">{a!r}</{axis}Minimum><{axis}Maximum type="Float">{b!r}</{axis}Maximum>'
            for axis, a, b in zip("xyz", low, high, strict=True)
        )
        bounds = f'<cartesianBounds type="Structure">{bounds}</cartesianBounds>'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<e57Root type="Structure" xmlns="{SPACE}" xmlns:nor="{_NORMALS_SPACE}" xmlns:s="{OWN_SPACE}">
<formatName type="String">ASTM E57 3D Imaging Data File</formatName>
<guid type="String">{guids[0]}</guid>
<versionMajor type="Integer">1</versionMajor>
<versionMinor type="Integer">0</versionMinor>
<coordinateMetadata type="String">{escape(_allowed(crs))}</coordinateMetadata>
<data3D type="Vector" allowHeterogeneousChildren="1">
<vectorChild type="Structure">
<guid type="String">{guids[1]}</guid>
<name type="String">surfel</name>
{bounds}{_limits(content, columns)}
<points type="CompressedVector" fileOffset="{place}" recordCount="{len(content.points)}">
<prototype type="Structure">
{fields}
</prototype>
<codecs type="Vector" allowHeterogeneousChildren="1"></codecs>
</points>
</vectorChild>
</data3D>
<images2D type="Vector" allowHeterogeneousChildren="1"></images2D>
</e57Root>
"""


def _field(name: str, values: NDArray[Any]) -> str:
    if values.dtype.kind == "f":
        return f'<{name} type="Float" precision="{"single" if values.dtype.itemsize == 4 else "double"}"/>'
    limits = np.iinfo(values.dtype)
    return f'<{name} type="Integer" minimum="{limits.min}" maximum="{limits.max}">{max(0, limits.min)}</{name}>'


def _limits(content: Content, columns: list[tuple[str, NDArray[Any]]]) -> str:
    """Return what white and the strongest intensity are, for programs that show them."""
    text = ""
    if content.colors is not None:
        integers = content.colors.dtype.kind in "iu"
        kind, top = ("Integer", str(np.iinfo(content.colors.dtype).max)) if integers else ("Float", "1")
        text += '<colorLimits type="Structure">' + "".join(
            f'<color{c}Minimum type="{kind}">0</color{c}Minimum><color{c}Maximum type="{kind}">{top}</color{c}Maximum>'
            for c in ("Red", "Green", "Blue")
        ) + "</colorLimits>"  # fmt: skip
    values = dict(columns).get("intensity")
    if values is not None and len(values) and np.isfinite(values).all():
        kind = "Float" if values.dtype.kind == "f" else "Integer"
        low, high = values.min().item(), values.max().item()
        text += (
            f'<intensityLimits type="Structure"><intensityMinimum type="{kind}">{low}</intensityMinimum>'
            f'<intensityMaximum type="{kind}">{high}</intensityMaximum></intensityLimits>'
        )
    return text


def _allowed(text: str) -> str:
    """Return text without the characters that XML does not have."""
    return re.sub(r"[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "", text)


def _physical(logical: int) -> int:
    return logical // DATA * PAGE + logical % DATA
