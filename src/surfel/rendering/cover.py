"""Cover: how far disks must reach so that they leave no hole between them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel._vec import tangent_frame
from surfel.core.cast import Booleans, Floats
from surfel.index.neighbours import PointIndex

_DIRECTIONS = 16
_FARTHEST = 2.0  # times the reach; where a cell goes on beyond this the surface ends, and nothing is to be covered
_WIDE = 48  # neighbours by which those are asked again that seem to lie where it ends
_BESIDE = 1.06  # the corner of a cell lies between two directions
_BEYOND = 1.1  # of what would do: less leaves holes between random points, more swells silhouettes


def covering_radii(
    index: PointIndex, normals: Floats, near: NDArray[np.int32], reach: Floats
) -> tuple[Floats, Booleans]:
    """Return radii with which disks hold the farthest corner of their cells, at least ``reach``, and which are open.

    The cell of a surfel ends, in each of some directions in its plane, at the first of the lines midway to its
    neighbours. Points at random have cells far longer than their nearest neighbours tell.

    Parameters
    ----------
    index : PointIndex
        Of the points.
    normals : Floats, shape (n, 3)
        Unit vectors.
    near : NDArray[np.int32], shape (n, k)
        The neighbours of each surfel.
    reach : Floats, shape (n,)
        Radii that disks have at least, and that surfels at a border keep.
    """
    radii, opened = reach.copy(), np.zeros(len(reach), np.bool_)
    angle = np.arange(_DIRECTIONS) * (2.0 * math.pi / _DIRECTIONS)
    everyone = np.arange(len(reach), dtype=np.int32)
    with threads_for(4 * len(reach)):
        _cover(len(reach), everyone, index.points, normals, near, np.cos(angle), np.sin(angle), radii, opened)
    unsure = everyone[opened]  # in a clump the nearest may lie on one side; borders are looked for among all of these
    if len(unsure) and len(reach) > near.shape[1] + 1:
        wide = index.knn(min(_WIDE, len(reach) - 1), unsure)[1]
        with threads_for(16 * len(unsure)):
            _cover(len(unsure), unsure, index.points, normals, wide, np.cos(angle), np.sin(angle), radii, opened.copy())
    return radii, opened


@rows
def _cover(first, last, chosen, points, normals, near, cosines, sines, radii, opened):
    k = near.shape[1]
    across, along, half = np.empty(k), np.empty(k), np.empty(k)
    for row in range(first, last):
        i = chosen[row]
        ux, uy, uz, vx, vy, vz = tangent_frame(normals[i, 0], normals[i, 1], normals[i, 2])
        for m in range(k):
            j = near[row, m]
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            across[m], along[m] = dx * ux + dy * uy + dz * uz, dx * vx + dy * vy + dz * vz
            half[m] = 0.5 * (across[m] * across[m] + along[m] * along[m])
        longest = 0.0
        for c in range(len(cosines)):
            end = math.inf
            for m in range(k):
                slope = across[m] * cosines[c] + along[m] * sines[c]
                if slope > 0.0 and half[m] < end * slope:
                    end = half[m] / slope
            longest = max(longest, end)
        opened[i] = longest > _FARTHEST * radii[i]
        if radii[i] < _BESIDE * longest <= _FARTHEST * radii[i]:
            radii[i] = _BEYOND * longest
