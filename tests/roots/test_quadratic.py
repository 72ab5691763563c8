"""Roots of quadratics, and of quadrics along lines, against exact arithmetic."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from mpmath import mp, mpf

from surfel._numba import kernel
from surfel._vec import two_product, two_sum
from surfel.roots.quadratic import cross_quadric, discriminant, solve_quadratic


@kernel
def solve(a, b, c):
    return solve_quadratic(a, b, c)


@kernel
def cross(form, p, d):
    return cross_quadric(form[0], form[1], form[2], form[3], form[4], p[0], p[1], p[2], d[0], d[1], d[2])


@kernel
def exact_parts(a, b):
    s, s_rest = two_sum(a, b)
    p, p_rest = two_product(a, b)
    return s, s_rest, p, p_rest


@kernel
def under_the_root(a, b, c):
    return discriminant(a, b, c)


def true_roots(a, b, c):
    """The roots of a t^2 + 2 b t + c with 60 digits; none where they touch or do not exist."""
    with mp.workdps(60):
        rest = mpf(b) ** 2 - mpf(a) * mpf(c)
        if rest <= 0:
            return []
        root = mp.sqrt(rest)
        return sorted([(-mpf(b) - root) / mpf(a), (-mpf(b) + root) / mpf(a)])


def test_sums_and_products_keep_what_rounding_takes():
    rng = np.random.default_rng(0)
    for a, b in rng.standard_normal((300, 2)) * 10.0 ** rng.integers(-30, 30, (300, 2)):
        s, s_rest, p, p_rest = exact_parts(a, b)
        assert Fraction(s) + Fraction(s_rest) == Fraction(a) + Fraction(b)
        assert Fraction(p) + Fraction(p_rest) == Fraction(a) * Fraction(b)


def test_the_discriminant_keeps_its_digits_where_it_cancels():
    rng = np.random.default_rng(1)
    for b, tilt in zip(rng.uniform(1, 2, 300), rng.uniform(-1, 1, 300) * 1e-12, strict=True):
        a = rng.uniform(1, 2)
        c = b * b / a * (1.0 + tilt)
        true = float(Fraction(b) ** 2 - Fraction(a) * Fraction(c))
        assert under_the_root(a, b, c) == pytest.approx(true, rel=1e-12, abs=1e-31)


def test_roots_have_full_accuracy_whatever_their_sizes():
    rng = np.random.default_rng(2)
    for _ in range(500):
        a, b, c = rng.standard_normal(3) * 10.0 ** rng.integers(-12, 12, 3)
        expected = true_roots(a, b, c)
        count, *found = solve(a, b, c)
        assert count == len(expected)
        for root, true in zip(found, expected, strict=False):
            assert abs(mpf(root) - true) <= 4e-15 * abs(true)


def test_nearly_equal_roots_keep_their_distance():
    for gap in (2.0**-20, 2.0**-24):
        one, other = 1.0, 1.0 + gap  # the coefficients are exact
        count, s, t = solve(1.0, -0.5 * (one + other), one * other)
        assert (count, s, t) == (2, pytest.approx(one, abs=1e-15), pytest.approx(other, abs=1e-15))


@pytest.mark.parametrize(
    ("a", "b", "c", "expected"),
    [
        (1.0, -1.0, 1.0, []),  # a touch
        (1.0, 0.0, 0.0, []),
        (1.0, 0.0, 1.0, []),
        (0.0, 1.0, -4.0, [2.0]),
        (0.0, 0.0, 1.0, []),
        (0.0, 0.0, 0.0, []),
        (-1.0, 0.0, 4.0, [-2.0, 2.0]),
        (1e-320, 1.0, -2.0, [-math.inf, 1.0]),
    ],
)
def test_special_cases(a, b, c, expected):
    count, *found = solve(a, b, c)
    assert count == len(expected)
    assert found[:count] == expected


def test_a_thin_cylinder_is_crossed_on_its_surface_from_anywhere():
    rng = np.random.default_rng(3)
    radius = 1e-6
    for _ in range(200):
        on_axis = np.array([0.0, 0.0, rng.uniform(-1, 1)])
        d = rng.standard_normal(3)
        p = on_axis + d * rng.uniform(-1, 1)
        count, s, t, square = cross(np.array([1.0, 1.0, 0.0, 0.0, -(radius**2)]), p, d)
        assert count == 2
        assert square > 0.0
        for root in (s, t):
            assert math.hypot(*(p + root * d)[:2]) == pytest.approx(radius, abs=2e-15)


def test_a_line_along_a_paraboloid_leaves_it_once():
    count, s, _, square = cross(
        np.array([1.0, 1.0, 0.0, -1.0, 0.0]), np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    )
    assert (count, s, square) == (1, 0.25, 0.0)
