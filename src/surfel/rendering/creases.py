"""Creases: at a sharp convex edge of a cloud, disks are cut by the sheet on the other side."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.core.cast import Booleans, Floats

SPREAD = 0.7
"""Neighbours whose normals make a smaller cosine than this lie over a crease."""

_MOST = 4  # other sheets: three meet in a corner, and more round a large disk at the rim of a bent face
_ONE_SHEET = 0.85  # least cosine among the normals of one sheet; vertices on an edge have a normal between two
_ON_EDGE = 0.1  # over the radius: a surfel that lies no farther off the other sheet may lie on the edge itself
_BENT = 2  # so many of them make both sheets one that is bent
_FEW = 2  # surfels that agree make a sheet; a single one may be a stray


def crease_planes(
    points: Floats, normals: Floats, radii: Floats, near: NDArray[np.int32], kept: float
) -> tuple[Booleans, NDArray[np.int64], Floats]:
    """Return which surfels lie near a crease, and the planes that cut their disks there, as compressed rows.

    Where some of the nearest surfels of a disk lie on other sheets, and such a sheet meets the disk's own in a convex
    edge, the disk ends at it. What lies on it is told by the nearest surfel there and its own neighbours: near the disk
    there may be one alone. The height over it is the mean of those over the tangent planes and over the mean plane,
    which has no error of second order where the sheet is bent (:mod:`surfel.inside.sheets`).

    Parameters
    ----------
    points, normals : Floats, shape (n, 3)
        Of the cloud; the normals unit vectors.
    radii : Floats, shape (n,)
        Of the disks.
    near : NDArray[np.int32], shape (n, k)
        The neighbours of each surfel, the nearest first.
    kept : float
        How much of the radius of a disk is kept where the sheets are one that is bent.
    """
    n = len(radii)
    creased, counts = np.zeros(n, np.bool_), np.zeros(n, np.int64)
    found = np.empty((n, _MOST, 4))
    with threads_for(4 * n):
        _find(n, points, normals, radii, near, kept, creased, counts, found)
    chosen = np.arange(_MOST) < counts[:, None]
    return creased, np.concatenate([[0], np.cumsum(counts)]), found[chosen]


@rows
def _find(first, last, points, normals, radii, near, kept, creased, counts, found):
    taken = np.empty(near.shape[1], np.bool_)
    for i in range(first, last):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        taken[:] = False
        for a in range(near.shape[1]):
            j = near[i, a]
            cosine = normals[j, 0] * nx + normals[j, 1] * ny + normals[j, 2] * nz
            taken[a] = cosine >= _ONE_SHEET
            creased[i] = creased[i] or cosine < SPREAD
        for _ in range(_MOST):
            lead = -1
            for a in range(near.shape[1]):
                if not taken[a]:
                    lead = near[i, a]
                    break
            if lead < 0:
                break
            mx = my = mz = px = py = pz = total = height = 0.0
            number = 0
            nearest = -1.0
            lx, ly, lz = normals[lead, 0], normals[lead, 1], normals[lead, 2]
            between = 0
            for a in range(near.shape[1]):
                j = near[i, a]
                ax, ay, az = normals[j, 0], normals[j, 1], normals[j, 2]
                if ax * lx + ay * ly + az * lz < _ONE_SHEET:
                    continue
                taken[a] = True
                if ax * nx + ay * ny + az * nz >= _ONE_SHEET:
                    dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
                    ex, ey, ez = (
                        points[j, 0] - points[lead, 0],
                        points[j, 1] - points[lead, 1],
                        points[j, 2] - points[lead, 2],
                    )
                    below = dx * nx + dy * ny + dz * nz < 0.0 and ex * lx + ey * ly + ez * lz < 0.0
                    between += 1 if below else 0
            for a in range(-1, near.shape[1]):
                j = lead if a < 0 else near[lead, a]
                ax, ay, az = normals[j, 0], normals[j, 1], normals[j, 2]
                if ax * lx + ay * ly + az * lz < _ONE_SHEET:
                    continue
                dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
                square = dx * dx + dy * dy + dz * dz
                if nearest < 0.0:
                    nearest = square
                weight = math.exp(2.0 * (nearest - square) / (radii[i] * radii[i]))
                mx, my, mz = mx + weight * ax, my + weight * ay, mz + weight * az
                px, py, pz = px + weight * dx, py + weight * dy, pz + weight * dz
                height += weight * (ax * dx + ay * dy + az * dz)
                total += weight
                number += 1
            length = math.sqrt(mx * mx + my * my + mz * mz)
            if number < _FEW or not length > 0.0:
                continue
            mx, my, mz = mx / length, my / length, mz / length
            px, py, pz = px / total, py / total, pz / total
            # convex: each sheet lies below the other one; of a surfel on the edge that is hardly told
            over, under, slack = px * nx + py * ny + pz * nz, mx * px + my * py + mz * pz, _ON_EDGE * radii[i]
            if over > slack or under < -slack or under <= over:
                continue
            d = max(0.5 * (height / total + under), kept * radii[i] if between >= _BENT else 0.0)
            k = counts[i]
            found[i, k, 0], found[i, k, 1], found[i, k, 2], found[i, k, 3] = mx, my, mz, d
            counts[i] = k + 1
