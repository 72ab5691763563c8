"""The shared scalar kernels: small vector algebra on plain floats, so that nothing is allocated in inner loops."""

from __future__ import annotations

import math

from surfel._numba import inlined


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
