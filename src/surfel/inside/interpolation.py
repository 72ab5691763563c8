"""Values known at every so many points of a curve's order, taken over by those between them."""

from __future__ import annotations

import numpy as np

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats


def along_the_order(points: Floats, known: Floats, stride: int) -> Floats:
    """Return for every point the value of the nearer one of the two known points that it lies between in the order.

    A point far from those before it, where the curve leaps, or a stray, so does not pass its value on.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Sorted along a curve.
    known : Floats, shape (ceil(n / stride),)
        The values at points 0, stride, 2 stride, ...
    stride : int
        At least 1.
    """
    values = np.empty(len(points))
    with threads_for(len(points)):
        _take_over(len(points), points, known, np.int64(stride), values)
    return values


@rows
def _take_over(first, last, points, known, stride, values):
    for n in range(first, last):
        before = n // stride
        after = min(before + 1, len(known) - 1)
        a, b = before * stride, after * stride
        to_a = to_b = 0.0
        for axis in range(3):
            to_a += (points[n, axis] - points[a, axis]) ** 2
            to_b += (points[n, axis] - points[b, axis]) ** 2
        values[n] = known[before] if to_a <= to_b else known[after]
