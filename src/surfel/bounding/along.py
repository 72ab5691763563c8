"""A spline along a line in one cell: a polynomial of degree six, by its Bernstein coefficients.

They come from blossoms of the B-spline weights at the ends of the line's piece in the cell. Everything here is called
by kernels alone.
"""

from __future__ import annotations

from surfel._numba import inlined, inner


@inlined
def blossom(r, s, t, column, weights):
    """Write the weights of four B-spline coefficients in the blossom of their cell at (r, s, t) (de Boor)."""
    third = 1.0 / 3.0  # products: divisions would take most of the time
    a1, a2 = (1.0 - r) * third, (2.0 + r) * third
    b1, b2 = (2.0 - r) * third, (1.0 + r) * third
    c1, c2 = (3.0 - r) * third, r * third
    p1, p2 = 0.5 * (1.0 - s) * (1.0 - t), 0.5 * (1.0 + s) * (1.0 - t)
    q1, q2 = 0.5 * (2.0 - s) * t, 0.5 * s * t
    weights[0, column] = p1 * a1
    weights[1, column] = p1 * a2 + (p2 + q1) * b1
    weights[2, column] = (p2 + q1) * b2 + q2 * c1
    weights[3, column] = q2 * c2


@inner
def blossoms(a, b, weights):
    """Write the weights of four B-spline coefficients in the four Bernstein coefficients on [a, b] of their cell."""
    blossom(a, a, a, 0, weights)
    blossom(a, a, b, 1, weights)
    blossom(a, b, b, 2, weights)
    blossom(b, b, b, 3, weights)


@inner
def restrict(coefficients, h, k, weights_u, weights_v, w0, w1, c):
    """Write the Bernstein coefficients of the spline minus the height of the line, along the line in one cell.

    The product of the Bernstein polynomials i and j of degree three is C(3, i) C(3, j) / C(6, i + j) times that of
    degree six and number i + j.
    """
    for i in range(7):
        c[i] = 0.0
    for j in range(4):
        r0, r1, r2, r3 = 0.0, 0.0, 0.0, 0.0
        for q in range(4):
            wv = weights_v[q, j]
            r0 += coefficients[h, k + q] * wv
            r1 += coefficients[h + 1, k + q] * wv
            r2 += coefficients[h + 2, k + q] * wv
            r3 += coefficients[h + 3, k + q] * wv
        many = 3.0 if 0 < j < 3 else 1.0
        for i in range(4):
            value = r0 * weights_u[0, i] + r1 * weights_u[1, i] + r2 * weights_u[2, i] + r3 * weights_u[3, i]
            c[i + j] += many * (3.0 if 0 < i < 3 else 1.0) * value
    c[1] *= 1.0 / 6.0
    c[2] *= 1.0 / 15.0
    c[3] *= 1.0 / 20.0
    c[4] *= 1.0 / 15.0
    c[5] *= 1.0 / 6.0
    for i in range(7):
        c[i] -= w0 + (w1 - w0) * (i * (1.0 / 6.0))
