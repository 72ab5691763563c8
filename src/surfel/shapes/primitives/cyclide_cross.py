"""Where lines cross a Dupin ring cyclide, of which the torus is one: a quartic for every line.

The solid is the union of balls with their centres (a cos q, b sin q, 0) on an ellipse and radii d - c cos q. A point is
nearest to the ball with (cos q, sin q) along (a x - c d, b y); with its centre m and radius r there, inside is where

    G = |x - m|^2 - r^2 < 0.

G is the quartic divided by a factor that is positive everywhere, but it is a difference of like lengths near the
surface only, so it keeps its digits also where the tube is thin. The quartic itself is used for what it does
best: between its stationary points, which a closed form gives, there is at most one root.
"""

from __future__ import annotations

import math

import numpy as np

from surfel._numba import inlined, rows, threads_for
from surfel.core.cast import Floats
from surfel.core.crossings import Crossings
from surfel.core.lines import Lines
from surfel.roots.quartic import stationary_points
from surfel.shapes.primitives.approach import approach
from surfel.shapes.primitives.gather import gather, readable

_REACH = 64.0  # sizes from which the way to the solid is summed with its rounding errors
_WORK = 16  # a line is as much work as this many items of a simple loop
_STEPS = 80
_MARGIN = 1.0 + 1e-6
_SETTLED = 1e-8  # of the tube's least radius: after a Newton step as short as this what is left is its square


def cross_cyclide(lines: Lines, inverse: Floats, a: float, b: float, d: float) -> Crossings:
    """Return the events of every line with the ring cyclide of half-axes a, b and mean tube radius d.

    Parameters
    ----------
    lines : Lines
        In the world.
    inverse : Floats, shape (3, 4)
        From the world to the frame of the cyclide.
    a, b, d : float
        As in :class:`~surfel.Cyclide`; a torus has a = b.
    """
    size = a + d
    m = len(lines)
    counts, t, cosine = np.empty(m, np.int32), np.empty((m, 4)), np.empty((m, 4))
    c = math.sqrt((a - b) * (a + b))
    tube = np.array([a / size, b / size, c / size, d / size])
    with threads_for(_WORK * m):
        _cross(m, inverse / size, tube, *readable(lines), counts, t, cosine)
    return gather(counts, t, cosine)


@rows
def _cross(first, last, inverse, tube, origins, directions, counts, t, cosine):
    ring = tube[0], tube[1], tube[2], tube[3]
    for line in range(first, last):
        dx, dy, dz = directions[line, 0], directions[line, 1], directions[line, 2]
        shift, x, y, z, ex, ey, ez = approach(
            inverse, _REACH, origins[line, 0], origins[line, 1], origins[line, 2], dx, dy, dz
        )
        speed = math.sqrt(ex * ex + ey * ey + ez * ez)
        ex, ey, ez = ex / speed, ey / speed, ez / speed
        low, high = _span(ring, x, y, z, ex, ey, ez)
        count = 0
        if low < high:
            stationary, s0, s1, s2 = _stationary(ring, x, y, z, ex, ey, ez)
            before, below = low, False
            for k in range(stationary + 1):
                place, now_below = high, False
                if k < stationary:
                    place = s0 if k == 0 else (s1 if k == 1 else s2)
                    if not low < place < high:
                        continue
                    now_below = _inside(ring, x + place * ex, y + place * ey, z + place * ez)[0] < 0.0
                if now_below != below:
                    inner, outer = (place, before) if now_below else (before, place)
                    s = _root(ring, inner, outer, x, y, z, ex, ey, ez)
                    _, nx, ny, nz = _inside(ring, x + s * ex, y + s * ey, z + s * ez)
                    t[line, count] = shift + s / speed
                    slope = _cosine(inverse, nx, ny, nz, dx, dy, dz)
                    cosine[line, count] = -slope if count % 2 == 0 else slope
                    count += 1
                before, below = place, now_below
        counts[line] = count


