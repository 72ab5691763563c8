"""PLY written: binary little-endian or ascii, whole or run after run."""

from __future__ import annotations

import re
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from surfel.io.columns import COLORS, NORMALS, POINTS, RADIUS, flat_columns
from surfel.io.content import Content, Head

_BLOCK = 1 << 18  # bytes: a block stays in the cache
_NAMES = {
    "i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint", "f4": "float",
    "f8": "double",
}  # fmt: skip
_COUNT_WIDTH = 18

Column = tuple[str, str, NDArray[Any]]
"""The name of a property, its type, and its values."""


def save(stream: BinaryIO, content: Content, *, ascii: bool = False, suffix: str = "") -> list[str]:
    """Write a PLY file, little-endian or ascii; coordinates in double precision, other values in their own type.

    Returns
    -------
    list of str
        What could not be kept.
    """
    lost: list[str] = []
    columns = _columns(content, lost)
    stream.write(_header(columns, f"{len(content.points)}", content, ascii))
    _write_rows(stream, columns, ascii)
    if content.triangles is not None:
        count = np.broadcast_to(np.uint8(3), len(content.triangles))
        corners = [(name, "<i4", content.triangles[:, i]) for i, name in enumerate("abc")]
        _write_rows(stream, [("n", "|u1", count), *corners], ascii)
    return lost


def writer(stream: BinaryIO, first: Content, head: Head, *, suffix: str) -> Writer | None:
    """Return a writer of runs; none where the type of a column depends on all its values."""
    if any(values.dtype.kind in "iu" and values.dtype.itemsize == 8 for values in first.attributes.values()):
        return None
    if first.colors is not None and first.colors.dtype.kind in "iu" and first.colors.dtype.itemsize == 8:
        return None
    return Writer(stream, first)


class Writer:
    """Takes run after run; the count goes into the header at the end."""

    def __init__(self, stream: BinaryIO, first: Content) -> None:
        self.lost: list[str] = []
        self._stream = stream
        self._count = 0
        header = _header(_columns(first, self.lost), "?" * _COUNT_WIDTH, first, False)
        self._place = header.index(b"?" * _COUNT_WIDTH)
        stream.write(header)

    def add(self, run: Content) -> None:
        """Write one run."""
        self._count += len(run.points)
        _write_rows(self._stream, _columns(run, []), False)

    def close(self) -> None:
        """Write the count; zeros before a number are read by everybody, blanks behind it are not."""
        self._stream.seek(self._place)
        self._stream.write(str(self._count).rjust(_COUNT_WIDTH, "0").encode())
        self._stream.seek(0, 2)


def _header(columns: list[Column], count: str, content: Content, ascii: bool) -> bytes:
    lines = ["ply", f"format {'ascii' if ascii else 'binary_little_endian'} 1.0", "comment written by surfel"]
    lines.append(f"element vertex {count}")
    lines += [f"property {_NAMES[kind[1:]]} {name}" for name, kind, _ in columns]
    if content.triangles is not None:
        lines += [f"element face {len(content.triangles)}", "property list uchar int vertex_indices"]
    return ("\n".join([*lines, "end_header"]) + "\n").encode()


def _write_rows(stream: BinaryIO, columns: list[Column], ascii: bool) -> None:
    """Write the columns row by row, a block at a time."""
    record = np.dtype([(name, kind) for name, kind, _ in columns])
    count = len(columns[0][2])
    step = max(1, _BLOCK // record.itemsize)
    block = np.empty(min(step, count), record)
    for first in range(0, count, step):
        rows = block[: min(step, count - first)]
        for name, _, values in columns:
            rows[name] = values[first : first + step]
        if ascii:
            words = [map(repr, rows[name].tolist()) for name, _, _ in columns]
            stream.write(("\n".join(map(" ".join, zip(*words, strict=True))) + "\n").encode())
        else:
            stream.write(rows.view(np.uint8).data)


def _columns(content: Content, lost: list[str]) -> list[Column]:
    """Return name, type and values of each property to be written; say what has no type in PLY."""
    columns: list[Column] = [(n, "<f8", content.points[:, i]) for i, n in enumerate(POINTS[0])]
    if content.normals is not None:
        columns += [(n, "<f8", content.normals[:, i]) for i, n in enumerate(NORMALS[0])]
    if content.radii is not None:
        columns.append((RADIUS, "<f8", content.radii))
    if content.colors is not None:
        for i, name in enumerate([*COLORS[0], "alpha"][: content.colors.shape[1]]):
            _add_column(columns, name, content.colors[:, i], lost)
    for name, values in content.attributes.items():
        flat = flat_columns(values)
        for i in range(flat.shape[1]):
            _add_column(columns, name if values.ndim == 1 else f"{name}_{i}", flat[:, i], lost)
    return columns


def _add_column(columns: list[Column], name: str, values: NDArray[Any], lost: list[str]) -> None:
    kind = _kind(values)
    word = re.sub(r"\s+", "_", name.strip()) or "unnamed"
    taken = {n for n, _, _ in columns}
    while word in taken:
        word += "_"
    if kind is None:
        lost.append(f"attribute {name!r} of type {values.dtype}")
        return
    if word != name:
        lost.append(f"the name {name!r} (written as {word!r})")
    columns.append((word, kind, values))


def _kind(values: NDArray[Any]) -> str | None:
    """Return the PLY type that holds the values without loss, or None."""
    kind = values.dtype.kind
    if kind == "b":
        return "|u1"
    if kind == "f" and values.dtype.itemsize <= 8:
        return "<f4" if values.dtype.itemsize <= 4 else "<f8"
    if kind not in "iu":
        return None
    if values.dtype.itemsize < 8:
        return f"<{values.dtype.kind}{values.dtype.itemsize}"
    low, high = (int(values.min()), int(values.max())) if len(values) else (0, 0)
    for choice in ("i4", "u4"):
        if np.iinfo(choice).min <= low and high <= np.iinfo(choice).max:
            return f"<{choice}"
    return "<f8" if low >= -(2**53) and high <= 2**53 else None
