"""Sheets: the nearest surfels as one curved sheet or two, which meet in a convex or a concave edge."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import inner, rows, threads_for
from surfel._vec import dot, norm
from surfel.core.cast import Booleans, Floats
from surfel.index.hilbert import hilbert_order
from surfel.inside.falloff import falloff
from surfel.inside.judges.verdict import Verdict
from surfel.inside.operand import Operand

NEIGHBOURS = 8

ALIKE = 0.95
"""Where all normals make a larger cosine than this with the nearest one, there is one sheet."""

ROUND, OFF_ARC = 0.4, 0.2
"""There is one sheet as well where it merely bends: all normals make a larger cosine than this with the nearest one,
and steps from it and from the one most unlike it are at right angles to the mean of their normals, as on an arc, up to
this share of the sine between the normals."""

WIDTH = 0.35
"""Square of the Gaussian's width over the squared distance to the farthest of the neighbours."""

_WEIGHT = 32  # a place takes the time of so many of the items that threads are started for


class OverSheets(NamedTuple):
    """What the sheets near each of m places say.

    Parameters
    ----------
    value : Floats, shape (m,)
        The distance over the sheet that decides, negative inside.
    certain : Booleans, shape (m,)
        Whether both sheets say the same.
    squares : Floats, shape (m, k)
        Squared distances of the nearest surfels, ascending.
    near : NDArray[np.int32], shape (m, k)
        Their sorted rows.
    """

    value: Floats
    certain: Booleans
    squares: Floats
    near: NDArray[np.int32]


def judge(operand: Operand, queries: ArrayLike) -> Verdict:
    """Judge places by curved sheets through the nearest surfels.

    The nearest surfels are split in two where their normals spread, as by :mod:`surfel.inside.judges.two_cluster`. It
    differs in what a sheet is. The chord between two points of a sphere is at right angles to the mean of their
    normals. So the distance over a sheet of mean normal N is ``f(x) = sum w_i (x - p_i) . (n_i + N) / 2``, which has no
    error of second order in the curvature, where distances over planes have. That holds in the middle of the surfels;
    beside it, on sheets that bend much, what they bend by from the middle to the place is added. Sheets back to back,
    however sharp the edge, are told apart by whether they meet in a convex edge, as all others.

    Parameters
    ----------
    operand : Operand
        The cloud.
    queries : array_like, shape (q, 3)
        Places near the surface, in the coordinates of the cloud.

    Returns
    -------
    Verdict
        ``value`` is the distance over the sheet that decides; certain where both sheets say the same.

    Raises
    ------
    InputError
        If the queries are not finite rows of three.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside import sheets
    >>> from surfel.inside.operand import Operand
    >>> p = np.random.default_rng(0).standard_normal((900, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> sheets.judge(Operand.of(p, p), [[0.0, 0, 0.99], [0, 0, 1.01]]).value.round(2).tolist()
    [-0.01, 0.01]
    """
    places = operand.local(queries)
    if not len(operand) or not len(places):
        return Verdict.outside(len(places))
    found = over_sheets(operand, places, hilbert_order(places))
    return Verdict.of(found.value, found.certain)


def over_sheets(operand: Operand, places: Floats, order: NDArray[np.int32] | None = None) -> OverSheets:
    """Judge local places; ``order`` is one in which neighbours follow each other, by default the one they are in."""
    if order is None:
        order = np.arange(len(places), dtype=np.int32)
    squares, near = operand.index._nearest(places, order, min(NEIGHBOURS, len(operand)), own=False)
    value, certain = np.empty(len(places)), np.empty(len(places), bool)
    with threads_for(_WEIGHT * len(places)):
        _judge(len(places), operand.points, operand.normals, places, squares, near, value, certain)
    return OverSheets(value, certain, squares, near)


