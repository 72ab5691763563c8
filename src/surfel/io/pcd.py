"""PCD: ascii, binary and compressed; organised clouds, any fields, packed colors, the viewpoint."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.io.columns import COLORS, NORMALS, POINTS, RADIUS, as_type, content_by_name, first_of
from surfel.io.content import Content, Frame, Head
from surfel.io.parts import in_parts
from surfel.io.pcd_header import PADDING, PcdHeader, read_header
from surfel.io.pcd_write import save, writer
from surfel.io.source import Bytes, Source

__all__ = ["chunks", "head", "load", "save", "writer"]

_PACKED = {"rgb": 3, "rgba": 4}
_BLOCK = 1 << 18
_PAGE = 4096
_CUT = "the file was cut or its header is wrong; fetch it again"

Columns = dict[str, NDArray[Any]]


def load(source: Source) -> Content:
    """Read a PCD file. Of an organised cloud the points come row by row; what is not finite is in their place.

    ``rgb`` and ``rgba`` are unpacked to colors of bytes; the viewpoint is kept in the frame.

    Raises
    ------
    FileFormatError
        If the file is cut, its header does not fit its body, or what is compressed is damaged.
    """
    header = read_header(source)
    if header.data == "binary_compressed":
        return _content(_unpacked(source, header), header)
    content = next(_runs(source, header, max(1, header.points)))
    _finish(source, header)
    return content


def chunks(source: Source, size: int) -> Iterator[Content] | None:
    """Yield the points in runs; a compressed file, which holds one field after the other, is not read so.

    Raises
    ------
    FileFormatError
        As :func:`load` does, once the damage is reached.
    """
    header = read_header(source)
    return None if header.data == "binary_compressed" else _checked_runs(source, header, size)


def head(source: Source) -> Head:
    """Tell what the header says, compared with the file's size."""
    header = read_header(source)
    if header.data == "binary":
        _check_room(source, header)
    elif header.data == "binary_compressed":
        _sizes(source, header)
    names = [f.name for f in header.fields if f.name != PADDING]
    normals, colors = first_of(NORMALS, names), first_of(COLORS, names)
    known = {*POINTS[0], *(normals or ()), *(colors or ()), RADIUS}
    packed = next((name for name in ("rgba", "rgb") if name in names and colors is None), None)
    attributes = [name for name in names if name not in known and name != packed]
    content = _frame(header)
    facts: dict[str, object] = {"data": header.data, "width": header.width, "height": header.height}
    return Head(
        header.points, normals is not None, None, RADIUS in names, colors is not None or packed is not None, attributes,
        frame=content, facts=facts | {"viewpoint": list(header.viewpoint)},
    )  # fmt: skip


def _checked_runs(source: Source, header: PcdHeader, size: int) -> Iterator[Content]:
    yield from _runs(source, header, size)
    _finish(source, header)


def _runs(source: Source, header: PcdHeader, size: int) -> Iterator[Content]:
    """Yield run after run, at least one."""
    if header.data == "binary":
        _check_room(source, header)
        for first in range(0, max(1, header.points), size):
            yield _content(_records(source, header, min(size, header.points - first)), header)
        return
    from surfel.io.table_rows import TableRows, Text

    source.stream.seek(header.start)
    rows = TableRows(source, sum(f.count for f in header.fields), Text(header.newline), "point")
    for first in range(0, max(1, header.points), size):
        values = rows.read(min(size, header.points - first), all_of_them=True)
        rows.finish()
        yield _content(_columns_of_table(source, header, values), header)


def _finish(source: Source, header: PcdHeader) -> None:
    """Refuse what comes after the last point.

    The library once left up to a page behind its data: of zeros, behind compressed ones of anything.
    """
    at, left = source.position, source.remaining
    if header.data == "ascii":
        more = bool(source.rest().tobytes().strip())
    else:
        more = left > _PAGE or (header.data == "binary" and bool(source.rest().tobytes().strip(b"\0")))
    if more:
        raise source.error(
            f"there are {left} bytes more than the header announces", f"byte {at}",
            "its counts are wrong or the file was changed; write it again",
        )  # fmt: skip


def _check_room(source: Source, header: PcdHeader) -> None:
    size, left = header.record.itemsize, source.size - header.start
    if not header.points * size <= left <= header.points * size + _PAGE:
        raise source.error(
            f"its header announces {header.points} points of {size} bytes, {left} bytes follow",
            f"byte {min(source.size, header.start + header.points * size)}, point {left // size}", _CUT,
        )  # fmt: skip


