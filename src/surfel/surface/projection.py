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
    counts: NDArray[np.int32],
    *,
    alike: float = 0.8,
) -> tuple[Floats, Floats, Floats]:
    """Move points along their normals onto a quadric fitted to their neighbours with Gaussian weights.

    The width of the Gaussian is half the distance to the farthest of the neighbours that are taken. Neighbours whose
    normal makes ``|cos| < alike`` with the point's own are left out of its fit, so that an edge is not rounded.

    Parameters
    ----------
    points, normals : Floats, shape (n, 3)
        Coordinates and unit normals of either sign.
    chosen : NDArray[np.int32], shape (m,)
        Which points to move.
    neighbours : NDArray[np.int32], shape (m, k)
        Their nearest neighbours, ascending by distance.
    counts : NDArray[np.int32], shape (m,)
        How many of them the fit of each point takes.
    alike : float
        Least absolute cosine between the normals of a point and of a neighbour that takes part.

    Returns
    -------
    points, normals : Floats, shape (m, 3)
        On the fitted quadrics.
    bend : Floats, shape (m,)
        Sum of the principal curvatures of these, of either sign.
    """
    moved, turned, bend = np.empty((len(chosen), 3)), np.empty((len(chosen), 3)), np.empty(len(chosen))
    with threads_for(len(chosen) * neighbours.shape[1]):
        chunks = (len(chosen) + _CHUNK - 1) // _CHUNK
        _project(chunks, points, normals, chosen, neighbours, counts, alike, moved, turned, bend)
    return moved, turned, bend


@rows
def _project(begin, end, points, normals, chosen, neighbours, counts, alike, moved, turned, bend):
    m = len(chosen)
    matrix, right = np.empty((6, 6)), np.empty(6)
    for row in range(begin * _CHUNK, min(m, end * _CHUNK)):
        i, k = chosen[row], counts[row]
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        ex, ey, ez, fx, fy, fz = tangent_frame(nx, ny, nz)
        last = neighbours[row, k - 1]
        x, y, z = points[last, 0] - px, points[last, 1] - py, points[last, 2] - pz
        width = 0.5 * math.sqrt(x * x + y * y + z * z)
        inverse = 1.0 / width if width > 0.0 else 0.0
        # Sums of weight u^a v^b, and of weight u^a v^b w; the point itself lies at the origin with weight 1.
        s00, s10, s01, s20, s11, s02 = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
        s30 = s21 = s12 = s03 = s40 = s31 = s22 = s13 = s04 = 0.0
        t00 = t10 = t01 = t20 = t11 = t02 = 0.0
        count = 0
        for a in range(k):
            j = neighbours[row, a]
            if abs(normals[j, 0] * nx + normals[j, 1] * ny + normals[j, 2] * nz) < alike:
                continue
            x, y, z = points[j, 0] - px, points[j, 1] - py, points[j, 2] - pz
            u = (x * ex + y * ey + z * ez) * inverse
            v = (x * fx + y * fy + z * fz) * inverse
            w = x * nx + y * ny + z * nz
            uu, uv, vv = u * u, u * v, v * v
            g = math.exp(-0.5 * (uu + vv))
            count += 1
            s00 += g
            s10 += g * u
            s01 += g * v
            t00 += g * w
            t10 += g * u * w
            t01 += g * v * w
            guu, guv, gvv = g * uu, g * uv, g * vv
            s20 += guu
            s11 += guv
            s02 += gvv
            t20 += guu * w
            t11 += guv * w
            t02 += gvv * w
            s30 += guu * u
            s21 += guu * v
            s12 += gvv * u
            s03 += gvv * v
            s40 += guu * uu
            s31 += guu * uv
            s22 += guu * vv
            s13 += gvv * uv
            s04 += gvv * vv
        if count < _LEAST:
            moved[row, 0], moved[row, 1], moved[row, 2] = px, py, pz
            turned[row, 0], turned[row, 1], turned[row, 2] = nx, ny, nz
            bend[row] = 0.0
            continue
        ridge = 1e-9 * s00
        matrix[0, 0] = s00 + ridge
        matrix[1, 0], matrix[1, 1] = s10, s20 + ridge
        matrix[2, 0], matrix[2, 1], matrix[2, 2] = s01, s11, s02 + ridge
        matrix[3, 0], matrix[3, 1], matrix[3, 2], matrix[3, 3] = s20, s30, s21, s40 + ridge
        matrix[4, 0], matrix[4, 1], matrix[4, 2], matrix[4, 3] = s11, s21, s12, s31
        matrix[4, 4] = s22 + 0.5 * ridge  # half for uv: turning the frame changes nothing
        matrix[5, 0], matrix[5, 1], matrix[5, 2], matrix[5, 3], matrix[5, 4] = s02, s12, s03, s22, s13
        matrix[5, 5] = s04 + ridge
        right[0], right[1], right[2], right[3], right[4], right[5] = t00, t10, t01, t20, t11, t02
        solve_spd(matrix, right)
        moved[row, 0], moved[row, 1], moved[row, 2] = px + right[0] * nx, py + right[0] * ny, pz + right[0] * nz
        bend[row] = 2.0 * (right[3] + right[5]) * inverse * inverse
        su, sv = right[1] * inverse, right[2] * inverse
        tx, ty, tz = nx - su * ex - sv * fx, ny - su * ey - sv * fy, nz - su * ez - sv * fz
        length = 1.0 / math.sqrt(tx * tx + ty * ty + tz * tz)
        turned[row, 0], turned[row, 1], turned[row, 2] = tx * length, ty * length, tz * length
