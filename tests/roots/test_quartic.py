"""Roots of quartics against exact Sturm counts and roots with many digits."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
import pytest
from mpmath import mp, mpf

from surfel import InputError
from surfel._numba import kernel
from surfel.roots.quartic import quartic_roots, stationary_points


@kernel
def stationary(p, q):
    return stationary_points(p, q)


def from_roots(roots):
    """Exact coefficients c0 to c4 of the quartic with the given roots, and the same in floats."""
    exact = [Fraction(1)]
    for root in roots:
        shifted = [Fraction(0), *exact]
        exact = [s - Fraction(root) * e for s, e in zip(shifted, [*exact, Fraction(0)], strict=True)]
    return exact, [float(c) for c in exact]


def remainder(a, b):
    a = list(a)
    while len(a) >= len(b):
        factor = a[-1] / b[-1]
        for k in range(len(b)):
            a[len(a) - len(b) + k] -= factor * b[k]
        a.pop()
    while a and a[-1] == 0:
        a.pop()
    return a


def sturm_count(coefficients):
    """How many distinct real roots a polynomial has, by Sturm's theorem in exact arithmetic."""
    chain = [[Fraction(c) for c in coefficients]]
    chain.append([k * c for k, c in enumerate(chain[0])][1:])
    while True:
        rest = remainder(chain[-2], chain[-1])
        if not rest:
            break
        chain.append([-c for c in rest])
    variations = []
    for side in (-1, 1):
        signs = [(p[-1] > 0) == (side > 0 or len(p) % 2 == 1) for p in chain]
        variations.append(sum(one != other for one, other in itertools.pairwise(signs)))
    return variations[0] - variations[1]


def test_counts_are_those_of_sturm():
    rng = np.random.default_rng(0)
    table = rng.standard_normal((400, 5)) * 10.0 ** rng.integers(-6, 6, (400, 5))
    counts, roots = quartic_roots(table)
    for row, count, found in zip(table, counts, roots, strict=True):
        assert count == sturm_count(row)
        assert np.isfinite(found[:count]).all()
        assert np.isnan(found[count:]).all()
        assert (np.diff(found[:count]) > 0.0).all()


@pytest.mark.filterwarnings("ignore:Descending")
def test_roots_are_those_of_many_digits():
    rng = np.random.default_rng(1)
    for row in rng.standard_normal((60, 5)):
        (count,), (found,) = quartic_roots([row])
        with mp.workdps(50):
            true = sorted(
                mp.re(r) for r in mp.polyroots([mpf(c) for c in row[::-1]], 200, 200) if abs(mp.im(r)) < 1e-25
            )
            assert len(true) == count
            for root, exact in zip(found, true, strict=False):
                slope = abs(sum(k * mpf(c) * exact ** (k - 1) for k, c in enumerate(row) if k))
                noise = 1e-16 * sum(abs(mpf(c) * exact**k) for k, c in enumerate(row)) / slope
                assert abs(root - exact) <= 4e-16 * abs(exact) + 1e-15 * noise


@pytest.mark.parametrize("bits", [6, 8, 10])
def test_clusters_are_told_apart_where_numpy_cannot(bits):
    gap = 2.0**-bits
    true = [1.0, 1.0 + gap, 1.0 + 2 * gap, 1.0 + 3 * gap]
    exact, coefficients = from_roots(true)
    if any(Fraction(c) != e for c, e in zip(coefficients, exact, strict=True)):
        pytest.fail("choose roots whose coefficients are exact")
    (count,), (found,) = quartic_roots([coefficients])
    assert count == 4
    error = np.abs(found - true).max()
    assert error <= 4e-16
    assert error < 0.01 * np.abs(np.sort(np.roots(coefficients[::-1]).real) - true).max()


def test_a_double_root_counts_twice_or_not_at_all():
    for double in (0.5, 1.0, -3.25, 0.1):
        for pair in ([2.0, 7.0], [1.5, 1.5]):
            _, coefficients = from_roots([double, double, *pair])
            (count,), _ = quartic_roots([coefficients])
            assert count in ((2, 4) if pair[0] != pair[1] else (0, 2, 4))


def test_roots_of_multiplicity_three_and_four():
    (count,), (found,) = quartic_roots([from_roots([1.0, 1.0, 1.0, 4.0])[1]])
    assert count in (2, 4)
    assert found[:count][[0, -1]] == pytest.approx([1.0, 4.0], abs=1e-5)
    (count,), _ = quartic_roots([from_roots([2.0, 2.0, 2.0, 2.0])[1]])
    assert count in (0, 2, 4)


def test_sizes_and_signs_do_not_matter():
    true = np.array([-3.0, -1.0, 0.5, 2.0])
    for size in (1e-30, 1.0, 1e30):
        for sign in (-1e-20, 1e20):
            _, coefficients = from_roots(true)
            scaled = [sign * c * size ** (4 - k) for k, c in enumerate(coefficients)]
            (count,), (found,) = quartic_roots([scaled])
            assert count == 4
            assert found == pytest.approx(true * size, rel=1e-14)


def test_a_root_at_zero():
    (count,), (found,) = quartic_roots([[0.0, -1.0, 0.0, 0.0, 1.0]])
    assert count == 2
    assert found[:2] == pytest.approx([0.0, 1.0], abs=1e-30)


def test_stationary_points_are_zeros_of_the_derivative():
    rng = np.random.default_rng(2)
    for p, q in rng.standard_normal((2000, 2)) * 10.0 ** rng.integers(-8, 3, (2000, 2)):
        count, *places = stationary(p, q)
        true = np.roots([4.0, 0.0, 2.0 * p, q])
        size = np.abs(true).max()
        assert count == (3 if 27 * q * q < -8 * p**3 else 1)
        assert (np.diff(places[:count]) > 0).all()
        for place in places[:count]:
            assert abs(4 * place**3 + 2 * p * place + q) <= 1e-13 * size**3


@pytest.mark.parametrize(
    ("coefficients", "said"),
    [([1.0, 2.0], "shape"), ([[1, 2, 3, 4, 0.0]], "zero"), ([[1, 2, np.nan, 4, 1]], "finite"), ([[1, 2, 3]], "shape")],
)
def test_bad_coefficients(coefficients, said):
    with pytest.raises(InputError, match=said):
        quartic_roots(coefficients)
