"""Sine and cosine of a share of a full turn: the same bits on every machine, and open to vector instructions."""

from __future__ import annotations

import math

from surfel._numba import inlined

_QUARTER = 0.5 * math.pi


@inlined
def circle(x):
    """Return cos(2 pi x) and sin(2 pi x) for x in 0 .. 1, to within 3e-16.

    The nearest quarter turn is taken off exactly; Taylor's series serve the rest, which is at most an eighth of a turn.
    """
    quarter = int(4.0 * x + 0.5)
    a = (4.0 * x - quarter) * _QUARTER
    b = a * a
    s = b * (-1.0 / 39916800.0 + b * (1.0 / 6227020800.0 - b * (1.0 / 1307674368000.0)))
    s = b * (-1.0 / 6.0 + b * (1.0 / 120.0 + b * (-1.0 / 5040.0 + b * (1.0 / 362880.0 + s))))
    s = a + a * s
    c = b * (-1.0 / 3628800.0 + b * (1.0 / 479001600.0 + b * (-1.0 / 87178291200.0 + b * (1.0 / 20922789888000.0))))
    c = b * (-0.5 + b * (1.0 / 24.0 + b * (-1.0 / 720.0 + b * (1.0 / 40320.0 + c))))
    c = 1.0 + c
    odd = quarter & 1
    first, second = (s, c) if odd else (c, s)
    return (-first if (quarter + 1) & 2 else first), (-second if quarter & 2 else second)
