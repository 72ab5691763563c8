"""NPY: one array of points, of points and more columns, or of named fields. Nothing is ever unpickled."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from surfel.core.errors import FileFormatError
from surfel.io.columns import NORMALS, POINTS, content_by_name, content_of_table, depends_on_values, first_of
from surfel.io.content import Content
from surfel.io.source import Source

_CUT = "the file was cut or changed; write it again"
_LONGEST_HEADER = 100_000
_AT_ONCE = 1 << 24


def load(source: Source) -> Content:
    """Read an array of shape (n, k) with k >= 3, or of n records with fields x, y and z (or a field ``points``).

    Columns go by :func:`surfel.io.columns.content_of_table`.

    Raises
    ------
    FileFormatError
        If its header does not fit its size, or it is no such array.
    """
    array = read_array(source, source.stream, source.remaining, "the array")
    return content_of_array(source, array)


def chunks(source: Source, size: int) -> Iterator[Content] | None:
    """Yield the points in runs; an array in Fortran's order, whose rows lie apart, is not read so.

    Raises
    ------
    FileFormatError
        As :func:`load` does.
    """
    shape, fortran, dtype = _read_header(source, source.stream, source.remaining, "the array")
    if (fortran and len(shape) > 1) or len(shape) != (2 if dtype.names is None else 1):
        return None
    if dtype.names is None and depends_on_values(None, shape[1]):
        return None
    return _runs(source, shape, dtype, size)


def _runs(source: Source, shape: tuple[int, ...], dtype: np.dtype[Any], size: int) -> Iterator[Content]:
    record = dtype.itemsize * math.prod(shape[1:])
    for first in range(0, max(1, shape[0]), size):
        rows = min(size, shape[0] - first)
        yield content_of_array(source, source.take(rows * record).view(dtype).reshape(rows, *shape[1:]))


def save(stream: BinaryIO, content: Content, *, ascii: bool = False, suffix: str = ".npy") -> list[str]:
    """Write (n, 3) points, or (n, 6) points and normals, in double precision."""
    table = content.points if content.normals is None else np.concatenate([content.points, content.normals], axis=1)
    npy_format.write_array(stream, np.ascontiguousarray(table), allow_pickle=False)
    return content.lost_without("normals")


def read_array(source: Source, stream: Any, size: int, what: str) -> NDArray[Any]:
    """Read one array from a stream of ``size`` bytes; its header has to fit the size exactly.

    Raises
    ------
    FileFormatError
        If it does not, or if the array holds Python objects.
    """
    shape, fortran, dtype = _read_header(source, stream, size, what)
    array = _taken(source, stream, math.prod(shape) * dtype.itemsize, what).view(dtype)
    try:
        return array.reshape(shape, order="F" if fortran else "C")
    except ValueError as error:  # more dimensions than numpy takes
        raise source.error(f"{what} has an impossible shape: {error}", "its header", _CUT) from error


def _read_header(source: Source, stream: Any, size: int, what: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, order and type, which need exactly as many bytes as there are."""
    start = stream.tell()
    try:
        version = npy_format.read_magic(stream)
        read = npy_format.read_array_header_1_0 if version == (1, 0) else npy_format.read_array_header_2_0
        shape, fortran, dtype = read(stream, max_header_size=_LONGEST_HEADER)
    except (MemoryError, RecursionError, FileFormatError):
        raise
    except Exception as error:  # whatever the header's literal makes numpy raise
        raise source.error(f"{what} has no readable NPY header: {error}", f"byte {start}", _CUT) from error
    if dtype.hasobject:
        raise source.error(
            f"{what} holds Python objects, which are never unpickled", f"byte {start}", "save it as an array of numbers"
        )
    left = start + size - stream.tell()
    need = math.prod(max(0, int(extent)) for extent in shape) * dtype.itemsize
    if dtype.itemsize == 0 or any(extent < 0 for extent in shape) or need != left:
        raise source.error(
            f"{what} of shape {shape} and type {dtype} needs {need} bytes, there are {left}",
            f"byte {stream.tell()}", _CUT,
        )  # fmt: skip
    return tuple(int(extent) for extent in shape), bool(fortran), dtype


def _taken(source: Source, stream: Any, size: int, what: str) -> NDArray[np.uint8]:
    """Read bytes whose number somebody claims: room is made as they come, so that a lie costs nothing."""
    data = np.empty(min(size, _AT_ONCE), np.uint8)
    done = 0
    while done < size:
        if done == len(data):
            data = np.concatenate([data, np.empty(min(len(data), size - done), np.uint8)])
        got = stream.read(min(1 << 22, len(data) - done))
        if not got:
            raise source.error(f"{what} ends too early", f"byte {done} of its data", _CUT)
        data[done : done + len(got)] = np.frombuffer(got, np.uint8)
        done += len(got)
    return data


def content_of_array(source: Source, array: NDArray[Any]) -> Content:
    """Return the content of an array of columns or of records."""
    names = array.dtype.names
    if names is None:
        if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in "fiub":
            raise source.error(
                f"the array has shape {array.shape} and type {array.dtype}", "header",
                "points are an array (n, 3), or (n, 6) with normals, of real numbers",
            )  # fmt: skip
        return content_of_table(array.astype(np.float64), None)
    if array.ndim != 1:
        raise source.error(f"the records have shape {array.shape}", "header", "give one record a point")
    columns: dict[str, NDArray[Any]] = {name: native(array[name]) for name in names}
    for group, joined in ((POINTS[0], "points"), (NORMALS[0], "normals")):
        if joined in columns and columns[joined].shape[1:] == (3,):
            columns.update({name: columns[joined][:, i] for i, name in enumerate(group)})
            del columns[joined]
    if not set(POINTS[0]) <= columns.keys() or any(
        columns[n].ndim != 1 or columns[n].dtype.kind not in "fiu" for n in POINTS[0]
    ):
        raise source.error(f"the records have fields {', '.join(names)}", "header", "name fields x, y and z")
    points = np.stack([columns.pop(name) for name in POINTS[0]], axis=1).astype(np.float64)
    group_found = first_of(NORMALS, columns)
    normals = None
    if group_found is not None and all(columns[n].dtype.kind in "fiu" and columns[n].ndim == 1 for n in group_found):
        normals = np.stack([columns.pop(name) for name in group_found], axis=1).astype(np.float64)
    return content_by_name(columns, points, normals, [])


def native(array: NDArray[Any]) -> NDArray[Any]:
    """Return the values in this machine's byte order, contiguous."""
    return np.ascontiguousarray(array.astype(array.dtype.newbyteorder("="), copy=False))
