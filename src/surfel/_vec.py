"""The shared scalar kernels: small vector algebra and exact sums on plain floats, so that nothing is allocated."""

from __future__ import annotations

import math

from surfel._numba import inlined

_SPLIT = 134217729.0  # 2^27 + 1: cuts a float into two halves whose products are exact (Veltkamp)


@inlined
def dot(ax, ay, az, bx, by, bz):
    """Return a . b."""
    return ax * bx + ay * by + az * bz


@inlined
def cross(ax, ay, az, bx, by, bz):
    """Return a x b as three floats."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inlined
def norm(ax, ay, az):
    """Return the length of a."""
    return math.sqrt(ax * ax + ay * ay + az * az)


@inlined
def tangent_frame(nx, ny, nz):
    """Return two unit vectors that complete the unit vector n to a right-handed frame, without a branch on n.

    Duff et al., *Building an orthonormal basis, revisited*, JCGT 6(1), 2017.
    """
    sign = 1.0 if nz >= 0.0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@inlined
def two_sum(a, b):
    """Return a + b and what rounding took from it (Knuth)."""
    s = a + b
    back = s - a
    return s, (a - (s - back)) + (b - back)


@inlined
def two_product(a, b):
    """Return a b and what rounding took from it (Dekker)."""
    p = a * b
    wide = _SPLIT * a
    a_high = wide - (wide - a)
    wide = _SPLIT * b
    b_high = wide - (wide - b)
    a_low, b_low = a - a_high, b - b_high
    return p, ((a_high * b_high - p) + a_high * b_low + a_low * b_high) + a_low * b_low
