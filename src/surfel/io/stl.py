"""STL, binary and text: triangles without shared vertices; equal corners become one vertex."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from surfel.core.cast import Floats, Integers
from surfel.io.content import Content
from surfel.io.rows import RowError, line_of, parse_rows
from surfel.io.source import Source

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", 9), ("extra", "<u2")])
_HEAD = 84
_CHUNK = 1 << 15
_CURE = "the file was cut or changed; fetch it again"
_WORDS = {0: b"facet", 1: b"normal", 5: b"outer", 6: b"loop", 7: b"vertex", 11: b"vertex", 15: b"vertex",
          19: b"endloop", 20: b"endfacet"}  # fmt: skip
_CORNERS = (8, 9, 10, 12, 13, 14, 16, 17, 18)


def load(source: Source) -> Content:
    """Read an STL file. Corners with the same coordinates become one vertex, so that the mesh closes again.

    A file whose size is what the count at byte 80 asks for is binary, whatever its first word; otherwise it is text if
    it begins with ``solid``.

    Raises
    ------
    FileFormatError
        If the size does not fit the count, or the text is not made of whole facets.
    """
    head = source.head(_HEAD)
    count = int.from_bytes(head[80:84], "little") if len(head) == _HEAD else -1
    if count >= 0 and source.size == _HEAD + count * _FACET.itemsize:
        corners = _binary(source, count)
    elif head.lstrip().lower().startswith(b"solid") and b"\0" not in source.head(4096):
        corners = _text(source)
    elif count < 0:
        raise source.error(
            f"it has {source.size} bytes, fewer than the {_HEAD} of a header", f"byte {source.size}", _CURE
        )
    else:
        raise source.error(
            f"its header announces {count} triangles in {_HEAD + count * _FACET.itemsize} bytes; it has {source.size}",
            f"byte {source.size}, triangle {max(0, source.size - _HEAD) // _FACET.itemsize}", _CURE,
        )  # fmt: skip
    points, triangles = _shared(corners)
    content = Content(points, triangles)
    content.notes.append(f"the {len(corners)} corners have {len(points)} different places, taken as vertices")
    return content


def save(stream: BinaryIO, content: Content, *, ascii: bool = False, suffix: str = ".stl") -> list[str]:
    """Write binary STL in single precision (all that binary STL has), or text in double precision.

    Raises
    ------
    InputError
        If a coordinate is too large for single precision.
    """
    triangles = content.triangles if content.triangles is not None else np.empty((0, 3), np.int64)
    lost = content.lost_without("triangles")
    if ascii:
        stream.write(b"solid surfel\n")
    else:
        content.in_single_precision("binary STL", lost)
        stream.write(b"surfel".ljust(80) + len(triangles).to_bytes(4, "little"))
    for first in range(0, len(triangles), _CHUNK):
        corners = content.points[triangles[first : first + _CHUNK]]
        normals = _normals(corners)
        if ascii:
            stream.write("".join(map(_facet, normals.tolist(), corners.tolist())).encode())
        else:
            block = np.zeros(len(corners), _FACET)
            block["normal"] = normals
            block["corners"] = corners.reshape(-1, 9)
            stream.write(block.view(np.uint8).data)
    if ascii:
        stream.write(b"endsolid surfel\n")
    return lost


def _binary(source: Source, count: int) -> Floats:
    source.stream.seek(_HEAD)
    facets = source.take(count * _FACET.itemsize).view(_FACET)
    return facets["corners"].reshape(-1, 3).astype(np.float64)


def _text(source: Source) -> Floats:
    """Read all solids of a text file."""
    data = source.rest()
    corners: list[Floats] = []
    lines = data.tobytes().replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
    words: list[bytes] = []
    inside = False
    for number, line in enumerate(lines, start=1):
        parts = line.lower().split()
        if not parts:
            continue
        if parts[0] == b"solid" and not inside:
            inside = True
        elif parts[0] == b"endsolid" and inside:
            inside = False
        elif inside:
            words += parts
        else:
            raise source.error(
                f"{line[:40].decode('ascii', 'backslashreplace')!r} stands outside a solid", f"line {number}", _CURE
            )
    if inside:
        raise source.error("it ends without 'endsolid'", f"line {len(lines)}", _CURE)
    whole, left = divmod(len(words), 21)
    for at, word in _WORDS.items():
        found = words[at::21]
        wrong = next((i for i, w in enumerate(found) if w != word), None)
        if wrong is not None:
            shown = found[wrong][:20].decode("ascii", "backslashreplace")
            raise source.error(f"{shown!r} stands where {word.decode()!r} should", f"facet {wrong}", _CURE)
    if left:
        raise source.error(f"the last facet has {left} of 21 words", f"facet {whole}", _CURE)
    table = b"\n".join(b" ".join(words[i + j] for j in (2, 3, 4, *_CORNERS)) for i in range(0, len(words), 21))
    text = np.frombuffer(table, np.uint8)
    try:
        corners.append(parse_rows(text, 0, (0,) * 12, rows=whole).values[:, 3:].reshape(-1, 3))
    except RowError as error:
        raise source.error(error.problem, f"facet {line_of(text, error.position) - 1}", _CURE) from None
    return np.concatenate(corners)


def _shared(corners: Floats) -> tuple[Floats, Integers]:
    """Return the different corners, in the order of their first use, and the triangles between them."""
    if len(corners) == 0:
        return corners, np.empty((0, 3), np.int64)
    keys = (corners + 0.0).view(np.dtype((np.void, 24)))[:, 0]  # + 0.0: minus zero is the same place
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return corners[np.sort(first)], rank[inverse].reshape(-1, 3)


def _normals(corners: Floats) -> Floats:
    """Return the unit normals of triangles, zero where they have no area."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    size = np.maximum(np.abs(a).max(axis=1), np.abs(b).max(axis=1))[:, None]
    size[~(size > 0)] = 1.0
    normals = np.cross(a / size, b / size)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit: Floats = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    return unit


def _facet(normal: list[float], corners: list[list[float]]) -> str:
    vertices = "".join("   vertex {!r} {!r} {!r}\n".format(*c) for c in corners)
    return "facet normal {!r} {!r} {!r}\n  outer loop\n{}  endloop\nendfacet\n".format(*normal, vertices)