def _records(source: Source, header: PcdHeader, count: int) -> Columns:
    """Read points block by block into columns; of a file with a name, on several threads."""
    record = header.record
    names = [f.name for f in header.fields if f.name != PADDING]
    found: Columns = {n: np.empty((count, *record[n].shape), record[n].base) for n in names if n not in POINTS[0]}
    points = np.empty((count, 3))
    start, size = source.position, record.itemsize

    def read(first: int, last: int) -> None:
        block = np.empty((last - first) * size, np.uint8)
        if source.positional:
            source.fill_from(start + first * size, block)
        else:
            source.fill(block)
        rows = block.view(record)
        for name, values in found.items():
            values[first:last] = rows[name]
        for axis, name in enumerate(POINTS[0]):
            points[first:last, axis] = rows[name]

    step = max(1, _BLOCK // size)
    if source.positional:
        in_parts(read, count, step)
        source.stream.seek(start + count * size)
    else:
        for first in range(0, count, step):
            read(first, min(first + step, count))
    return found | {"points": points}


def _sizes(source: Source, header: PcdHeader) -> tuple[int, int]:
    """Return the packed and the unpacked size, compared with the file and with the header."""
    source.stream.seek(header.start)
    if source.remaining < 8:
        raise source.error("there is no room for the sizes", f"byte {source.size}", _CUT)
    packed, unpacked = (int(n) for n in source.take(8).view("<u4"))
    need = header.points * header.record.itemsize
    if unpacked != need:
        raise source.error(
            f"{header.points} points of {header.record.itemsize} bytes are {need}, but {unpacked} are packed",
            f"byte {header.start + 4}", _CUT,
        )  # fmt: skip
    if not packed <= source.remaining <= packed + _PAGE:
        raise source.error(
            f"{packed} packed bytes are announced, {source.remaining} follow", f"byte {source.size}", _CUT
        )
    return packed, unpacked


def _unpacked(source: Source, header: PcdHeader) -> Columns:
    """Unpack the fields, which lie one after the other."""
    from surfel.io.lzf import unpack

    packed, size = _sizes(source, header)
    at = source.position
    data = unpack(source.take(packed), size)
    if data is None:
        raise source.error(
            f"the packed data are damaged or do not make {size} bytes", f"byte {at} to {at + packed}", _CUT
        )
    _finish(source, header)
    found: Columns = {}
    place = 0
    for field in header.fields:
        length = field.type.itemsize * field.count * header.points
        if field.name != PADDING:
            values = data[place : place + length].view(field.type)
            found[field.name] = values if field.count == 1 else values.reshape(header.points, field.count)
        place += length
    points = np.stack([found.pop(name) for name in POINTS[0]], axis=1).astype(np.float64)
    return {name: values.copy() for name, values in found.items()} | {"points": points}


def _columns_of_table(source: Source, header: PcdHeader, values: Floats) -> Columns:
    found: Columns = {}
    place = 0
    for field in header.fields:
        columns = values[:, place : place + field.count]
        place += field.count
        if field.name != PADDING and field.name not in POINTS[0]:
            typed = as_type(source, "point", field.name, columns.reshape(-1), field.type, field.count)
            found[field.name] = typed if field.count == 1 else typed.reshape(-1, field.count)
    first = [sum(f.count for f in header.fields[:i]) for i in range(len(header.fields))]
    place_of = {f.name: at for f, at in zip(header.fields, first, strict=True)}
    return found | {"points": values[:, [place_of[name] for name in POINTS[0]]]}


def _content(columns: Columns, header: PcdHeader) -> Content:
    notes = []
    points = columns.pop("points")
    group = first_of(NORMALS, columns)
    normals = None
    if group is not None and all(columns[n].ndim == 1 for n in group):
        normals = np.stack([columns.pop(name) for name in group], axis=1).astype(np.float64)
    native = {name: values.astype(values.dtype.newbyteorder("="), copy=False) for name, values in columns.items()}
    colors = None
    if first_of(COLORS, native) is None:
        for name in ("rgba", "rgb"):
            if name in native and native[name].ndim == 1 and native[name].dtype.itemsize == 4:
                colors = _unpacked_colors(native.pop(name), _PACKED[name])
                break
    if header.height > 1:
        notes.append(f"an organised cloud of {header.width} x {header.height} points")
    content = content_by_name(native, np.ascontiguousarray(points), normals, notes)
    if colors is not None:
        content.colors = colors
    content.frame = _frame(header)
    return content


def _unpacked_colors(packed: NDArray[Any], channels: int) -> NDArray[np.uint8]:
    """Return red, green, blue and alpha of words that hold them as bytes, blue the lowest."""
    octets: Bytes = np.ascontiguousarray(packed).view(np.uint8).reshape(-1, 4)
    return np.ascontiguousarray(octets[:, [2, 1, 0, 3][:channels]])


def _frame(header: PcdHeader) -> Frame:
    return Frame(extra={"pcd": {"viewpoint": header.viewpoint, "width": header.width, "height": header.height}})