@rows
def _judge(first, last, points, normals, places, squares, near, value, certain):
    """Judge places; one sheet, which is most frequent, is looked at here, for calls count references to arrays."""
    k = near.shape[1]
    sums, weights = np.empty((2, 8)), np.empty(k)
    for i in range(first, last):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        lead = near[i, 0]
        lx, ly, lz = normals[lead, 0], normals[lead, 1], normals[lead, 2]
        nearest = squares[i, 0]
        inverse = 1.0 / (WIDTH * squares[i, k - 1]) if squares[i, k - 1] > 0.0 else 0.0
        for a in range(k):
            weights[a] = falloff((squares[i, a] - nearest) * inverse)
        least = 2.0
        mx = my = mz = px = py = pz = total = height = 0.0
        for a in range(k):
            j, weight = np.uint64(near[i, a]), weights[a]
            nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
            least = min(least, dot(lx, ly, lz, nx, ny, nz))
            dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
            mx, my, mz = mx + weight * nx, my + weight * ny, mz + weight * nz
            px, py, pz = px + weight * dx, py + weight * dy, pz + weight * dz
            total += weight
            height -= weight * dot(nx, ny, nz, dx, dy, dz)
        if least > ALIKE:
            value[i] = 0.5 * (height - dot(mx, my, mz, px, py, pz) / norm(mx, my, mz)) / total
            certain[i] = True
        else:
            value[i], certain[i] = side_of_sheets(points, normals, x, y, z, squares, near, i, sums, weights)


@inner
def side_of_sheets(points, normals, x, y, z, squares, near, i, sums, weights):
    """Return the distance of a place over what its nearest surfels bound, and whether the sheets agree.

    Row i of ``squares`` and ``near`` tells these surfels. ``sums``, scratch of shape (2, 8): normal, middle of the
    surfels seen from the place, weight, sum of distances; ``weights``, scratch of shape (k,).
    """
    k = near.shape[1]
    lead = near[i, 0]
    lx, ly, lz = normals[lead, 0], normals[lead, 1], normals[lead, 2]
    other, least = lead, 2.0
    nearest = squares[i, 0]
    inverse = 1.0 / (WIDTH * squares[i, k - 1]) if squares[i, k - 1] > 0.0 else 0.0
    for a in range(k):
        weights[a] = falloff((squares[i, a] - nearest) * inverse)
    for a in range(k):
        j = near[i, a]
        cosine = dot(lx, ly, lz, normals[j, 0], normals[j, 1], normals[j, 2])
        if cosine < least:
            least, other = cosine, j
    ox, oy, oz = normals[other, 0], normals[other, 1], normals[other, 2]
    if least > ALIKE or (least > ROUND and _bends(points, normals, near, i, lead, other)):
        return _over_one_sheet(points, normals, x, y, z, near, i, sums, weights), True
    sums[:, :] = 0.0
    for a in range(k):
        j = near[i, a]
        nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
        c = 0 if dot(nx, ny, nz, lx, ly, lz) >= dot(nx, ny, nz, ox, oy, oz) else 1
        weight = weights[a]
        dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
        sums[c, 0] += weight * nx
        sums[c, 1] += weight * ny
        sums[c, 2] += weight * nz
        sums[c, 3] += weight * dx
        sums[c, 4] += weight * dy
        sums[c, 5] += weight * dz
        sums[c, 6] += weight
        sums[c, 7] -= weight * dot(nx, ny, nz, dx, dy, dz)
    first = _over_sheet(sums, 0)
    second = _over_sheet(sums, 1)
    convex = 0.0
    for t in range(3):
        convex += (sums[1, t] - sums[0, t]) * (sums[1, 3 + t] - sums[0, 3 + t])
    decided = max(first, second) if convex > 0.0 else min(first, second)
    return decided, (first < 0.0) == (second < 0.0)


