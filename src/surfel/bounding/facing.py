"""Lines over the grid of a spline, and how they face it where they meet it."""

from __future__ import annotations

import numpy as np

from surfel._numba import rows, threads_for
from surfel.bounding.evaluate import cell_of
from surfel.bounding.frame import Frame, project
from surfel.bounding.lanes import cell_slopes
from surfel.bounding.rays import Hits
from surfel.core.cast import Floats


def in_domain(origins: Floats, directions: Floats, frame: Frame) -> tuple[Floats, Floats]:
    """Return origins and directions in domain coordinates, shape (m, 3) each: two in cells, then the height.

    Places t steps along are the same in both.
    """
    placed, turned = np.empty((len(origins), 3)), np.empty((len(origins), 3))
    with threads_for(len(origins)):
        _in_domain(len(origins), np.array(origins), np.array(directions), frame.numbers(), placed, turned)
    return placed, turned


def cosines(coefficients: Floats, origins: Floats, directions: Floats, hits: Hits, axes: Floats, side: float) -> Floats:
    """Return the cosines between lines and the normals where they meet a spline.

    Parameters
    ----------
    coefficients : Floats, shape (n + 2, m + 2)
        Of the spline.
    origins, directions : Floats, shape (m, 3)
        In domain coordinates.
    hits : Hits
        Of the lines.
    axes : Floats, shape (3, 3)
        The normal is ``F_u axes[0] + F_v axes[1] + axes[2]``, where lines are of unit length.
    side : float
        -1 where normals point against the heights.

    Returns
    -------
    Floats, shape (k,)
        For every hit.
    """
    out = np.empty(len(hits.t))
    with threads_for(len(out)):
        _cosines(len(origins), np.array(coefficients), origins, directions, *hits, np.array(axes), float(side), out)
    return out


@rows
def _in_domain(first, last, p, d, f, placed, turned):
    for i in range(first, last):
        placed[i, 0], placed[i, 1], placed[i, 2] = project(f, p[i, 0], p[i, 1], p[i, 2])
        turned[i, 0] = (f[0] * d[i, 0] + f[1] * d[i, 1] + f[2] * d[i, 2]) * f[11]
        turned[i, 1] = (f[3] * d[i, 0] + f[4] * d[i, 1] + f[5] * d[i, 2]) * f[12]
        turned[i, 2] = f[6] * d[i, 0] + f[7] * d[i, 1] + f[8] * d[i, 2]


@rows
def _cosines(first, last, b, origins, directions, offsets, t, axes, side, out):
    n, m = b.shape[0] - 3, b.shape[1] - 3
    ux, uy, uz = axes[0, 0] / 36.0, axes[0, 1] / 36.0, axes[0, 2] / 36.0
    vx, vy, vz = axes[1, 0] / 36.0, axes[1, 1] / 36.0, axes[1, 2] / 36.0
    wx, wy, wz = axes[2, 0], axes[2, 1], axes[2, 2]
    for line in range(first, last):
        du, dv, dw = directions[line, 0], directions[line, 1], directions[line, 2]
        for i in range(offsets[line], offsets[line + 1]):
            u = min(max(origins[line, 0] + t[i] * du, 0.0), float(n))
            v = min(max(origins[line, 1] + t[i] * dv, 0.0), float(m))
            h, k = cell_of(u, n), cell_of(v, m)
            f_u, f_v = cell_slopes(b, h, k, u - h, v - k)
            x, y, z = f_u * ux + f_v * vx + wx, f_u * uy + f_v * vy + wy, f_u * uz + f_v * vz + wz
            out[i] = side * (dw - (f_u * du + f_v * dv) / 36.0) / np.sqrt(x * x + y * y + z * z)
