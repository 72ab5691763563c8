"""Real roots by Bernstein forms, against exact counts by Sturm's sequence and roots of forty digits."""

from __future__ import annotations

import math
import warnings
from fractions import Fraction
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surfel import InputError
from surfel._numba import threads_for
from surfel.roots.bernstein import (
    bernstein_roots,
    count_bernstein_roots,
    count_polynomial_roots,
    polynomial_roots,
)
from surfel.roots.bernstein_basis import lobatto_nodes, power_to_bernstein, values_to_bernstein


def sturm_chain(coefficients):
    """The polynomial, its derivative, and the rests of dividing each by the next, negated, in fractions."""

    def trimmed(p):
        while p and p[-1] == 0:
            p = p[:-1]
        return p

    def rest(a, b):
        a = list(a)
        while len(a) >= len(b):
            factor, shift = a[-1] / b[-1], len(a) - len(b)
            a = trimmed([c - factor * b[k - shift] if k >= shift else c for k, c in enumerate(a)][:-1])
        return trimmed(a)

    first = trimmed([Fraction(c) for c in coefficients])
    chain = [first, trimmed([k * c for k, c in enumerate(first)][1:])]
    while chain[-1]:
        chain.append([-c for c in rest(chain[-2], chain[-1])])
    return chain[:-1]


def sturm_count(coefficients, low, high):
    """How many different roots the polynomial has in (low, high], by Sturm's theorem."""
    chain = sturm_chain(coefficients)

    def at(p, x):
        total = Fraction(0)
        for c in reversed(p):
            total = total * x + c
        return total

    def changes(x):
        signs = [s for s in ((v > 0) - (v < 0) for v in (at(p, x) for p in chain)) if s]
        return sum(a != b for a, b in pairwise(signs))

    return changes(Fraction(low)) - changes(Fraction(high))


def sharp_roots(coefficients, low, high):
    """The real roots of the polynomial with exactly these coefficients, found with a hundred digits."""
    with mpmath.workdps(100), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # the order of the arguments will change
        found = mpmath.polyroots([mpmath.mpf(float(c)) for c in reversed(coefficients)], maxsteps=500, extraprec=500)
        real = sorted(mpmath.re(r) for r in found if abs(mpmath.im(r)) < mpmath.mpf(10) ** -30)
        return [float(r) for r in real if low < r < high]


def from_roots(roots):
    return np.polynomial.polynomial.polyfromroots(roots)


def test_the_oracle_counts_right():
    assert sturm_count([-6, 11, -6, 1], 0, 4) == 3
    assert sturm_count([-6, 11, -6, 1], 1.5, 2.5) == 1
    assert sturm_count([1, 0, 1], -9, 9) == 0
    assert sturm_count([1, -2, 1], 0, 3) == 1  # different roots


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5, 6, 8, 11])
def test_counts_are_those_of_sturm(degree):
    rng = np.random.default_rng(degree)
    tried = 0
    for _ in range(60):
        c = rng.integers(-9, 10, degree + 1).astype(float)
        if c[-1] == 0.0:
            continue
        low, high = -1.75, 2.125  # dyadic, and never a root of such a polynomial but by chance
        ends = [np.polynomial.polynomial.polyval(x, c) for x in (low, high)]
        if 0.0 in ends or len(sturm_chain(c)[-1]) > 1:  # a root at an end, or a multiple one
            continue
        tried += 1
        assert count_polynomial_roots([c], low, high)[0] == sturm_count(c, low, high), c
    assert tried > 20


@pytest.mark.parametrize("degree", [3, 6, 10, 14, 17])
def test_roots_of_wilkinson_are_found_to_ten_digits_where_numpy_has_few(degree):
    c = from_roots(np.arange(1.0, degree + 1.0))  # whole numbers below 2^53: exact
    found = polynomial_roots([c], 0.5, degree + 0.5).at
    assert len(found) == degree
    ours = np.abs(found - np.arange(1, degree + 1)).max()
    theirs = np.abs(np.sort_complex(np.roots(c[::-1])) - np.arange(1, degree + 1)).max()
    assert ours < 5e-11
    if degree >= 10:
        assert theirs > 100.0 * ours