@inner
def _over_one_sheet(points, normals, x, y, z, near, i, sums, weights):
    """Return the distance of a place over all its nearest surfels as one sheet; add these up in scalars."""
    mx = my = mz = px = py = pz = total = height = 0.0
    for a in range(near.shape[1]):
        j, weight = near[i, a], weights[a]
        nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
        dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
        mx, my, mz = mx + weight * nx, my + weight * ny, mz + weight * nz
        px, py, pz = px + weight * dx, py + weight * dy, pz + weight * dz
        total += weight
        height -= weight * dot(nx, ny, nz, dx, dy, dz)
    sums[0, 0], sums[0, 1], sums[0, 2], sums[0, 3], sums[0, 4], sums[0, 5] = mx, my, mz, px, py, pz
    sums[0, 6], sums[0, 7], sums[1, 6] = total, height, 0.0
    first = _over_sheet(sums, 0)
    bend = _bend_below(points, normals, x, y, z, near, i, sums, weights)
    sums[0, 7] += 2.0 * bend * sums[0, 6]
    return first + bend


@inner
def _over_sheet(sums, c):
    """Turn the sums of a sheet into its unit normal and its middle; return the place's distance over it."""
    length = norm(sums[c, 0], sums[c, 1], sums[c, 2])
    turn = 1.0 / length if length > 0.0 else 0.0
    mean = 1.0 / sums[c, 6] if sums[c, 6] > 0.0 else 0.0
    for t in range(3):
        sums[c, t] *= turn
        sums[c, 3 + t] *= mean
    plane = -dot(sums[c, 0], sums[c, 1], sums[c, 2], sums[c, 3], sums[c, 4], sums[c, 5])
    return 0.5 * (sums[c, 7] * mean + plane)


@inner
def _bends(points, normals, near, i, lead, other):
    """Tell whether the steps to all surfels from two of them lie on arcs of circles, as on a sheet that bends.

    At an edge steps between surfels that are not equally far from it lie off by the difference, times the sine.
    """
    for one in (lead, other):
        px, py, pz = points[one, 0], points[one, 1], points[one, 2]
        nx, ny, nz = normals[one, 0], normals[one, 1], normals[one, 2]
        for a in range(near.shape[1]):
            j = near[i, a]
            mx, my, mz = normals[j, 0], normals[j, 1], normals[j, 2]
            dx, dy, dz = points[j, 0] - px, points[j, 1] - py, points[j, 2] - pz
            off = dot(dx, dy, dz, nx + mx, ny + my, nz + mz)
            cosine = dot(nx, ny, nz, mx, my, mz)
            allowed = OFF_ARC * OFF_ARC * max(1.0 - cosine * cosine, 1.0 - ALIKE * ALIKE)
            if off * off > allowed * dot(dx, dy, dz, dx, dy, dz):
                return False
    return True


@inner
def _bend_below(points, normals, x, y, z, near, i, sums, weights):
    """Return how far a sheet lies below its mean height where the middle of its surfels is not below the place.

    With the offset t of the place from the middle, along the sheet, that is k t^2 / 2; how the normals turn along t
    tells the curvature k.
    """
    up = dot(sums[0, 0], sums[0, 1], sums[0, 2], sums[0, 3], sums[0, 4], sums[0, 5])
    tx, ty, tz = up * sums[0, 0] - sums[0, 3], up * sums[0, 1] - sums[0, 4], up * sums[0, 2] - sums[0, 5]
    turns = steps = 0.0
    mx, my, mz = sums[0, 3], sums[0, 4], sums[0, 5]
    for a in range(near.shape[1]):
        j, weight = near[i, a], weights[a]
        dx, dy, dz = points[j, 0] - x - mx, points[j, 1] - y - my, points[j, 2] - z - mz
        step = dot(dx, dy, dz, tx, ty, tz)
        turns += weight * step * dot(normals[j, 0], normals[j, 1], normals[j, 2], tx, ty, tz)
        steps += weight * step * step
    if steps <= 0.0:
        return 0.0
    length = norm(tx, ty, tz)
    most = 0.5 * length
    return min(max(0.5 * turns / steps * length * length, -most), most)
