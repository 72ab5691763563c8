"""A line in the frame of a primitive, seen from where it comes nearest: so that far origins cost no digits."""

from __future__ import annotations

from surfel._numba import inlined
from surfel._vec import two_product, two_sum


@inlined
def approach(inverse, reach, ox, oy, oz, dx, dy, dz):
    """Return t, o' and d': the line o + t d in the local frame, with its origin moved to the one nearest to the local.

    A point at s on the moved line is at t + s on the given one. Where the origin is farther away than ``reach``, the
    point o + t d is summed with its rounding errors; then only the result is rounded, not the way there.
    """
    ex = inverse[0, 0] * dx + inverse[0, 1] * dy + inverse[0, 2] * dz
    ey = inverse[1, 0] * dx + inverse[1, 1] * dy + inverse[1, 2] * dz
    ez = inverse[2, 0] * dx + inverse[2, 1] * dy + inverse[2, 2] * dz
    x = inverse[0, 0] * ox + inverse[0, 1] * oy + inverse[0, 2] * oz + inverse[0, 3]
    y = inverse[1, 0] * ox + inverse[1, 1] * oy + inverse[1, 2] * oz + inverse[1, 3]
    z = inverse[2, 0] * ox + inverse[2, 1] * oy + inverse[2, 2] * oz + inverse[2, 3]
    t = -(x * ex + y * ey + z * ez) / (ex * ex + ey * ey + ez * ez)
    if max(abs(x), abs(y), abs(z)) <= reach:
        return t, x + t * ex, y + t * ey, z + t * ez, ex, ey, ez
    px, rx = _moved(ox, t, dx)
    py, ry = _moved(oy, t, dy)
    pz, rz = _moved(oz, t, dz)
    x = inverse[0, 0] * px + inverse[0, 1] * py + inverse[0, 2] * pz + inverse[0, 3]
    y = inverse[1, 0] * px + inverse[1, 1] * py + inverse[1, 2] * pz + inverse[1, 3]
    z = inverse[2, 0] * px + inverse[2, 1] * py + inverse[2, 2] * pz + inverse[2, 3]
    x += inverse[0, 0] * rx + inverse[0, 1] * ry + inverse[0, 2] * rz
    y += inverse[1, 0] * rx + inverse[1, 1] * ry + inverse[1, 2] * rz
    z += inverse[2, 0] * rx + inverse[2, 1] * ry + inverse[2, 2] * rz
    return t, x, y, z, ex, ey, ez


@inlined
def _moved(o, t, d):
    """Return o + t d and the rest that rounding took."""
    product, product_rest = two_product(t, d)
    total, total_rest = two_sum(o, product)
    return total, total_rest + product_rest
