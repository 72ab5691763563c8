"""Stray points: those that belong to no surface, found however many there are.

A stray is sparse. So is the thin side of a cloud of uneven density; but that is joined to the rest by small steps, or
lies flat. Points that are no sparser than most are taken as surface; from them the surface grows over the sparse ones,
as far as the spacing of each point that it has taken reaches. Sparse points that it does not reach but that lie in
planes with each other, a dozen or more of them, are surface too and grow likewise. What is left are strays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel, rows, threads_for
from surfel.core.cast import Floats
from surfel.surface.planes import smallest_eigenpair

COLUMNS = 6
"""To how many of its neighbours the distances of every point must be known."""

SPARSE = 2.5
"""Points whose sixth neighbour is this many times farther than that of most are looked at."""

ISOLATED = 3.0
"""So are points whose sixth neighbour is this many times farther than that of most of their neighbours."""

REACH = 3.0
"""A point of the surface reaches this many times as far as its sixth neighbour: about four spacings."""

GROWTH = 1.3
"""How much farther than its predecessor's the reach of a point may be, where it lies flat."""

DECLINE = 0.7
"""The same, where it does not: a chain of strays that starts near the surface ends soon."""

SHEET = 12
"""So many sparse points in planes with each other are a surface."""

_FLAT = 12  # nearest neighbours that tell whether a point lies flat
_OFFSET = 0.2  # a flat point lies no farther off the plane of its neighbours, in distances of the last of them
_ASIDE = 0.6  # nor from their middle: it lies among them, not beside them
_ROUGH = 0.15  # nor do they, as a root mean square
_SUPPORT = 8  # of its neighbours are surface or lie flat themselves


