"""Projection onto a moving-least-squares surface that keeps edges: how noise is taken off points."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel._vec import tangent_frame
from surfel.core.cast import Floats
from surfel.surface.planes import solve_spd

_CHUNK = 64
_LEAST = 6  # with fewer neighbours alike the quadric would follow their noise: the point stays where it is


def project(
    points: Floats,
    normals: Floats,
    chosen: NDArray[np.int32],
    neighbours: NDArray[np.int32],
    *,
    alike: float = 0.8,
) -> tuple[Floats, Floats]:
    """Move points along their normals onto a quadric fitted to their neighbours with Gaussian weights.

    The width of the Gaussian is half the distance to the farthest neighbour. Neighbours whose normal makes
    ``|cos| < alike`` with the point's own are left out of its fit, so that an edge is not rounded.

    Parameters
    ----------
    points, normals : Floats, shape (n, 3)
        Coordinates and unit normals of either sign.
    chosen : NDArray[np.int32], shape (m,)
        Which points to move.
    neighbours : NDArray[np.int32], shape (m, k)
        Their nearest neighbours, ascending by distance.
    alike : float
        Least absolute cosine between the normals of a point and of a neighbour that takes part.

    Returns
    -------
    points, normals : Floats, shape (m, 3)
        On the fitted quadrics.
    """
    moved, turned = np.empty((len(chosen), 3)), np.empty((len(chosen), 3))
    with threads_for(len(chosen) * neighbours.shape[1] // 8):
        chunks = (len(chosen) + _CHUNK - 1) // _CHUNK
        _project(chunks, points, normals, chosen, neighbours, alike, moved, turned)
    return moved, turned


@rows
def _project(begin, end, points, normals, chosen, neighbours, alike, moved, turned):
    m, k = neighbours.shape
    for chunk in range(begin, end):
        matrix, right, f = np.empty((6, 6)), np.empty(6), np.empty(6)
        for row in range(chunk * _CHUNK, min(m, chunk * _CHUNK + _CHUNK)):
            i = chosen[row]
            px, py, pz = points[i, 0], points[i, 1], points[i, 2]
            nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
            e = tangent_frame(nx, ny, nz)
            last = neighbours[row, k - 1]
            x, y, z = points[last, 0] - px, points[last, 1] - py, points[last, 2] - pz
            width = 0.5 * math.sqrt(x * x + y * y + z * z)
            inverse = 1.0 / width if width > 0.0 else 0.0
            matrix[:, :] = 0.0
            right[:] = 0.0
            weights, count = 1.0, 0
            f[0], f[1], f[2], f[3], f[4], f[5] = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
            matrix[0, 0] = 1.0  # the point itself, at height 0
            for a in range(k):
                j = neighbours[row, a]
                if abs(normals[j, 0] * nx + normals[j, 1] * ny + normals[j, 2] * nz) < alike:
                    continue
                x, y, z = points[j, 0] - px, points[j, 1] - py, points[j, 2] - pz
                u = (x * e[0] + y * e[1] + z * e[2]) * inverse
                v = (x * e[3] + y * e[4] + z * e[5]) * inverse
                w = x * nx + y * ny + z * nz
                g = math.exp(-0.5 * (u * u + v * v))
                weights += g
                count += 1
                f[1], f[2], f[3], f[4], f[5] = u, v, u * u, u * v, v * v
                for p in range(6):
                    gf = g * f[p]
                    right[p] += gf * w
                    for q in range(p + 1):
                        matrix[p, q] += gf * f[q]
            if count < _LEAST:
                moved[row, 0], moved[row, 1], moved[row, 2] = px, py, pz
                turned[row, 0], turned[row, 1], turned[row, 2] = nx, ny, nz
                continue
            for p in range(6):
                matrix[p, p] += (0.5e-9 if p == 4 else 1e-9) * weights  # uv half: turning e changes nothing
            solve_spd(matrix, right)
            moved[row, 0], moved[row, 1], moved[row, 2] = px + right[0] * nx, py + right[0] * ny, pz + right[0] * nz
            su, sv = right[1] * inverse, right[2] * inverse
            tx, ty, tz = nx - su * e[0] - sv * e[3], ny - su * e[1] - sv * e[4], nz - su * e[2] - sv * e[5]
            length = 1.0 / math.sqrt(tx * tx + ty * ty + tz * tz)
            turned[row, 0], turned[row, 1], turned[row, 2] = tx * length, ty * length, tz * length
