"""A line seen from where it comes nearest: exact arithmetic beside floats, from far and from near."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from surfel._numba import kernel
from surfel.shapes.primitives.approach import approach


@kernel
def approach_of(inverse, o, d):
    return approach(inverse, 64.0, o[0], o[1], o[2], d[0], d[1], d[2])


@pytest.mark.parametrize("distance", [1.0, 60.0, 1e3, 1e6, 1e9, 1e12])
def test_the_moved_origin_lies_on_the_line_itself(distance):
    rng = np.random.default_rng(0)
    for _ in range(100):
        linear = rng.standard_normal((3, 3))
        inverse = np.column_stack([linear, rng.uniform(-1.0, 1.0, 3)])
        direction = rng.standard_normal(3)
        direction /= np.linalg.norm(direction)
        start = rng.uniform(-1.0, 1.0, 3) - distance * direction
        t, *moved = approach_of(inverse, start, direction)
        point = [Fraction(o) + Fraction(t) * Fraction(d) for o, d in zip(start, direction, strict=True)]
        for row in range(3):
            exact = sum(Fraction(m) * p for m, p in zip(linear[row], point, strict=True)) + Fraction(inverse[row, 3])
            assert abs(float(exact - Fraction(moved[row]))) <= 1e-13 * (1.0 if distance > 64.0 else 1.0 + distance)
            assert moved[3 + row] == pytest.approx(linear[row] @ direction, abs=1e-15)
        assert np.dot(moved[:3], moved[3:]) == pytest.approx(0.0, abs=1e-12 + 1e-14 * distance)