@pytest.mark.parametrize("degree", [8, 20, 30])
def test_roots_of_chebyshev(degree):
    c = np.polynomial.chebyshev.cheb2poly([0.0] * degree + [1.0])
    found = polynomial_roots([c], -1.0, 1.0).at
    truth = np.sort(np.cos((np.arange(degree) + 0.5) * np.pi / degree))
    assert len(found) == degree
    assert np.abs(found - truth).max() < (1e-11 if degree <= 20 else 1e-8)
    if degree == 30:
        assert np.abs(np.sort_complex(np.roots(c[::-1])) - truth).max() > 20.0 * np.abs(found - truth).max()


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-6])
def test_clusters_against_sharp_roots(gap):
    for seed in range(6):
        rng = np.random.default_rng(seed)
        a = rng.uniform(0.2, 0.8)
        c = from_roots([a, a + gap, a + 3.0 * gap, -0.5, 1.5])
        truth = sharp_roots(c, 0.0, 1.0)  # of the coefficients as rounded: these may be one root, or three
        form = power_to_bernstein([c], 0.0, 1.0)
        found = bernstein_roots(form).at
        noise = (1e-16 / gap) ** 0.5 if gap > 1e-5 else 2e-5  # 1e-16^(1/3) for what is a threefold root by then
        assert len(found) % 2 == len(truth) % 2 == 1
        if gap > 1e-5:
            assert len(found) == len(truth)
            assert np.abs(found - truth).max() < 10.0 * noise
        else:
            assert np.abs(found - a).max() < noise


def test_a_double_root_counts_twice_or_never_and_a_threefold_one_once():
    assert count_bernstein_roots([[-1.0, 1.0, -1.0], [1.0, -1.0, 1.0]]).tolist() == [2, 0]  # (2 u - 1)^2, exactly
    assert bernstein_roots([[-1.0, 1.0, -1.0]]).at.tolist() == [0.5, 0.5]
    rough = from_roots([0.3, 0.3, 0.7])  # as rounding has it
    for sign in (1.0, -1.0):
        found = polynomial_roots([sign * rough], 0.0, 1.0).at
        assert len(found) in (1, 3)
        assert np.abs(found - np.array([0.3, 0.3, 0.7])[-len(found) :]).max() < 1e-7
    threefold = from_roots([0.25, 0.25, 0.25, 2.0])
    assert count_polynomial_roots([threefold, -threefold], 0.0, 1.0).tolist() == [1, 1]


def test_double_roots_anywhere_keep_the_parity_where_numpy_leaves_it_open():
    rng = np.random.default_rng(0)
    a, b = rng.uniform(0.05, 0.95, (2, 400))
    forms = np.array([from_roots([x, x, y]) for x, y in zip(a, b, strict=True)])
    counts = count_polynomial_roots(forms, 0.0, 1.0)
    assert set(counts.tolist()) <= {1, 3}
    assert set(counts.tolist()) == {1, 3}
    split = [np.abs(np.roots(c[::-1]).imag).max() > 1e-12 for c in forms]
    assert 50 < sum(split) < 350  # numpy: a pair of complex roots, or two real ones, as rounding has it


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0, allow_subnormal=False), min_size=1, max_size=13))
def test_roots_are_odd_in_number_exactly_if_the_ends_differ_in_sign(coefficients):
    offsets, at = bernstein_roots([coefficients])
    assert (len(at) % 2 == 1) == ((coefficients[0] < 0.0) != (coefficients[-1] < 0.0))
    assert np.all(np.diff(at) >= 0.0)
    assert np.all((at >= 0.0) & (at <= 1.0))
    assert count_bernstein_roots([coefficients]).tolist() == np.diff(offsets).tolist()
    changes = sum((a < 0.0) != (b < 0.0) for a, b in pairwise(coefficients))
    assert len(at) <= changes


