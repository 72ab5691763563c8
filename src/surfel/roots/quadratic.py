"""Real roots of quadratics, and where a line crosses a quadric: without cancellation, from any distance."""

from __future__ import annotations

import math

from surfel._numba import inlined
from surfel._vec import two_product

_NEAR_VERTEX = 8.0


@inlined
def discriminant(a, b, c):
    """Return b^2 - a c to nearly full relative accuracy (Kahan)."""
    square, product = b * b, a * c
    rough = square - product
    if 3.0 * abs(rough) >= square + abs(product):
        return rough
    square, square_rest = two_product(b, b)
    product, product_rest = two_product(a, c)
    return (square - product) + (square_rest - product_rest)


@inlined
def solve_quadratic(a, b, c):
    """Return how many real roots a t^2 + 2 b t + c has, and the roots, ascending.

    Two, or none where it only touches zero; one where a is zero. A root that is too large for a float is infinite.
    """
    if a == 0.0:
        if b == 0.0:
            return 0, 0.0, 0.0
        root = -0.5 * c / b
        return 1, root, root
    rest = discriminant(a, b, c)
    if not rest > 0.0:
        return 0, 0.0, 0.0
    q = -(b + math.copysign(math.sqrt(rest), b))
    s, t = q / a, c / q
    return 2, min(s, t), max(s, t)


@inlined
def cross_quadric(a, b, c, d, e, x, y, z, dx, dy, dz):
    """Return how often the line (x, y, z) + t (dx, dy, dz) crosses a x^2 + b y^2 + c z^2 + d z + e = 0, where, and A.

    A is the coefficient of t^2: the line comes from inside (where the form is negative) if A < 0, or if A = 0 and the
    form grows along the line. Where the vertex of the parabola is as near as the origin of the line, the origin is
    moved there first: then what is left under the root has no cancellation but that of the coordinates.
    """
    A = a * dx * dx + b * dy * dy + c * dz * dz
    B = a * x * dx + b * y * dy + (c * z + 0.5 * d) * dz
    shift = 0.0
    if A != 0.0:
        vertex = -B / A
        if abs(vertex) * (abs(dx) + abs(dy) + abs(dz)) <= _NEAR_VERTEX * (abs(x) + abs(y) + abs(z)):
            shift = vertex
            x, y, z = x + shift * dx, y + shift * dy, z + shift * dz
            B = a * x * dx + b * y * dy + (c * z + 0.5 * d) * dz
    C = a * x * x + b * y * y + (c * z + d) * z + e
    count, s, t = solve_quadratic(A, B, C)
    return count, s + shift, t + shift, A