@inlined
def _span(ring, x, y, z, ex, ey, ez):
    """Return where the line is within the ball of radius a + d round (-c, 0, 0) and |z| <= d + c, that hold the solid.

    Both are a little larger, so that no hit is at an end.
    """
    _, _, c, d = ring
    along = (x + c) * ex + y * ey + z * ez
    rest = along * along - ((x + c) ** 2 + y * y + z * z - _MARGIN)
    if not rest > 0.0:
        return 0.0, 0.0
    reach = math.sqrt(rest)
    low, high = -along - reach, reach - along
    top = (d + c) * _MARGIN
    if abs(ez) * (abs(low) + abs(high)) > 1e-30:
        s, t = (-top - z) / ez, (top - z) / ez
        low, high = max(low, min(s, t)), min(high, max(s, t))
    elif abs(z) >= top:
        return 0.0, 0.0
    return low, high


@inlined
def _stationary(ring, x, y, z, ex, ey, ez):
    """Return the stationary points of (|p|^2 + b^2 - d^2)^2 - 4 (a x - c d)^2 - 4 b^2 y^2 along the line.

    The line starts where it is nearest to the centre; so the quartic has no cubic term.
    """
    a, b, c, d = ring
    k = x * x + y * y + z * z + (b - d) * (b + d)
    l0, l1, q0, q1 = a * x - c * d, a * ex, b * y, b * ey
    return stationary_points(2.0 * k - 4.0 * (l1 * l1 + q1 * q1), -8.0 * (l0 * l1 + q0 * q1))


@inlined
def _inside(ring, x, y, z):
    """Return G, negative inside, and half its gradient: the way from the centre of the ball that comes nearest."""
    a, b, c, d = ring
    across, beside = a * x - c * d, b * y
    length = math.sqrt(across * across + beside * beside)
    cos, sin = 1.0, 0.0
    if length > 0.0:
        scale = 1.0 / length
        cos, sin = across * scale, beside * scale
    nx, ny = x - a * cos, y - b * sin
    radius = d - c * cos
    return nx * nx + ny * ny + z * z - radius * radius, nx, ny, z


@inlined
def _root(ring, inner, outer, x, y, z, ex, ey, ez):
    """Return where G changes its sign between a stationary point inside and a place outside.

    The quartic is nearly a parabola at its lowest point; from where that one is zero Newton's steps converge, kept
    within the bracket.
    """
    _, _, c, d = ring
    settled = max(_SETTLED * (d - c), 2e-16)
    s = _first_guess(ring, inner, outer, x, y, z, ex, ey, ez)
    for _ in range(_STEPS):
        value, nx, ny, nz = _inside(ring, x + s * ex, y + s * ey, z + s * ez)
        if value < 0.0:
            inner = s
        else:
            outer = s
        step = 0.5 * value / (nx * ex + ny * ey + nz * ez)
        if min(inner, outer) <= s - step <= max(inner, outer):
            s -= step
            if abs(step) <= settled:
                break
        else:
            half = 0.5 * (inner + outer)
            if half in (inner, outer):
                break
            s = half
    return s


@inlined
def _first_guess(ring, inner, outer, x, y, z, ex, ey, ez):
    a, b, c, d = ring
    px, py, pz = x + inner * ex, y + inner * ey, z + inner * ez
    k = px * px + py * py + pz * pz + (b - d) * (b + d)
    l0, q0 = a * px - c * d, b * py
    along = px * ex + py * ey + pz * ez
    value = k * k - 4.0 * (l0 * l0 + q0 * q0)
    bend = 4.0 * (2.0 * along * along + k) - 8.0 * (a * a * ex * ex + b * b * ey * ey)
    if value < 0.0 and bend > 0.0:
        reach = math.sqrt(-2.0 * value / bend)
        if reach < abs(outer - inner):
            return inner + math.copysign(reach, outer - inner)
    return 0.5 * (inner + outer)


@inlined
def _cosine(inverse, nx, ny, nz, dx, dy, dz):
    """Return the size of direction . normal in the world, for a normal in the frame of the cyclide."""
    wx = inverse[0, 0] * nx + inverse[1, 0] * ny + inverse[2, 0] * nz
    wy = inverse[0, 1] * nx + inverse[1, 1] * ny + inverse[2, 1] * nz
    wz = inverse[0, 2] * nx + inverse[1, 2] * ny + inverse[2, 2] * nz
    return min(1.0, abs(wx * dx + wy * dy + wz * dz) / math.sqrt(wx * wx + wy * wy + wz * wz))
