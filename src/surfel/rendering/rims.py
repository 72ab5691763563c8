"""Rims: where the surface ends, disks are cut by the lines between its outermost points."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel._vec import tangent_frame
from surfel.core.cast import Booleans, Floats
from surfel.index.neighbours import PointIndex

_MOST = 4  # planes for each disk, the nearest ones
_ALIKE = 0.2  # least cosine of normals of points of one sheet
_WIDE = 128  # neighbours that are asked whether the surface ends; beyond a slit it goes on
_EMPTY, _MOST_EMPTY = 2.2, 5.5  # radians: the sector without any of them, where it does; wires have two, or a wider one
_FEW = 8  # points at least: fewer show no surface


def rim_planes(
    index: PointIndex, normals: Floats, radii: Floats, near: NDArray[np.int32], opened: Booleans
) -> tuple[NDArray[np.int64], Floats]:
    """Return the planes that cut disks where the surface ends, as compressed rows.

    Of each outermost surfel the two neighbours are taken between which there are none. Where these and the surfel make
    a convex corner, its disk ends at the lines to both; else at a line across the middle of what is empty. So do the
    disks of those nearby that reach over these lines from within.

    Parameters
    ----------
    index : PointIndex
        Of the points.
    normals : Floats, shape (n, 3)
        Unit vectors.
    radii : Floats, shape (n,)
        Of the disks.
    near : NDArray[np.int32], shape (n, k)
        The neighbours of each surfel.
    opened : Booleans, shape (n,)
        Which surfels may be outermost.
    """
    n = len(radii)
    sides, planes = np.zeros(n, np.int64), np.empty((n, 2, 3))
    chosen = np.flatnonzero(opened).astype(np.int32)
    counts, found = np.zeros(n, np.int64), np.empty((n, _MOST, 4))
    if len(chosen) and n > _FEW:
        wide = index.knn(min(_WIDE, n - 1), chosen)[1]
        with threads_for(16 * len(chosen)):
            _find(len(chosen), chosen, index.points, normals, wide, sides, planes)
    with threads_for(4 * n):
        _share(n, index.points, normals, radii, near, sides, planes, counts, found)
    return np.concatenate([[0], np.cumsum(counts)]), found[np.arange(_MOST) < counts[:, None]]


@rows
def _find(first, last, chosen, points, normals, near, sides, planes):
    """Write how many planes end the surface at each chosen surfel, none to two, and their normals, outward."""
    k = near.shape[1]
    angle = np.empty(k)
    for c in range(first, last):
        i = chosen[c]
        ux, uy, uz, vx, vy, vz = tangent_frame(normals[i, 0], normals[i, 1], normals[i, 2])
        for a in range(k):
            j = near[c, a]
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            angle[a] = math.atan2(dx * vx + dy * vy + dz * vz, dx * ux + dy * uy + dz * uz)
        order = np.sort(angle)
        widest, start, second = order[0] + 2.0 * math.pi - order[k - 1], order[k - 1], 0.0
        for a in range(k - 1):
            sector = order[a + 1] - order[a]
            if sector > widest:
                widest, start, second = sector, order[a], widest
            else:
                second = max(second, sector)
        if widest < _EMPTY or second > _EMPTY or widest > _MOST_EMPTY:
            continue
        if widest >= math.pi:
            sides[i] = 2
            one, other = start + 0.5 * math.pi, start + widest - 0.5 * math.pi
        else:
            sides[i] = 1
            one = other = start + 0.5 * widest
        for s in range(2):
            turn = one if s == 0 else other
            x, y = math.cos(turn), math.sin(turn)
            planes[i, s, 0], planes[i, s, 1], planes[i, s, 2] = x * ux + y * vx, x * uy + y * vy, x * uz + y * vz


@rows
def _share(first, last, points, normals, radii, near, sides, planes, counts, found):
    """Write the nearest planes that each disk reaches over from within."""
    for i in range(first, last):
        for a in range(-1, near.shape[1]):
            j = i if a < 0 else near[i, a]
            if sides[j] == 0:
                continue
            alike = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
            if alike < _ALIKE:
                continue
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            for s in range(sides[j]):
                x, y, z = planes[j, s, 0], planes[j, s, 1], planes[j, s, 2]
                d = x * dx + y * dy + z * dz
                if d < 0.0 or d >= radii[i]:
                    continue
                spot = counts[i] if counts[i] < _MOST else _MOST - 1
                if counts[i] == _MOST and d >= found[i, spot, 3]:
                    continue
                while spot > 0 and found[i, spot - 1, 3] > d:
                    found[i, spot] = found[i, spot - 1]
                    spot -= 1
                found[i, spot, 0], found[i, spot, 1], found[i, spot, 2], found[i, spot, 3] = x, y, z, d
                counts[i] = min(counts[i] + 1, _MOST)
