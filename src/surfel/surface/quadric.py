"""A quadric fitted with Gaussian weights: the scalar steps, written so that a loop over lanes turns into vectors.

Neither a branch nor a call is left in them. So a kernel that keeps the sums of eight fits side by side, and loops over
the eight inside, does all eight at once.
"""

from __future__ import annotations

from surfel._numba import inlined

RIDGE = 1e-9
"""What is added to the diagonal of the normal equations, in total weights: too few points give a solution as well."""


@inlined
def gaussian(square):
    """Return exp(-square / 2) for squares from 0 to 4, to 1e-13.

    The series of the exponential at the fourth part of the argument, from the middle of the range, squared twice.
    """
    x = 0.25 - 0.125 * square
    p = 1.0 + x * (1.0 / 11.0)
    p = 1.0 + x * (1.0 / 10.0) * p
    p = 1.0 + x * (1.0 / 9.0) * p
    p = 1.0 + x * (1.0 / 8.0) * p
    p = 1.0 + x * (1.0 / 7.0) * p
    p = 1.0 + x * (1.0 / 6.0) * p
    p = 1.0 + x * (1.0 / 5.0) * p
    p = 1.0 + x * (1.0 / 4.0) * p
    p = 1.0 + x * (1.0 / 3.0) * p
    p = 1.0 + x * (1.0 / 2.0) * p
    p = 1.0 + x * p
    p = p * p
    return 0.36787944117144233 * (p * p)


@inlined
def solve_quadric(
    s00, s10, s01, s20, s11, s02, s30, s21, s12, s03, s40, s31, s22, s13, s04, t0, t1, t2, t3, t4, t5
):  # fmt: skip
    """Return the coefficients of 1, u, v, u^2, uv, v^2 from the sums s_ab of u^a v^b, and t of these six times w.

    The normal equations are symmetric and, with the ridge, positive definite: L D L^T by columns, without a pivot.
    """
    ridge = RIDGE * s00
    d0 = 1.0 / (s00 + ridge)
    a1, a2, a3, a4, a5 = s10 * d0, s01 * d0, s20 * d0, s11 * d0, s02 * d0
    m11, m21, m31, m41, m51 = s20 + ridge - a1 * s10, s11 - a1 * s01, s30 - a1 * s20, s21 - a1 * s11, s12 - a1 * s02
    m22, m32, m42, m52 = s02 + ridge - a2 * s01, s21 - a2 * s20, s12 - a2 * s11, s03 - a2 * s02
    m33, m43, m53 = s40 + ridge - a3 * s20, s31 - a3 * s11, s22 - a3 * s02
    m44, m54 = s22 + 0.5 * ridge - a4 * s11, s13 - a4 * s02  # half for uv: turning the frame changes nothing
    m55 = s04 + ridge - a5 * s02
    t1, t2, t3, t4, t5 = t1 - a1 * t0, t2 - a2 * t0, t3 - a3 * t0, t4 - a4 * t0, t5 - a5 * t0
    d1 = 1.0 / m11
    b2, b3, b4, b5 = m21 * d1, m31 * d1, m41 * d1, m51 * d1
    m22, m32, m42, m52 = m22 - b2 * m21, m32 - b2 * m31, m42 - b2 * m41, m52 - b2 * m51
    m33, m43, m53 = m33 - b3 * m31, m43 - b3 * m41, m53 - b3 * m51
    m44, m54, m55 = m44 - b4 * m41, m54 - b4 * m51, m55 - b5 * m51
    t2, t3, t4, t5 = t2 - b2 * t1, t3 - b3 * t1, t4 - b4 * t1, t5 - b5 * t1
    d2 = 1.0 / m22
    c3, c4, c5 = m32 * d2, m42 * d2, m52 * d2
    m33, m43, m53 = m33 - c3 * m32, m43 - c3 * m42, m53 - c3 * m52
    m44, m54, m55 = m44 - c4 * m42, m54 - c4 * m52, m55 - c5 * m52
    t3, t4, t5 = t3 - c3 * t2, t4 - c4 * t2, t5 - c5 * t2
    d3 = 1.0 / m33
    e4, e5 = m43 * d3, m53 * d3
    m44, m54, m55 = m44 - e4 * m43, m54 - e4 * m53, m55 - e5 * m53
    t4, t5 = t4 - e4 * t3, t5 - e5 * t3
    d4 = 1.0 / m44
    f5 = m54 * d4
    x5 = (t5 - f5 * t4) / (m55 - f5 * m54)
    x4 = t4 * d4 - f5 * x5
    x3 = t3 * d3 - e4 * x4 - e5 * x5
    x2 = t2 * d2 - c3 * x3 - c4 * x4 - c5 * x5
    x1 = t1 * d1 - b2 * x2 - b3 * x3 - b4 * x4 - b5 * x5
    return t0 * d0 - a1 * x1 - a2 * x2 - a3 * x3 - a4 * x4 - a5 * x5, x1, x2, x3, x4, x5
