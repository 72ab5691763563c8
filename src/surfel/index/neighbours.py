"""PointIndex: the nearest and the near points of every point, found block by block along a Hilbert curve."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.box import corners
from surfel.core.cast import Floats, as_count, as_points, as_positive, read_only
from surfel.core.errors import InputError
from surfel.index.blocks import build_blocks
from surfel.index.hilbert import hilbert_order

_LARGEST, _SMALLEST = 1e150, 1e-150  # beyond these the square of a distance overflows or vanishes


class PointIndex:
    """An immutable index of points for neighbour searches.

    Rows are numbered in *sorted* order: row r of every result is ``points[index.order[r]]`` of the input. Distances are
    those of float64 arithmetic on the input coordinates, whatever their offset, and so is the order of the neighbours.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        At least one point, finite coordinates.

    Attributes
    ----------
    order : NDArray[np.int32], shape (n,)
        The input row of each sorted row.
    origin : Floats, shape (3,)
        What was subtracted, without any rounding; zero on axes whose offset is not large against their extent.
    points : Floats, shape (n, 3)
        The sorted points minus ``origin``.

    Raises
    ------
    InputError
        If the points are not finite rows of three, there are none, or their extent is beyond 1e-150 to 1e150.

    Examples
    --------
    >>> from surfel.index.neighbours import PointIndex
    >>> index = PointIndex([[0.0, 0, 0], [3, 0, 0], [1, 0, 0]])
    >>> squares, rows = index.knn(1)
    >>> [(int(index.order[a]), int(index.order[b])) for a, b in enumerate(rows[:, 0])]
    [(0, 2), (2, 0), (1, 2)]
    """

    def __init__(self, points: ArrayLike) -> None:
        given = as_points(points)
        if not len(given):
            raise InputError("points must hold at least one point; got none")
        low, high = corners(given)
        extent = float((high * 0.5 - low * 0.5).max()) * 2.0
        if extent and not _SMALLEST <= extent <= _LARGEST:
            raise InputError(
                f"points must span between 1e-150 and 1e150, or squares overflow; got {extent:g}; scale them"
            )
        self.order = read_only(hilbert_order(given))
        self.origin = read_only(_exact_origin(low, high))
        self._blocks = build_blocks(given, self.order, self.origin)
        self.points = self._blocks.points.reshape(-1, 3)[: len(given)]
        self.points.flags.writeable = False

    def moved(self, points: ArrayLike) -> PointIndex:
        """Return an index of points that have moved a little: the order stays, the boxes are fitted anew.

        It answers as exactly as a new one and costs a fraction of it; the farther points move from their neighbours in
        the order, the slower it searches.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            The *sorted* points at their new places, minus ``origin``.

        Raises
        ------
        InputError
            If the shape is not that of the points, or a coordinate is not finite.
        """
        given = as_points(points)
        if len(given) != len(self):
            raise InputError(f"points must have {len(self)} rows, one for each point of the index; got {len(given)}")
        other = object.__new__(PointIndex)
        other.order, other.origin = self.order, self.origin
        other._blocks = build_blocks(given, np.arange(len(given), dtype=np.int32), np.zeros(3))
        other.points = other._blocks.points.reshape(-1, 3)[: len(given)]
        other.points.flags.writeable = False
        return other

    def __len__(self) -> int:
        return len(self.order)

    def knn(
        self, k: int, rows: ArrayLike | None = None, out: tuple[Floats, NDArray[np.int32]] | None = None
    ) -> tuple[Floats, NDArray[np.int32]]:
        """Return the k nearest neighbours of points of the index, themselves excluded.

        Parameters
        ----------
        k : int
            Less than the number of points.
        rows : array_like of int, shape (m,), optional
            The sorted rows to search for, all by default; runs of rows (``numpy.arange(a, b)``) are as fast as all.
        out : tuple of arrays, optional
            Where to write: C-contiguous float64 and int32 arrays of shape (m, k).

        Returns
        -------
        squares : Floats, shape (m, k)
            Squared distances, ascending.
        neighbours : NDArray[np.int32], shape (m, k)
            Sorted rows; equal distances ascend by row. Which of several equally far k-th neighbours is taken is not
            said. An exact duplicate of a point is a neighbour at distance 0.

        Raises
        ------
        InputError
            If ``k`` is not between 1 and n - 1, a row does not exist, or ``out`` does not fit.
        """
        wanted = as_count(k, "k")
        if wanted >= len(self):
            raise InputError(f"k must be below the number of points, {len(self)}; got {wanted}")
        return self._nearest(self.points, self._rows(rows), wanted, own=True, out=out)

    def knn_of(self, queries: ArrayLike, k: int) -> tuple[Floats, NDArray[np.int32]]:
        """Return the k nearest points of the index to other places.

        Parameters
        ----------
        queries : array_like, shape (m, 3)
            In the coordinates of the input.
        k : int
            At most the number of points.

        Returns
        -------
        squares : Floats, shape (m, k)
            Squared distances, ascending.
        neighbours : NDArray[np.int32], shape (m, k)
            Sorted rows.

        Raises
        ------
        InputError
            If the queries are not finite rows of three or ``k`` is not between 1 and n.
        """
        places, wanted = self._places(queries), as_count(k, "k")
        if wanted > len(self):
            raise InputError(f"k must be at most the number of points, {len(self)}; got {wanted}")
        return self._nearest(places, hilbert_order(places), wanted, own=False)

    def radius(self, r: float, rows: ArrayLike | None = None) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """Return all neighbours within a distance of points of the index, themselves excluded.

        Parameters
        ----------
        r : float
            The distance, itself included.
        rows : array_like of int, shape (m,), optional
            The sorted rows to search for, all by default.

        Returns
        -------
        offsets : NDArray[np.int64], shape (m + 1,)
            The neighbours of the i-th row are ``neighbours[offsets[i]:offsets[i + 1]]``.
        neighbours : NDArray[np.int32], shape (offsets[m],)
            Sorted rows, ascending.

        Raises
        ------
        InputError
            If ``r`` is not positive or a row does not exist.
        """
        return self._near(self.points, self._rows(rows), as_positive(r, "r"), own=True)

    def radius_of(self, queries: ArrayLike, r: float) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """Return all points of the index within a distance of other places; compressed rows as :meth:`radius` gives.

        Parameters
        ----------
        queries : array_like, shape (m, 3)
            In the coordinates of the input; best in an order in which neighbours follow each other.
        r : float
            The distance, itself included.

        Returns
        -------
        offsets, neighbours : NDArray[np.int64], shape (m + 1,), and NDArray[np.int32], shape (offsets[m],)
            As :meth:`radius` returns them.

        Raises
        ------
        InputError
            If the queries are not finite rows of three or ``r`` is not positive.
        """
        places = self._places(queries)
        return self._near(places, np.arange(len(places), dtype=np.int32), as_positive(r, "r"), own=False)

    def _nearest(
        self, places: Floats, rows: NDArray[np.int32], k: int, *, own: bool, out: Any = None
    ) -> tuple[Floats, NDArray[np.int32]]:
        from surfel.index.knn import search_nearest

        if out is None:
            squares, neighbours = np.empty((len(rows), k)), np.empty((len(rows), k), np.int32)
        else:
            squares, neighbours = _fitting(out, (len(rows), k))
        search_nearest(self._blocks, places, rows, own, squares, neighbours)
        return squares, neighbours

    def _near(
        self, places: Floats, rows: NDArray[np.int32], r: float, *, own: bool
    ) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        from surfel.index.radius import search_within

        return search_within(self._blocks, places, rows, own, r)

    def _rows(self, rows: ArrayLike | None) -> NDArray[np.int32]:
        if rows is None:
            return np.arange(len(self), dtype=np.int32)
        given = np.asarray(rows)
        if given.ndim != 1 or (given.dtype.kind not in "iu" and len(given)):
            raise InputError(f"rows must be a list of row numbers; got type {given.dtype} and shape {given.shape}")
        if len(given) and (int(given.min()) < 0 or int(given.max()) >= len(self)):
            raise InputError(f"rows must lie between 0 and {len(self) - 1}; got {given.min()} to {given.max()}")
        return np.ascontiguousarray(given, dtype=np.int32)

    def _places(self, queries: ArrayLike) -> Floats:
        places = as_points(queries, "queries")
        if len(places) and not float(np.abs(places).max()) <= _LARGEST:
            raise InputError(f"queries must lie within {_LARGEST:g} of zero; got {float(np.abs(places).max()):g}")
        return np.asarray(places - self.origin)


def _exact_origin(low: Floats, high: Floats) -> Floats:
    """Return what can be subtracted without rounding.

    Where all of an axis lies within a factor 2 of its middle, the differences are exact (Sterbenz); elsewhere the
    extent is as large as the offset, and there is nothing to gain.
    """
    least, most = np.minimum(np.abs(low), np.abs(high)), np.maximum(np.abs(low), np.abs(high))
    far = (np.sign(low) == np.sign(high)) & (most * 0.5 <= least)
    return np.where(far, low * 0.5 + high * 0.5, 0.0)


def _fitting(out: Any, shape: tuple[int, int]) -> tuple[Floats, NDArray[np.int32]]:
    squares, neighbours = out
    for name, array, kind in (("squares", squares, np.float64), ("neighbours", neighbours, np.int32)):
        fits = isinstance(array, np.ndarray) and array.shape == shape and array.dtype == kind
        if not (fits and array.flags.c_contiguous and array.flags.writeable):
            wanted = f"a writeable C-contiguous {kind.__name__} array of shape {shape}"
            raise InputError(f"out must hold {wanted} for the {name}")
    return squares, neighbours