def stray_rows(points: Floats, squared: Floats, neighbours: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the rows of points that belong to no surface.

    Strays nearer to a surface than about four of its spacings are not told from it. The answer depends neither on the
    order of the points nor on rigid motions or the scale, but for rounding.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Without duplicates.
    squared : Floats, shape (n, c)
        Squared distances to the nearest neighbours, ascending, at least :data:`COLUMNS` of them.
    neighbours : NDArray[np.int32], shape (n, k)
        The rows of the nearest, k of at least 12.
    """
    n, k = neighbours.shape
    if k < _FLAT:
        return np.empty(0, np.int64)
    sixth = np.ascontiguousarray(squared[:, COLUMNS - 1])
    sparse, reach = np.zeros(n, np.uint8), np.zeros(n)
    with threads_for(n):
        _sparse(n, sixth, neighbours, SPARSE**2 * float(np.median(sixth)), sparse, reach)
    unsure = np.flatnonzero(sparse)
    if not len(unsure):
        return unsure
    planes, sound, far = np.zeros((n, 3)), 1 - sparse, np.empty((len(unsure), k))
    with threads_for(len(unsure)):
        _flat_planes(len(unsure), unsure, points, neighbours, far, planes, sound)
    _drop_planes_by_chance(unsure, sound, neighbours, planes)
    _grow(unsure, sixth, far, neighbours, planes, reach)
    bare = reach[unsure] == 0.0
    _take_sheets(unsure[bare], points, sixth, far[bare], neighbours, planes, reach)
    _grow(unsure, sixth, far, neighbours, planes, reach)
    return np.asarray(unsure[reach[unsure] == 0.0])


@rows
def _sparse(first, last, sixth, neighbours, bound, sparse, reach):
    """Mark sparse points; let the others reach hardly farther than the densest of their neighbours."""
    for i in range(first, last):
        nearer, least = 0, sixth[i]
        for a in range(6):
            there = sixth[neighbours[i, a]]
            if sixth[i] > ISOLATED * ISOLATED * there:
                nearer += 1
            least = min(least, GROWTH * GROWTH * there)
        if sixth[i] > bound or nearer >= 4:
            sparse[i] = 1
        else:
            reach[i] = least


@rows
def _flat_planes(first, last, chosen, points, neighbours, far, planes, sound):
    """Write the squared distances of each chosen point's neighbours, and the normal of their plane, if there is one."""
    for c in range(first, last):
        i = chosen[c]
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        for a in range(neighbours.shape[1]):
            j = neighbours[i, a]
            x, y, z = points[j, 0] - px, points[j, 1] - py, points[j, 2] - pz
            far[c, a] = (x * x + y * y) + z * z
        sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
        for a in range(_FLAT):
            j = neighbours[i, a]
            x, y, z = points[j, 0] - px, points[j, 1] - py, points[j, 2] - pz
            sx += x
            sy += y
            sz += z
            xx += x * x
            xy += x * y
            xz += x * z
            yy += y * y
            yz += y * z
            zz += z * z
        m = 1.0 / _FLAT
        low, nx, ny, nz = smallest_eigenpair(
            xx - sx * sx * m, xy - sx * sy * m, xz - sx * sz * m, yy - sy * sy * m, yz - sy * sz * m, zz - sz * sz * m
        )
        rim = far[c, _FLAT - 1]
        off = (nx * sx + ny * sy + nz * sz) * m
        aside = (sx * sx + sy * sy + sz * sz) * m * m
        within = off * off <= _OFFSET * _OFFSET * rim and aside <= _ASIDE * _ASIDE * rim
        if within and max(low, 0.0) * m <= _ROUGH * _ROUGH * rim:
            planes[i, 0], planes[i, 1], planes[i, 2] = nx, ny, nz
            sound[i] = 1


def _drop_planes_by_chance(
    unsure: NDArray[np.int64], sound: NDArray[np.uint8], neighbours: NDArray[np.int32], planes: Floats
) -> None:
    """Forget the planes of points most of whose neighbours are neither surface nor lie flat themselves."""
    support = sound[neighbours[unsure, :_FLAT]].sum(axis=1)
    planes[unsure[support < _SUPPORT]] = 0.0


@kernel
def _grow(unsure, sixth, far, neighbours, planes, reach):
    """Let the surface take what it reaches, to the fixed point, which does not depend on the order.

    ``reach`` holds the squares of the distances that stand for a sixth neighbour, 0 where the surface is not yet.
    """
    count, k = len(unsure), neighbours.shape[1]
    forward, changed = True, True
    while changed:
        changed = False
        for turn in range(count):
            c = turn if forward else count - 1 - turn
            i = unsure[c]
            most = 0.0
            for a in range(k):
                from_there = reach[neighbours[i, a]]
                if from_there > most and far[c, a] <= REACH * REACH * from_there:
                    most = from_there
            if most > 0.0 and _take(i, most, sixth, planes, reach):
                changed = True
            if reach[i] == 0.0:
                continue
            for a in range(k):
                if far[c, a] > REACH * REACH * reach[i]:
                    break
                j = neighbours[i, a]
                if reach[j] < sixth[j] and _take(j, reach[i], sixth, planes, reach):
                    changed = True
        forward = not forward


@kernel
def _take(i, reached_from, sixth, planes, reach):
    """Raise the reach of point i, if it is more when reached from there; tell whether it was raised."""
    flat = planes[i, 0] != 0.0 or planes[i, 1] != 0.0 or planes[i, 2] != 0.0
    own = min(sixth[i], reached_from * (GROWTH * GROWTH if flat else DECLINE * DECLINE))
    if own <= reach[i]:
        return False
    reach[i] = own
    return True


def _take_sheets(
    chosen: NDArray[np.int64],
    points: Floats,
    sixth: Floats,
    far: Floats,
    neighbours: NDArray[np.int32],
    planes: Floats,
    reach: Floats,
) -> None:
    """Give points in planes with each other, in groups of some size, the reach of their own spacing."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    lies_flat = planes[chosen].any(axis=1)
    flat, apart = chosen[lies_flat], far[lies_flat, :_FLAT]
    if len(flat) < SHEET:
        return
    place = np.full(len(points), -1)
    place[flat] = np.arange(len(flat))
    near = neighbours[flat, :_FLAT]
    step = points[near] - points[flat][:, None]
    off = np.maximum(
        np.abs(np.einsum("iaj,ij->ia", step, planes[flat])), np.abs(np.einsum("iaj,iaj->ia", step, planes[near]))
    )
    limit = REACH**2 * np.minimum(sixth[flat][:, None], sixth[near])
    joined = (place[near] >= 0) & (apart <= limit) & (off**2 <= _OFFSET**2 * apart)
    row, column = np.nonzero(joined)
    links = coo_array((np.ones(len(row), np.int8), (row, place[near[row, column]])), shape=(len(flat), len(flat)))
    _, part = connected_components(links, directed=False)
    sheet = flat[np.bincount(part)[part] >= SHEET]
    reach[sheet] = sixth[sheet]
