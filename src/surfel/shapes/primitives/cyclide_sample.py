"""Points of a Dupin ring cyclide, spread evenly over its surface.

A point of the surface has an angle q round the axis of the ring and an angle p round the tube, both along lines of
curvature. With k = c cos q the element of area is

    dA = b^2 (a - d cos p) (d - c cos q) / (a - k cos p)^2 dp dq.

Round the tube the substitution cos p = (cos E + s) / (1 + s cos E), s = k / a, makes it even in E - f sin E with
f = (a d - a k) / (a^2 - d k): Kepler's equation. Round the ring, what is left is tabulated.
"""

from __future__ import annotations

import math

import numpy as np

from surfel._numba import inlined, rows, threads_for
from surfel.core.cast import Floats

_CELLS = 512
_STEPS = 60


def sample_cyclide(uv: Floats, a: float, b: float, d: float) -> tuple[Floats, Floats, Floats]:
    """Return points, outward unit normals and areas for points of the unit square.

    The areas are what the map does to the square, so that their sum is right on average whatever the points are.

    Parameters
    ----------
    uv : Floats, shape (n, 2)
        In [0, 1).
    a, b, d : float
        As in :class:`~surfel.Cyclide`; a torus has a = b.
    """
    c = math.sqrt((a - b) * (a + b))
    turns = np.linspace(0.0, 2.0 * np.pi, _CELLS + 1)
    density = _density(turns, a, b, c, d)
    ends = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    ends /= ends[-1]
    n = len(uv)
    points, normals = np.empty((n, 3)), np.empty((n, 3))
    turn = np.interp(uv[:, 0], ends, turns)
    with threads_for(16 * n):
        _place(n, turn, uv[:, 1].copy(), a, b, c, d, points, normals)
    cell = np.minimum(np.searchsorted(ends, uv[:, 0], side="right"), _CELLS) - 1
    areas = _density(turn, a, b, c, d) * (turns[1] / np.diff(ends)[cell]) / max(n, 1)
    return points, normals, areas


def _density(turn: Floats, a: float, b: float, c: float, d: float) -> Floats:
    """Return the area of the ring for a small turn of it, over that turn.

    The turn is the angle about the point (c d / a, 0) in the plane of the ring, tan turn = (a / b) tan q.
    """
    cos, sin = a * np.cos(turn), b * np.sin(turn)
    k = c * cos / np.hypot(cos, sin)
    return np.asarray(2.0 * np.pi * (b / a) * (a * a - d * k) * (d - k) / np.sqrt((a - k) * (a + k)))


@rows
def _place(first, last, turn, v, a, b, c, d, points, normals):
    for i in range(first, last):
        cos_q, sin_q = a * math.cos(turn[i]), b * math.sin(turn[i])
        length = math.hypot(cos_q, sin_q)
        cos_q, sin_q = cos_q / length, sin_q / length
        k = c * cos_q
        s = k / a
        angle = _eccentric(2.0 * math.pi * v[i], a * (d - k) / (a * a - d * k))
        cos_e = math.cos(angle)
        cos_p = (cos_e + s) / (1.0 + s * cos_e)
        sin_p = math.sqrt((1.0 - s) * (1.0 + s)) * math.sin(angle) / (1.0 + s * cos_e)
        scale = 1.0 / (a - k * cos_p)
        nx, ny, nz = (c - a * cos_q * cos_p) * scale, -b * sin_q * cos_p * scale, -b * sin_p * scale
        scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
        normals[i, 0], normals[i, 1], normals[i, 2] = nx * scale, ny * scale, nz * scale
        radius = d - k
        points[i, 0] = a * cos_q + radius * normals[i, 0]
        points[i, 1] = b * sin_q + radius * normals[i, 1]
        points[i, 2] = radius * normals[i, 2]


@inlined
def _eccentric(mean, f):
    """Solve Kepler's equation E - f sin E = mean for 0 <= mean < 2 pi and 0 <= f < 1.

    In the first half the left side is convex and its steps come from above, so Newton's never pass the solution.
    """
    turned = mean > math.pi
    m = 2.0 * math.pi - mean if turned else mean
    angle = min(m + f, m / (1.0 - f), math.pi)
    for _ in range(_STEPS):
        step = (angle - f * math.sin(angle) - m) / (1.0 - f * math.cos(angle))
        angle -= step
        if step <= 1e-15 * angle:
            break
    return 2.0 * math.pi - angle if turned else angle
