"""Projection onto a moving-least-squares surface that keeps edges: how noise is taken off points."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel._vec import tangent_frame
from surfel.core.cast import Floats
from surfel.surface.quadric import gaussian, solve_quadric

_LANES = 8  # points that are fitted side by side, as one vector
_CHUNK = 8 * _LANES
_LEAST = 6  # with fewer neighbours alike the quadric would follow their noise: the point stays where it is


def project(
    points: Floats,
    normals: Floats,
    chosen: NDArray[np.int32],
    neighbours: NDArray[np.int32],
    counts: NDArray[np.int32],
    *,
    alike: float = 0.8,
    steep: float = math.inf,
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
    steep : float
        How far such a neighbour may lie off both planes together, in its distance; farther off is another sheet.

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
        _project(chunks, points, normals, chosen, neighbours, counts, alike, steep, moved, turned, bend)
    return moved, turned, bend


# What is kept of the eight, one row each: the place, the normal, the two tangents and what a length is multiplied by;
_POINT, _NORMAL, _FIRST, _SECOND, _INVERSE = 0, 3, 6, 9, 12
# the offset of a neighbour and its weight; sums of weight u^a v^b and of weight u^a v^b w; the answer; and the count.
_OFFSET, _WEIGHT, _SUMS, _LOADS, _FIT, _COUNT, _ROWS = 13, 16, 17, 32, 38, 42, 43


@rows
def _project(begin, end, points, normals, chosen, neighbours, counts, alike, steep, moved, turned, bend):
    m = len(chosen)
    b = np.empty((_ROWS, _LANES))
    for start in range(begin * _CHUNK, min(m, end * _CHUNK), _LANES):
        most = 0
        for lane in range(_LANES):
            row = min(start + lane, m - 1)  # lanes beyond the last point repeat it, and are not written
            i, k = chosen[row], counts[row]
            most = max(most, k)
            nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
            ex, ey, ez, fx, fy, fz = tangent_frame(nx, ny, nz)
            last = neighbours[row, k - 1]
            px, py, pz = points[i, 0], points[i, 1], points[i, 2]
            x, y, z = points[last, 0] - px, points[last, 1] - py, points[last, 2] - pz
            width = 0.5 * math.sqrt(x * x + y * y + z * z)
            b[_POINT, lane], b[_POINT + 1, lane], b[_POINT + 2, lane] = px, py, pz
            b[_NORMAL, lane], b[_NORMAL + 1, lane], b[_NORMAL + 2, lane] = nx, ny, nz
            b[_FIRST, lane], b[_FIRST + 1, lane], b[_FIRST + 2, lane] = ex, ey, ez
            b[_SECOND, lane], b[_SECOND + 1, lane], b[_SECOND + 2, lane] = fx, fy, fz
            b[_INVERSE, lane] = 1.0 / width if width > 0.0 else 0.0
        for q in range(_SUMS, _ROWS):
            for lane in range(_LANES):
                b[q, lane] = 0.0
        for lane in range(_LANES):
            b[_SUMS, lane] = 1.0  # the point itself lies at the origin with weight 1
        for a in range(most):
            for lane in range(_LANES):
                row = min(start + lane, m - 1)
                b[_OFFSET, lane] = b[_OFFSET + 1, lane] = b[_OFFSET + 2, lane] = b[_WEIGHT, lane] = 0.0
                if a >= counts[row]:
                    continue
                j = neighbours[row, a]
                mx, my, mz = normals[j, 0], normals[j, 1], normals[j, 2]
                nx, ny, nz = b[_NORMAL, lane], b[_NORMAL + 1, lane], b[_NORMAL + 2, lane]
                if abs(mx * nx + my * ny + mz * nz) < alike:
                    continue
                x, y, z = (
                    points[j, 0] - b[_POINT, lane],
                    points[j, 1] - b[_POINT + 1, lane],
                    points[j, 2] - b[_POINT + 2, lane],
                )
                off = abs(x * nx + y * ny + z * nz) + abs(x * mx + y * my + z * mz)
                if off * off > steep * steep * (x * x + y * y + z * z):
                    continue
                b[_OFFSET, lane], b[_OFFSET + 1, lane], b[_OFFSET + 2, lane] = x, y, z
                b[_WEIGHT, lane] = 1.0
                b[_COUNT, lane] += 1.0
            for lane in range(_LANES):
                x, y, z, inverse = b[_OFFSET, lane], b[_OFFSET + 1, lane], b[_OFFSET + 2, lane], b[_INVERSE, lane]
                u = (x * b[_FIRST, lane] + y * b[_FIRST + 1, lane] + z * b[_FIRST + 2, lane]) * inverse
                v = (x * b[_SECOND, lane] + y * b[_SECOND + 1, lane] + z * b[_SECOND + 2, lane]) * inverse
                w = x * b[_NORMAL, lane] + y * b[_NORMAL + 1, lane] + z * b[_NORMAL + 2, lane]
                uu, uv, vv = u * u, u * v, v * v
                g = gaussian(uu + vv) * b[_WEIGHT, lane]
                gu, gv, guu, guv, gvv = g * u, g * v, g * uu, g * uv, g * vv
                b[_SUMS, lane] += g
                b[_SUMS + 1, lane] += gu
                b[_SUMS + 2, lane] += gv
                b[_SUMS + 3, lane] += guu
                b[_SUMS + 4, lane] += guv
                b[_SUMS + 5, lane] += gvv
                b[_SUMS + 6, lane] += guu * u
                b[_SUMS + 7, lane] += guu * v
                b[_SUMS + 8, lane] += gvv * u
                b[_SUMS + 9, lane] += gvv * v
                b[_SUMS + 10, lane] += guu * uu
                b[_SUMS + 11, lane] += guu * uv
                b[_SUMS + 12, lane] += guu * vv
                b[_SUMS + 13, lane] += gvv * uv
                b[_SUMS + 14, lane] += gvv * vv
                b[_LOADS, lane] += g * w
                b[_LOADS + 1, lane] += gu * w
                b[_LOADS + 2, lane] += gv * w
                b[_LOADS + 3, lane] += guu * w
                b[_LOADS + 4, lane] += guv * w
                b[_LOADS + 5, lane] += gvv * w
        for lane in range(_LANES):
            height, su, sv, suu, _, svv = solve_quadric(
                b[_SUMS, lane], b[_SUMS + 1, lane], b[_SUMS + 2, lane], b[_SUMS + 3, lane], b[_SUMS + 4, lane],
                b[_SUMS + 5, lane], b[_SUMS + 6, lane], b[_SUMS + 7, lane], b[_SUMS + 8, lane], b[_SUMS + 9, lane],
                b[_SUMS + 10, lane], b[_SUMS + 11, lane], b[_SUMS + 12, lane], b[_SUMS + 13, lane],
                b[_SUMS + 14, lane], b[_LOADS, lane], b[_LOADS + 1, lane], b[_LOADS + 2, lane], b[_LOADS + 3, lane],
                b[_LOADS + 4, lane], b[_LOADS + 5, lane],
            )  # fmt: skip
            inverse = b[_INVERSE, lane]
            b[_FIT, lane], b[_FIT + 1, lane], b[_FIT + 2, lane] = height, su * inverse, sv * inverse
            b[_FIT + 3, lane] = 2.0 * (suu + svv) * inverse * inverse
        for lane in range(min(_LANES, m - start)):
            row = start + lane
            px, py, pz = b[_POINT, lane], b[_POINT + 1, lane], b[_POINT + 2, lane]
            nx, ny, nz = b[_NORMAL, lane], b[_NORMAL + 1, lane], b[_NORMAL + 2, lane]
            if b[_COUNT, lane] < _LEAST:
                moved[row, 0], moved[row, 1], moved[row, 2] = px, py, pz
                turned[row, 0], turned[row, 1], turned[row, 2] = nx, ny, nz
                bend[row] = 0.0
                continue
            height, su, sv = b[_FIT, lane], b[_FIT + 1, lane], b[_FIT + 2, lane]
            moved[row, 0], moved[row, 1], moved[row, 2] = px + height * nx, py + height * ny, pz + height * nz
            bend[row] = b[_FIT + 3, lane]
            tx = nx - su * b[_FIRST, lane] - sv * b[_SECOND, lane]
            ty = ny - su * b[_FIRST + 1, lane] - sv * b[_SECOND + 1, lane]
            tz = nz - su * b[_FIRST + 2, lane] - sv * b[_SECOND + 2, lane]
            length = 1.0 / math.sqrt(tx * tx + ty * ty + tz * tz)
            turned[row, 0], turned[row, 1], turned[row, 2] = tx * length, ty * length, tz * length
