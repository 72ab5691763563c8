"""An octree of fixed depth over points: its boundary cells, which hold points, and the points near a line.

Adams and Dutré, *Interactive Boolean operations on surfel-bounded solids*, SIGGRAPH 2003: cells that hold points are
boundary cells, all others are empty. Only boundary cells are stored, so an empty one costs nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, rows, threads_for
from surfel.core.cast import Floats
from surfel.index.neighbours import PointIndex
from surfel.index.radix import index_bits, sort_packed

DEEPEST = 10
"""A key of three times so many bits, and the number of a point, fit an integer of 64."""

STACK = 7 * DEEPEST + 10
"""Room for the cells that wait, all but one of eight on every level, and for one that is written and not kept."""


class PointOctree(NamedTuple):
    """Boundary cells level by level, the root first; the children of a cell stand side by side.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        In the order of the cells.
    order : NDArray[np.int32], shape (n,)
        The input row of each point.
    middle : Floats, shape (m, 3)
        The middle of each cell.
    half : Floats, shape (m,)
        Half the side of each cell.
    first : NDArray[np.int32], shape (m + 1,)
        The points of a leaf are the rows ``first[c]:first[c + 1]``; only leaves have any here.
    child : NDArray[np.int32], shape (m + 1,)
        The children of a cell are the cells ``child[c]:child[c + 1]``; a leaf has none.
    leaves : int
        How many leaves there are; they are the last cells.
    """

    points: Floats
    order: NDArray[np.int32]
    middle: Floats
    half: Floats
    first: NDArray[np.int32]
    child: NDArray[np.int32]
    leaves: int

    @property
    def starts(self) -> NDArray[np.int32]:
        """The first point of each leaf, shape (leaves,)."""
        return self.first[-self.leaves - 1 : -1]

    @property
    def counts(self) -> NDArray[np.int32]:
        """How many points each leaf holds, shape (leaves,)."""
        return np.diff(self.first[-self.leaves - 1 :])


def build_octree(points: Floats, depth: int) -> PointOctree:
    """Divide the cube round at least one point ``depth`` times wherever there are points.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Finite, of moderate size.
    depth : int
        1 to :data:`DEEPEST`.
    """
    n = len(points)
    columns = points.T
    low = np.array([column.min() for column in columns])
    size = max(float(column.max() - start) for column, start in zip(columns, low, strict=True)) or 1.0
    shift = index_bits(n)
    packed = np.empty(n, np.int64)
    with threads_for(n):
        _key_points(n, points, low, float((1 << depth) / size), np.int64((1 << depth) - 1), np.int64(shift), packed)
    packed = sort_packed(packed, shift, 3 * depth)
    order = (packed & ((1 << shift) - 1)).astype(np.int32)
    key = packed >> shift
    starts = [np.zeros(1, np.int64)]  # the first point of each cell, by level
    for level in range(1, depth + 1):
        prefix = key >> (3 * (depth - level))
        starts.append(np.concatenate([[0], np.flatnonzero(prefix[1:] != prefix[:-1]) + 1]))
    return _assembled(points[order], order, key, starts, low, size)


def nearest_squares(tree: PointOctree) -> Floats:
    """Return the squared distance of each of at least two points to the nearest other one, in the order of the tree."""
    n = len(tree.points)
    deeper = max(0, round(0.5 * math.log2(n / (tree.leaves * _FEW))))  # a surface has four times the cells a level
    depth = round(math.log2(tree.half[0] / tree.half[-1])) + deeper
    fine = tree if deeper == 0 or depth > DEEPEST else build_octree(tree.points, depth)
    squares = np.empty(n)
    if fine.counts.max() > _CROWD:
        index = PointIndex(tree.points)
        squares[index.order] = index.knn(1)[0][:, 0]
        return squares
    found = squares if fine is tree else np.empty(n)
    with threads_for(8 * n):
        _nearest(fine.leaves, fine.points, fine.middle, fine.half, fine.first, fine.child, np.int64(fine.leaves),
                 found)  # fmt: skip
    if fine is not tree:
        squares[fine.order] = found
    return squares


_FEW = 40  # points in a cell: fewer make the walk to the cells beside it longer, more the search in it
_CROWD = 1000  # in one cell: too many to compare each with each


def _assembled(
    points: Floats, order: NDArray[np.int32], key: NDArray[np.int64], starts: list[NDArray[np.int64]], low: Floats,
    size: float,
) -> PointOctree:  # fmt: skip
    """Put the cells of all levels in a row, and tell each where its children and its points begin."""
    depth = len(starts) - 1
    counts = [len(start) for start in starts]
    begins = np.concatenate([[0], np.cumsum(counts)])
    middles, halves, children = [], [], []
    for level, start in enumerate(starts):
        side = size / (1 << level)
        place = _deinterleaved(key[start] >> (3 * (depth - level)), level)
        middles.append(low + side * (place + 0.5))
        halves.append(np.full(len(start), 0.5 * side))
        if level < depth:
            children.append(begins[level + 1] + np.searchsorted(starts[level + 1], start))
    children.append(np.full(counts[-1] + 1, begins[-1]))
    first = np.zeros(begins[-1] + 1, np.int32)
    first[begins[-2] : -1], first[-1] = starts[-1], len(points)
    return PointOctree(
        points, order, np.concatenate(middles), np.concatenate(halves), first,
        np.concatenate(children).astype(np.int32), counts[-1],
    )  # fmt: skip


def _deinterleaved(key: NDArray[np.int64], bits: int) -> Floats:
    """Return the place of cells among those of their level, from their Morton keys, x first."""
    place = np.zeros((len(key), 3), np.int64)
    for bit in range(bits):
        for axis in range(3):
            place[:, axis] |= ((key >> (3 * bit + 2 - axis)) & 1) << bit
    return place.astype(np.float64)


@rows
def _key_points(first, last, points, low, scale, most, shift, packed):
    """Pack the Morton key of each point's cell and the point's number."""
    for i in range(first, last):
        x = min(int((points[i, 0] - low[0]) * scale), most)
        y = min(int((points[i, 1] - low[1]) * scale), most)
        z = min(int((points[i, 2] - low[2]) * scale), most)
        key = 0
        bit = most + 1 >> 1
        while bit > 0:
            key = (key << 3) | ((x & bit != 0) << 2) | ((y & bit != 0) << 1) | (z & bit != 0)
            bit >>= 1
        packed[i] = (key << shift) | i


@rows
def _nearest(begin, end, points, middle, half, first, child, leaves, squares):
    """Write the squared distances for the points of some leaves: in the leaf, in those beside it, at last anywhere."""
    stack, beside = np.empty(STACK, np.int32), np.empty(leaves + 1, np.int32)
    for leaf in range(len(half) - leaves + begin, len(half) - leaves + end):
        lx, ly, lz, side = middle[leaf, 0], middle[leaf, 1], middle[leaf, 2], 2.0 * half[leaf]
        touching = _leaves_near(middle, half, child, lx, ly, lz, half[leaf] * (1.0 + 1e-9), stack, beside)
        for i in range(first[leaf], first[leaf + 1]):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            best = np.inf
            for j in range(first[leaf], first[leaf + 1]):
                square = (points[j, 0] - x) ** 2 + (points[j, 1] - y) ** 2 + (points[j, 2] - z) ** 2
                if square < best and j != i:
                    best = square
            found, reached = touching, best > side * side
            if reached:  # rarely: leaves that do not touch may hold a nearer point
                found = _leaves_near(middle, half, child, x, y, z, np.sqrt(best), stack, beside)
            for k in range(found):
                cell = beside[k]
                gx = max(abs(middle[cell, 0] - x) - half[cell], 0.0)
                gy = max(abs(middle[cell, 1] - y) - half[cell], 0.0)
                gz = max(abs(middle[cell, 2] - z) - half[cell], 0.0)
                if cell != leaf and (gx * gx + gy * gy + gz * gz) * (1.0 - 1e-9) < best:
                    for j in range(first[cell], first[cell + 1]):
                        square = (points[j, 0] - x) ** 2 + (points[j, 1] - y) ** 2 + (points[j, 2] - z) ** 2
                        best = min(best, square)
            if reached:
                touching = _leaves_near(middle, half, child, lx, ly, lz, half[leaf] * (1.0 + 1e-9), stack, beside)
            squares[i] = best


@inner
def _leaves_near(middle, half, child, x, y, z, r, stack, found):
    """Write the leaves that a cube of half-side ``r`` round a place touches into ``found``; return how many."""
    count = 0
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        begin, end = child[stack[top]], child[stack[top] + 1]
        reach = half[begin] + r
        leaf = child[begin] == child[begin + 1]
        for cell in range(begin, end):
            dx, dy, dz = abs(middle[cell, 0] - x), abs(middle[cell, 1] - y), abs(middle[cell, 2] - z)
            meets = max(max(dx, dy), dz) <= reach
            if leaf:
                found[count] = cell
                count += meets
            else:
                stack[top] = cell
                top += meets
    return count


@inner
def leaves_on_line(middle, half, child, ox, oy, oz, dx, dy, dz, r, stack, found):
    """Write the leaves that the line passes nearer than ``r``, along the axes, into ``found``; return how many.

    ``stack`` is scratch, ``STACK`` long; ``found`` has room for every leaf and one more. A line meets a cell where the
    spans between its pairs of sides overlap; no branch has to be foreseen for that.
    """
    ix = 1.0 / dx if abs(dx) > 1e-300 else 1e300
    iy = 1.0 / dy if abs(dy) > 1e-300 else 1e300
    iz = 1.0 / dz if abs(dz) > 1e-300 else 1e300
    count = 0
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        begin, end = child[stack[top]], child[stack[top] + 1]
        grown = half[begin] + r
        x, y, z = grown * abs(ix), grown * abs(iy), grown * abs(iz)
        leaf = child[begin] == child[begin + 1]
        for cell in range(begin, end):
            tx, ty, tz = (middle[cell, 0] - ox) * ix, (middle[cell, 1] - oy) * iy, (middle[cell, 2] - oz) * iz
            meets = max(max(tx - x, ty - y), tz - z) <= min(min(tx + x, ty + y), tz + z)
            if leaf:
                found[count] = cell
                count += meets
            else:
                stack[top] = cell
                top += meets
    return count
