"""Points apart: groups of so few that they show no surface, with nothing near them.

Dust, birds, rain and points that hang between two things come in pairs and small clusters. To each other they are as
near as points of a surface are, but the group as a whole keeps a distance from everything else. Sparse parts do so too
where they lie between dense ones; those lie in the planes of what is round them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel, rows, threads_for
from surfel.core.cast import Floats
from surfel.surface.near_strays import FEW, NOTHING_OFF, OffSurface, mates, off_surface
from surfel.surface.strays import REACH

LINK = 2.5
"""Points no farther from each other than this many of the spacings about them belong together."""

MOST = 0.2
"""With a larger share of the points apart the cloud shows no surface, and nothing can stray from it."""


def strays_apart(
    points: Floats, squared: Floats, neighbours: NDArray[np.int32], spacing: Floats, strays: NDArray[np.int64]
) -> tuple[NDArray[np.int64], OffSurface]:
    """Return the points of small groups that are no surface: those far from one, and those near one but off it.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Without duplicates.
    squared : Floats, shape (n, c)
        Squared distances to the nearest neighbours, ascending, at least six of them.
    neighbours : NDArray[np.int32], shape (n, k)
        The rows of the nearest, ascending by distance.
    spacing : Floats, shape (n,)
        Local spacing.
    strays : NDArray[np.int64], shape (s,)
        Rows that are known to be strays.
    """
    n, k = neighbours.shape
    far, off = np.empty(0, np.int64), NOTHING_OFF
    if k < 2 * FEW:
        return far, off
    link, size = np.empty(n), np.full(n, FEW, np.int8)
    size[strays] = 0
    with threads_for(n):
        _link(n, spacing, neighbours, link)
    _count(points, neighbours, link, size)
    apart = np.flatnonzero((size > 0) & (size < FEW))
    if not 0 < len(apart) <= MOST * n:
        return far, off
    ignored = (size < FEW).astype(np.uint8)
    outside = _first_of(neighbours[apart], ignored)
    shown = outside[:, -1] >= 0
    gap = np.square(points[apart] - points[np.maximum(outside[:, 0], 0)]).sum(axis=1)
    far = apart[(outside[:, 0] < 0) | (gap > REACH**2 * squared[apart, 5])]
    near = apart[shown]
    found = off_surface(points[near], points, outside[shown], neighbours, ignored)
    found = found._replace(rows=near[found.rows])
    sheets = mates(found, points, neighbours, np.zeros(n, np.uint8), _groups(apart, neighbours)) > 0
    return far, found.where(~sheets & ~np.isin(found.rows, far))


def _groups(apart: NDArray[np.int64], neighbours: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return numbers of all points: the same for few of those apart that are near each other."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    place = np.full(len(neighbours), -1)
    place[apart] = np.arange(len(apart))
    near = place[neighbours[apart]]
    row, column = np.nonzero(near >= 0)
    joined = coo_array((np.ones(len(row), np.int8), (row, near[row, column])), shape=(len(apart), len(apart)))
    part = connected_components(joined, directed=False)[1]
    group = np.arange(len(neighbours), dtype=np.int32)
    few = np.bincount(part)[part] < FEW
    group[apart[few]] = len(neighbours) + part[few]
    return group


def _first_of(near: NDArray[np.int32], ignored: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Return the first few of each row that are not ignored, -1 where there are no more."""
    last = np.argsort(ignored[near], axis=1, kind="stable")[:, :FEW]
    chosen = np.take_along_axis(near, last, axis=1)
    chosen[ignored[chosen] != 0] = -1
    return np.ascontiguousarray(chosen)


@rows
def _link(first, last, spacing, neighbours, link):
    """Write the squared distance at which each point is linked, by the densest of its neighbours."""
    for i in range(first, last):
        least = spacing[i]
        for a in range(neighbours.shape[1]):
            least = min(least, spacing[neighbours[i, a]])
        link[i] = LINK * LINK * least * least


@inlined
def _linked(p, q, points, link):
    """Tell whether two points belong together."""
    x, y, z = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1], points[q, 2] - points[p, 2]
    return x * x + y * y + z * z <= max(link[p], link[q])


@kernel
def _count(points, neighbours, link, size):
    """Count the points that can be reached from each by links, up to as many as a surface needs; strays have 0."""
    group, known = np.empty(FEW, np.int32), np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        if size[i] == 0:
            continue
        group[0], count, done = i, 1, 0
        while done < count < FEW:
            p = group[done]
            done += 1
            for a in range(neighbours.shape[1]):
                q = neighbours[p, a]
                if size[q] == 0:
                    continue
                if not _linked(p, q, points, link):
                    continue
                if known[q] and size[q] == FEW:
                    count = FEW
                    break
                new = True
                for b in range(count):
                    new = new and group[b] != q
                if new:
                    group[count] = q
                    count += 1
                    if count == FEW:
                        break
        size[i], known[i] = count, True
