"""Every crossing of infinite lines with triangles: an exact answer to "which", by a tree of boxes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import threads_for
from surfel.core.cast import Floats, as_points
from surfel.core.errors import InputError
from surfel.core.triangles import as_triangles
from surfel.index import bvh_trace
from surfel.index.bvh_build import build_tree
from surfel.index.morton import order_lines

_SORT_FROM = 4096
_PROBES = 256
_WORK = 16  # a line is as much work as this many items of a simple loop


class Hits(NamedTuple):
    """Every hit of a batch of lines, as compressed rows.

    Parameters
    ----------
    offsets : NDArray[np.int64], shape (m + 1,)
        The hits of line l are the rows ``offsets[l]:offsets[l + 1]``.
    t : Floats, shape (k,)
        Where the hit lies, ``origin + t * direction``; ascending within a line, equal ones by triangle.
    triangle : NDArray[np.int32], shape (k,)
        Which triangle was hit.
    bary : Floats, shape (k, 2)
        The weights of the triangle's second and third corner; shape (0, 2) where not asked for.
    """

    offsets: NDArray[np.int64]
    t: Floats
    triangle: NDArray[np.int32]
    bary: Floats


class TriangleBvh:
    """A tree of boxes over triangles.

    A line crosses a closed surface an even number of times, also through edges, corners and along faces: where a line
    meets an edge, exactly one side has it. Triangles with two equal corners are never hit. Answers depend on the line
    and the triangles alone, not on the number of threads, the order of the lines or the CPU's vector instructions.

    Parameters
    ----------
    vertices : array_like, shape (v, 3)
        Finite coordinates of any scale.
    triangles : array_like of int, shape (f, 3)
        Rows of ``vertices``. Corners with equal coordinates are one corner, whatever their rows.

    Raises
    ------
    InputError
        If a shape or a type does not fit, a coordinate is not finite or a triangle names a vertex that is not there.

    Notes ----- Leaves of eight triangles in Hilbert order under an implicit tree of eight children a node. Boxes and
    triangles are filtered in float32 with proven bounds; what is within a bound is decided exactly
    (`surfel.index.bvh_exact`). 56 bytes a triangle and 24 a vertex.

    Examples
    --------
    >>> from surfel.index.bvh import TriangleBvh
    >>> square = TriangleBvh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> offsets, t, triangle, _ = square.cross([[0.5, 0.5, 3.0]], [[0.0, 0.0, 1.0]])
    >>> offsets.tolist(), t.tolist()
    ([0, 1], [-3.0])
    """

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike) -> None:
        points = as_points(vertices, "vertices")
        faces = as_triangles(triangles, len(points))
        self._faces = len(faces)
        self._tree = build_tree(_read(points), _read(faces)) if len(faces) else None

    def __len__(self) -> int:
        return self._faces

    @property
    def order(self) -> NDArray[np.int32]:
        """The triangles in the order of a curve that fills space: neighbours follow each other, shape (f,)."""
        return np.empty(0, np.int32) if self._tree is None else self._tree.order

    def cross(self, origins: ArrayLike, directions: ArrayLike, *, barycentric: bool = False) -> Hits:
        """Return every hit of every line.

        Parameters
        ----------
        origins : array_like, shape (m, 3)
            A point on each line.
        directions : array_like, shape (m, 3)
            Along each line; the lines are infinite both ways.
        barycentric : bool
            Whether to compute ``bary``.

        Returns
        -------
        Hits
            ``offsets, t, triangle, bary``; t in lengths of the direction.

        Raises
        ------
        InputError
            If a shape does not fit, or a value is not finite, or a direction is zero.
        """
        start, along = _as_lines(origins, directions)
        order = self._order(start, along)
        counts, places = np.empty(len(start), np.int32), np.empty(len(start), np.int64)
        if self._tree is None:
            return Hits(np.zeros(len(start) + 1, np.int64), np.empty(0), np.empty(0, np.int32), np.empty((0, 2)))
        store = self._trace_into(start, along, order, self._room(start, along, order), counts, places)
        offsets = np.zeros(len(start) + 1, np.int64)
        np.cumsum(counts, out=offsets[1:])
        hits = int(offsets[-1])
        t, triangle = np.empty(hits), np.empty(hits, np.int32)
        bary = np.empty((hits if barycentric else 0, 2))
        self._place(start, along, counts, offsets, places, store, (t, triangle, bary))
        if places.min(initial=0) < 0:  # no room, but their counts are known by now
            missed = order[places[order] < 0]
            places[:] = -1
            room = np.add.reduceat(counts[missed].astype(np.int64), np.arange(0, len(missed), bvh_trace.CHUNK))
            store = self._trace_into(start, along, missed, room, counts, places)
            self._place(start, along, counts, offsets, places, store, (t, triangle, bary))
        return Hits(offsets, t, triangle, bary)

    def count(self, origins: ArrayLike, directions: ArrayLike) -> NDArray[np.int32]:
        """Return how many triangles each line hits, shape (m,); arguments and errors as for :meth:`cross`."""
        start, along = _as_lines(origins, directions)
        return self._count(start, along, self._order(start, along))

    def weighted_count(self, origins: ArrayLike, directions: ArrayLike, weights: ArrayLike) -> Floats:
        """Return the sum of the weights of the triangles that each line hits.

        Parameters
        ----------
        origins, directions : array_like, shape (m, 3)
            As for :meth:`cross`.
        weights : array_like, shape (f,)
            One weight for each triangle.

        Returns
        -------
        Floats, shape (m,)
            The sums; the same bits on any number of threads.

        Raises
        ------
        InputError
            As for :meth:`cross`, or if there is not one weight for each triangle.
        """
        start, along = _as_lines(origins, directions)
        shares = _read(np.ascontiguousarray(weights, dtype=np.float64))
        if shares.shape != (self._faces,):
            raise InputError(f"weights must have shape ({self._faces},), one for each triangle; got {shares.shape}")
        sums = np.zeros(len(start))
        if self._tree is not None:
            self._trace(start, along, self._order(start, along), bvh_trace.WEIGH, weights=shares, sums=sums)
        return sums

    def _order(self, start: Floats, along: Floats) -> NDArray[np.int32]:
        """Return the order in which to follow the lines: neighbours one after the other, where that pays."""
        if len(start) < _SORT_FROM or self._tree is None:
            return np.arange(len(start), dtype=np.int32)
        tree = self._tree
        return order_lines(start, along, tree.middle / tree.scale, 1.75 * tree.size / tree.scale)

    def _count(self, start: Floats, along: Floats, order: NDArray[np.int32]) -> NDArray[np.int32]:
        counts = np.zeros(len(start), np.int32)
        if self._tree is not None:
            self._trace(start, along, order, bvh_trace.COUNT, counts=counts)
        return counts

    def _room(self, start: Floats, along: Floats, order: NDArray[np.int32]) -> NDArray[np.int64]:
        """Return how many hits to make room for in each chunk of lines, judged by some of the lines."""
        chosen = np.ascontiguousarray(order[:: max(1, len(order) // _PROBES)])
        mean = float(self._count(start, along, chosen)[chosen].mean()) if len(chosen) else 0.0
        chunks = -(-len(order) // bvh_trace.CHUNK)
        return np.full(chunks, int(bvh_trace.CHUNK * (3.0 * mean + 4.0)))

    def _trace_into(
        self,
        start: Floats,
        along: Floats,
        order: NDArray[np.int32],
        room: NDArray[np.int64],
        counts: NDArray[np.int32],
        places: NDArray[np.int64],
    ) -> tuple[Floats, NDArray[np.int32]]:
        regions = np.concatenate([[0], np.cumsum(room)])
        store = np.empty(int(regions[-1])), np.empty(int(regions[-1]), np.int32)
        self._trace(start, along, order, bvh_trace.STORE, counts=counts, regions=regions, places=places, store=store)
        return store

    def _trace(
        self,
        start: Floats,
        along: Floats,
        order: NDArray[np.int32],
        mode: int,
        *,
        weights: Floats | None = None,
        counts: NDArray[np.int32] | None = None,
        sums: Floats | None = None,
        regions: NDArray[np.int64] | None = None,
        places: NDArray[np.int64] | None = None,
        store: tuple[Floats, NDArray[np.int32]] | None = None,
    ) -> None:
        floats, integers, counted = np.empty(0), np.empty(0, np.int64), np.empty(len(start), np.int32)
        shares = _read(floats) if weights is None else weights
        chunks = -(-len(order) // bvh_trace.CHUNK)
        with threads_for(_WORK * len(order)):
            bvh_trace.trace(
                chunks,
                self._tree,
                start,
                along,
                order,
                mode,
                shares,
                counted if counts is None else counts,
                floats if sums is None else sums,
                np.zeros(chunks + 1, np.int64) if regions is None else regions,
                integers if places is None else places,
                *((floats, counted) if store is None else store),
            )

    def _place(
        self,
        start: Floats,
        along: Floats,
        counts: NDArray[np.int32],
        offsets: NDArray[np.int64],
        places: NDArray[np.int64],
        store: tuple[Floats, NDArray[np.int32]],
        hits: tuple[Floats, NDArray[np.int32], Floats],
    ) -> None:
        with threads_for(len(start)):
            bvh_trace.place_hits(len(start), self._tree, start, along, counts, offsets, places, *store, *hits)


def _as_lines(origins: ArrayLike, directions: ArrayLike) -> tuple[Floats, Floats]:
    start = as_points(origins, "origins")
    along = as_points(directions, "directions", finite=False)
    if len(along) != len(start):
        raise InputError(f"origins and directions must have as many rows; got {len(start)} and {len(along)}")
    largest = np.maximum(np.maximum(np.abs(along[:, 0]), np.abs(along[:, 1])), np.abs(along[:, 2]))
    if not (largest.min(initial=1.0) > 0.0 and largest.max(initial=0.0) < np.inf):
        raise InputError("directions must be finite and none of them zero")
    return _read(start), _read(along)


def _read(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view: numba compiles a kernel once more for arrays that may be written."""
    view = array.view()
    view.flags.writeable = False
    return view
