"""Implicit functions, negative inside: their values and gradients, how gradients turn, and ranges over boxes."""

from __future__ import annotations

import math

from surfel._numba import inlined, inner
from surfel._vec import dot, norm

PLANE, QUADRIC, TORUS = 0.0, 1.0, 2.0
WIDTH = 16
"""Numbers that describe a function: its kind, then

- plane: unit normal, offset;
- quadric: xx, yy, zz, 2 xy, 2 xz, 2 yz, x, y, z, 1, and the point that they are about;
- torus: the map (3, 4) to its own frame, and its two radii.
"""

_ROUNDING = 1e-12


@inner
def value_at(row, x, y, z):
    """Return the value of a function: negative inside."""
    if row[0] == PLANE:
        return dot(row[1], row[2], row[3], x, y, z) - row[4]
    if row[0] == QUADRIC:
        x, y, z = x - row[11], y - row[12], z - row[13]
        return (
            x * (row[1] * x + row[4] * y + row[5] * z + row[7])
            + y * (row[2] * y + row[6] * z + row[8])
            + z * (row[3] * z + row[9])
            + row[10]
        )
    u, v, w = _to_torus(row, x, y, z)
    away = math.sqrt(u * u + v * v) - row[13]
    return away * away + w * w - row[14] * row[14]


@inner
def gradient_at(row, x, y, z):
    """Return the gradient of a function."""
    if row[0] == PLANE:
        return row[1], row[2], row[3]
    if row[0] == QUADRIC:
        x, y, z = x - row[11], y - row[12], z - row[13]
        return (
            2.0 * row[1] * x + row[4] * y + row[5] * z + row[7],
            row[4] * x + 2.0 * row[2] * y + row[6] * z + row[8],
            row[5] * x + row[6] * y + 2.0 * row[3] * z + row[9],
        )
    u, v, w = _to_torus(row, x, y, z)
    rho = math.sqrt(u * u + v * v)
    share = 2.0 * (1.0 - row[13] / rho) if rho > 0.0 else 0.0
    return _from_torus(row, share * u, share * v, 2.0 * w)


@inner
def bending(row, x, y, z, hx, hy, hz):
    """Return by how much the gradient turns from the middle of a box to its ends along x, y and z, in radians.

    The second derivatives times half a side, across the gradient, over its length: exact to first order.
    """
    if row[0] == PLANE:
        return 0.0, 0.0, 0.0
    gx, gy, gz = gradient_at(row, x, y, z)
    square = gx * gx + gy * gy + gz * gz
    if square == 0.0:
        return math.inf, math.inf, math.inf
    if row[0] == QUADRIC:
        ax, ay, az = 2.0 * row[1], row[4], row[5]
        bx, by, bz = row[4], 2.0 * row[2], row[6]
        cx, cy, cz = row[5], row[6], 2.0 * row[3]
    else:
        ax, ay, az = _torus_bend(row, x, y, z, row[1], row[5], row[9])
        bx, by, bz = _torus_bend(row, x, y, z, row[2], row[6], row[10])
        cx, cy, cz = _torus_bend(row, x, y, z, row[3], row[7], row[11])
    return (
        hx * _across(ax, ay, az, gx, gy, gz, square),
        hy * _across(bx, by, bz, gx, gy, gz, square),
        hz * _across(cx, cy, cz, gx, gy, gz, square),
    )


@inner
def range_over(row, x, y, z, hx, hy, hz):
    """Return a lower and an upper bound of a function over the box of centre (x, y, z) and half sides.

    Planes and quadrics by affine arithmetic: the linear part is exact, squares of a deviation lie in [0, h^2]. The
    torus by interval arithmetic in its own frame.
    """
    if row[0] == TORUS:
        return _torus_range(row, x, y, z, hx, hy, hz)
    middle = value_at(row, x, y, z)
    gx, gy, gz = gradient_at(row, x, y, z)
    spread = abs(gx) * hx + abs(gy) * hy + abs(gz) * hz
    low, high = middle - spread, middle + spread
    if row[0] == QUADRIC:
        mixed = abs(row[4]) * hx * hy + abs(row[5]) * hx * hz + abs(row[6]) * hy * hz
        low += min(row[1], 0.0) * hx * hx + min(row[2], 0.0) * hy * hy + min(row[3], 0.0) * hz * hz - mixed
        high += max(row[1], 0.0) * hx * hx + max(row[2], 0.0) * hy * hy + max(row[3], 0.0) * hz * hz + mixed
    slack = _ROUNDING * max(abs(low), abs(high))
    return low - slack, high + slack


@inlined
def _across(ax, ay, az, gx, gy, gz, square):
    """Return the length of a across g, over the length of g."""
    along = dot(ax, ay, az, gx, gy, gz) / square
    return norm(ax - along * gx, ay - along * gy, az - along * gz) / math.sqrt(square)


@inlined
def _to_torus(row, x, y, z):
    return (
        dot(row[1], row[2], row[3], x, y, z) + row[4],
        dot(row[5], row[6], row[7], x, y, z) + row[8],
        dot(row[9], row[10], row[11], x, y, z) + row[12],
    )


@inlined
def _from_torus(row, u, v, w):
    """Take a gradient back from the frame of the torus: by the transposed map."""
    return (
        dot(row[1], row[5], row[9], u, v, w),
        dot(row[2], row[6], row[10], u, v, w),
        dot(row[3], row[7], row[11], u, v, w),
    )


@inlined
def _torus_bend(row, x, y, z, a, b, c):
    """Return the change of the gradient along the direction (a, b, c) of the torus' frame."""
    u, v, _w = _to_torus(row, x, y, z)
    rho = math.sqrt(u * u + v * v)
    if rho == 0.0:
        return math.inf, math.inf, math.inf
    eu, ev = u / rho, v / rho
    radial, round_ = 2.0 * (a * eu + b * ev), 2.0 * (1.0 - row[13] / rho) * (b * eu - a * ev)
    return _from_torus(row, radial * eu - round_ * ev, radial * ev + round_ * eu, 2.0 * c)


@inlined
def _torus_range(row, x, y, z, hx, hy, hz):
    u, v, w = _to_torus(row, x, y, z)
    hu = abs(row[1]) * hx + abs(row[2]) * hy + abs(row[3]) * hz
    hv = abs(row[5]) * hx + abs(row[6]) * hy + abs(row[7]) * hz
    hw = abs(row[9]) * hx + abs(row[10]) * hy + abs(row[11]) * hz
    least_u, least_v = max(abs(u) - hu, 0.0), max(abs(v) - hv, 0.0)
    least_w = max(abs(w) - hw, 0.0)
    near = math.sqrt(least_u * least_u + least_v * least_v) - row[13]
    far = math.sqrt((abs(u) + hu) ** 2 + (abs(v) + hv) ** 2) - row[13]
    least = 0.0 if near <= 0.0 <= far else min(near * near, far * far)
    most = max(near * near, far * far)
    low = least + least_w * least_w - row[14] * row[14]
    high = most + (abs(w) + hw) ** 2 - row[14] * row[14]
    slack = _ROUNDING * max(abs(low), abs(high))
    return low - slack, high + slack
