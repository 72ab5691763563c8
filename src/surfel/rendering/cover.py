"""Cover: how far disks must reach so that they leave no hole between them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel._vec import tangent_frame
from surfel.core.cast import Booleans, Floats

_DIRECTIONS = 16
_FARTHEST = 2.0  # times the reach; where a cell goes on beyond this the surface ends, and nothing is to be covered
_BESIDE = 1.06  # the corner of a cell lies between two directions
_BEYOND = 1.1  # of what would do: less leaves holes between random points, more swells silhouettes


def covering_radii(points: Floats, normals: Floats, near: NDArray[np.int32], reach: Floats) -> tuple[Floats, Booleans]:
    """Return radii with which disks hold the farthest corner of their cells, at least ``reach``, and which are open.

    The cell of a surfel ends, in each of some directions in its plane, at the first of the lines midway to its
    neighbours. Points at random have cells far longer than their nearest neighbours tell.

    Parameters
    ----------
    points, normals : Floats, shape (n, 3)
        Of the cloud; the normals unit vectors.
    near : NDArray[np.int32], shape (n, k)
        The neighbours of each surfel.
    reach : Floats, shape (n,)
        Radii that disks have at least, and that surfels at a border keep.
    """
    radii, opened = reach.copy(), np.zeros(len(points), np.bool_)
    angle = np.arange(_DIRECTIONS) * (2.0 * math.pi / _DIRECTIONS)
    with threads_for(4 * len(points)):
        _cover(len(points), points, normals, near, np.cos(angle), np.sin(angle), radii, opened)
    return radii, opened


@rows
def _cover(first, last, points, normals, near, cosines, sines, radii, opened):
    k = near.shape[1]
    across, along, half = np.empty(k), np.empty(k), np.empty(k)
    for i in range(first, last):
        ux, uy, uz, vx, vy, vz = tangent_frame(normals[i, 0], normals[i, 1], normals[i, 2])
        for m in range(k):
            j = near[i, m]
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