@pytest.mark.parametrize("degree", [1, 2, 4, 6, 12])
def test_the_polynomial_is_zero_at_every_root(degree):
    rng = np.random.default_rng(degree)
    forms = rng.standard_normal((300, degree + 1))
    offsets, at = bernstein_roots(forms)
    of = np.repeat(np.arange(300), np.diff(offsets))
    k = np.arange(degree + 1)
    basis = np.array([math.comb(degree, j) for j in k]) * at[:, None] ** k * (1.0 - at[:, None]) ** (degree - k)
    assert len(at) > 100
    assert np.abs((basis * forms[of]).sum(axis=1)).max() < 1e-13


def test_zero_counts_as_positive():
    assert count_bernstein_roots([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [-0.0, 1.0, -0.0]]).tolist() == [
        0,
        0,
        2,
        0,
    ]
    assert bernstein_roots([[0.0, -1.0, 0.0]]).at.tolist() == [0.0, 1.0]
    assert count_bernstein_roots([[3.0], [-3.0]]).tolist() == [0, 0]
    assert len(bernstein_roots(np.empty((0, 4))).at) == 0


@pytest.mark.parametrize("other", [0.1, 0.2844, 0.45, 0.6, 0.9])
@pytest.mark.parametrize("rounding", [0.0, 1e-17, -1e-17, 1e-16, -1e-16])
def test_a_root_where_the_interval_is_halved_does_not_hide_the_other_one(other, rounding):
    product, half = 0.5 * other, 0.5 * (0.5 + other)
    form = np.array([product, product - half, product - 2.0 * half + 1.0]) + rounding
    offsets, at = bernstein_roots([form, -form])
    assert offsets.tolist() == [0, 2, 4]
    assert np.allclose(at, 2 * sorted([0.5, other]), atol=1e-14)


def test_the_bernstein_form_of_powers_is_exact():
    rng = np.random.default_rng(3)
    for n in (1, 4, 9, 17):
        c = rng.standard_normal(n + 1) * 10.0 ** rng.integers(-3, 4, n + 1)
        low, high = 7.3, 7.9
        start, width = Fraction(low), Fraction(high) - Fraction(low)
        shifted = [
            sum(Fraction(c[i]) * math.comb(i, k) * start ** (i - k) for i in range(k, n + 1)) * width**k
            for k in range(n + 1)
        ]
        truth = [
            float(sum(shifted[k] * Fraction(math.comb(j, k), math.comb(n, k)) for k in range(j + 1)))
            for j in range(n + 1)
        ]
        assert np.allclose(power_to_bernstein([c], low, high)[0], truth, rtol=3e-16, atol=0.0)


@pytest.mark.parametrize("degree", [1, 2, 6, 20])
def test_values_at_the_nodes_give_the_bernstein_form(degree):
    matrix, nodes = values_to_bernstein(degree), lobatto_nodes(degree)
    k = np.arange(degree + 1)
    basis = np.array([math.comb(degree, j) for j in k]) * nodes[:, None] ** k * (1.0 - nodes[:, None]) ** (degree - k)
    norm = np.abs(matrix).sum(axis=1).max()
    assert np.abs(matrix @ basis - np.eye(degree + 1)).max() < 1e-15 * norm
    assert matrix[0].tolist() == [1.0] + [0.0] * degree
    assert matrix[-1].tolist() == [0.0] * degree + [1.0]


def test_the_same_bits_on_one_and_two_threads():
    forms = np.random.default_rng(1).standard_normal((6000, 7))
    many = bernstein_roots(forms)
    with threads_for(10**6, threads=1):
        one = bernstein_roots(forms)
    assert np.array_equal(many.at, one.at)
    assert np.array_equal(many.offsets, one.offsets)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: bernstein_roots([1.0, 2.0]), "one polynomial a row"),
        (lambda: bernstein_roots([[1.0, math.nan]]), "finite"),
        (lambda: count_bernstein_roots(np.empty((3, 0))), "one polynomial a row"),
        (lambda: polynomial_roots([[1.0, 2.0]], 1.0, 1.0), "low < high"),
        (lambda: polynomial_roots([[1.0, 2.0]], math.nan, 1.0), "low"),
        (lambda: polynomial_roots([[1.0, math.inf]], 0.0, 1.0), "finite"),
        (lambda: bernstein_roots([["a", "b"]]), "real numbers"),
    ],
)
def test_bad_input(call, says):
    with pytest.raises(InputError, match=says):
        call()
