"""Bends: how strongly the surface curves at each surfel, so that flat disks do not stick out over a silhouette."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel._vec import tangent_frame
from surfel.core.cast import Floats

_SAME_SHEET = 0.7
_ROUND = 0.0
_MOST = 2.0  # over the radius of the disk


def bends_of(
    points: Floats, normals: Floats, radii: Floats, near: NDArray[np.int32], rounded: NDArray[np.bool_]
) -> Floats:
    """Return the larger principal curvature at each surfel, where it is convex; zero elsewhere.

    The symmetric operator that takes steps along the surface to changes of the normal is fitted to the neighbours on
    the same sheet by least squares.

    Parameters
    ----------
    points, normals : Floats, shape (n, 3)
        The surfels.
    radii : Floats, shape (n,)
        Of their disks.
    near : NDArray[np.int32], shape (n, k)
        Their neighbours.
    rounded : NDArray[np.bool_], shape (n,)
        Which lie on an edge that is round, not sharp, so that all neighbours are on one sheet.
    """
    bends = np.zeros(len(points))
    with threads_for(2 * len(points)):
        _fit(len(points), points, normals, radii, near, rounded, bends)
    return bends


@rows
def _fit(first, last, points, normals, radii, near, rounded, bends):
    for i in range(first, last):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        ex, ey, ez, fx, fy, fz = tangent_frame(nx, ny, nz)
        least = _ROUND if rounded[i] else _SAME_SHEET
        aa = ab = bb = am = bm = ak = bk = 0.0
        for c in range(near.shape[1]):
            j = near[i, c]
            if normals[j, 0] * nx + normals[j, 1] * ny + normals[j, 2] * nz < least:
                continue
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            tx, ty, tz = normals[j, 0] - nx, normals[j, 1] - ny, normals[j, 2] - nz
            a, b = dx * ex + dy * ey + dz * ez, dx * fx + dy * fy + dz * fz
            m, k = tx * ex + ty * ey + tz * ez, tx * fx + ty * fy + tz * fz
            aa += a * a
            ab += a * b
            bb += b * b
            am += a * m
            bm += b * m
            ak += a * k
            bk += b * k
        # aa x + ab y = am, ab x + (aa + bb) y + ab z = bm + ak, ab y + bb z = bk
        if not (aa > 0.0 and bb > 0.0):
            continue
        rest = aa + bb - ab * ab / aa - ab * ab / bb
        if not rest > 1e-6 * (aa + bb):
            continue
        y = (bm + ak - ab * am / aa - ab * bk / bb) / rest
        x, z = (am - ab * y) / aa, (bk - ab * y) / bb
        largest = 0.5 * (x + z) + math.sqrt(0.25 * (x - z) * (x - z) + y * y)
        bends[i] = min(max(largest, 0.0), _MOST / radii[i])
