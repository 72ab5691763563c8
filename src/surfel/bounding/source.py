"""Where the points come from: an array, a cloud, or chunks that can be read more than once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from surfel.core.cast import Floats, as_points
from surfel.core.errors import InputError
from surfel.shapes.base import Shape


class Source:
    """Points that can be passed over again and again, in chunks of shape (k, 3).

    Parameters
    ----------
    points : array_like of shape (k, 3), a cloud, or an iterable of these
        An iterable is read once a pass, so that no more than a chunk is ever held. It has to begin anew each time it
        is iterated over: a generator does not.

    Raises
    ------
    InputError
        If it is none of these, or an iterator that can be read only once.
    """

    def __init__(self, points: Any) -> None:
        self.streamed = _is_chunks(points)
        if self.streamed and iter(points) is points:
            raise InputError(
                f"points is a {type(points).__name__} that can be read only once, and a fit needs two passes; give a "
                "list of chunks, an object whose __iter__ starts anew (as surfel.open does), or one array"
            )
        self._points = points if self.streamed else as_rows_of(points)

    def __iter__(self) -> Iterator[Floats]:
        if not self.streamed:
            yield self._points
            return
        for chunk in self._points:
            yield as_rows_of(chunk)


def chunks_of(points: Any) -> Iterable[Floats]:
    """Return the points as arrays of shape (k, 3), one pass over them; any iterator will do."""
    if not _is_chunks(points):
        return [as_rows_of(points)]
    return (as_rows_of(chunk) for chunk in points)


def as_rows_of(points: Any) -> Floats:
    """Return an array or a cloud as contiguous float64 rows that kernels take for writable."""
    if isinstance(points, Shape) and not hasattr(points, "points"):
        raise InputError(
            f"points is a {type(points).__name__}, which is more than its points; give points of it (see surfel.sample)"
        )
    return _as_if_writable(as_points(getattr(points, "points", points), finite=False))


def _is_chunks(points: Any) -> bool:
    if isinstance(points, np.ndarray) or hasattr(points, "__array__"):
        return False
    if hasattr(points, "points") and _is_rows(points):  # a cloud; of a file that is open, ``points`` is their number
        return False
    if isinstance(points, list | tuple):
        return len(points) > 0 and all(_is_rows(chunk) for chunk in points)
    if isinstance(points, Iterable) and not isinstance(points, str | bytes | dict):
        return True
    if points is None or isinstance(points, str | bytes | dict):
        raise InputError(f"points must be an array of shape (n, 3), a cloud, or chunks; got {type(points).__name__}")
    return False


def _is_rows(chunk: Any) -> bool:
    rows: Any = getattr(chunk, "points", chunk)
    return np.ndim(rows) == 2


class _Memory:
    """The memory of an array, said to be writable: kernels are compiled once for both kinds, and only read it."""

    def __init__(self, array: Floats) -> None:
        self.array = array
        self.__array_interface__ = dict(array.__array_interface__)
        self.__array_interface__["data"] = (array.__array_interface__["data"][0], False)


def _as_if_writable(array: Floats) -> Floats:
    if array.flags.writeable:
        return array
    return np.asarray(_Memory(array)) if array.size else np.array(array)
