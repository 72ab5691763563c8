"""The paper's pieces in one variable: enclosures, broken lines, scattered data, trial and error, curves."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from scipy.interpolate import BSpline

import surfel
from surfel.bounding import broken_line_surrogate, lower_at, lower_broken_line, scattered_surrogate, trial_and_error
from surfel.bounding.broken_lines import LINES, contract
from surfel.bounding.enclosure import extended

BOUNDARIES = ["open", "clamped"]


def spline_of(b, boundary):
    n = len(b)
    return BSpline(np.arange(-3.0, n + 3.0), extended(b, boundary), 3)


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_the_enclosures_lie_below_the_spline_everywhere(boundary):
    rng = np.random.default_rng(0)
    for _ in range(50):
        n = int(rng.integers(2, 20))
        b = rng.standard_normal(n)
        dense = np.linspace(0.0, n - 1.0, 400)
        value = spline_of(b, boundary)(dense)
        line = np.interp(dense, np.arange(n), lower_broken_line(b, boundary))  # eq. (3), Lemma 4.1
        assert (value - line).min() > -1e-12
        knots = np.unique(np.concatenate([np.arange(n), rng.random(30) * (n - 1)]))  # eq. (5), Lemma 5.1
        finer = np.interp(dense, knots, lower_at(b, knots, boundary))
        assert (value - finer).min() > -1e-12
        assert (lower_at(b, np.arange(n), boundary) == lower_broken_line(b, boundary)).all()


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_the_broken_line_is_met_in_three_solves_also_with_free_points(boundary):
    rng = np.random.default_rng(1)
    most = 0
    for _ in range(300):
        n = int(rng.integers(2, 40))
        line = rng.standard_normal(n) * 10.0 ** rng.integers(-6, 7)
        free = rng.random(n) < rng.choice([0.0, 0.3, 0.9])
        fit = broken_line_surrogate(line, free, boundary)
        assert not fit.fallback
        most = max(most, fit.solves)
        if not free.all():
            reach = np.abs(line[~free]).max()
            assert np.abs(lower_broken_line(fit.b, boundary) - line)[~free].max() < 1e-12 * reach
            assert np.abs(fit.b).max() < 3.0 * reach  # energy fills tamely
        second = np.diff(fit.b, 2)[free[1:-1]]
        assert np.abs(second).max(initial=0.0) < 1e-9 * max(np.abs(fit.b).max(), 1e-300)
    assert most <= 5


def test_one_datum_makes_a_constant_and_none_a_zero():
    free = np.array([True, True, False, True])
    assert (broken_line_surrogate([9.0, 9.0, 2.5, 9.0], free).b == 2.5).all()
    assert (broken_line_surrogate([9.0, 9.0], [True, True]).b == 0.0).all()


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_the_contraction_reaches_the_same_solution(boundary):
    def contracted(line, free):
        side_by_side = (np.repeat(np.asarray(a, float)[:, None], LINES, axis=1) for a in (line, free))
        b = np.empty((len(line), LINES))
        contract(*side_by_side, boundary == "open", b, 3)
        return b[:, 3]

    rng = np.random.default_rng(2)
    for _ in range(40):
        line = rng.standard_normal(15)
        b = contracted(line, np.zeros(15))
        assert np.abs(b - broken_line_surrogate(line, None, boundary).b).max() < 1e-12
    free = np.array([True, False, True, True, False])
    b = contracted(np.array([9.0, 1.0, 9.0, 9.0, 4.0]), free)
    assert b.max() < 5.0 and (lower_broken_line(b, boundary)[~free] >= [1.0 - 1e-12, 4.0 - 1e-12]).all()


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("fit", [scattered_surrogate, trial_and_error])
def test_scattered_data_lie_below_the_curve(fit, boundary):
    rng = np.random.default_rng(3)
    solves = []
    for i in range(200):
        n, count = int(rng.integers(4, 40)), int(rng.choice([1, 2, 5, 30, 300]))
        t = rng.random(count) * (n - 1)
        y = rng.standard_normal(count) if i % 2 else np.sin(t / 3)
        found = fit(t, y, n, None, boundary)
        reach = np.ptp(y) or 1.0
        assert (spline_of(found.b, boundary)(t) - y).min() > -1e-9 * reach
        if fit is scattered_surrogate:
            assert (lower_at(found.b, t, boundary) - y).min() > -1e-9 * reach
        assert np.abs(found.b - y.mean()).max() <= 14.0 * reach
        solves.append(found.solves)
    if fit is scattered_surrogate:  # Fig. 9: mostly at most 10, rarely 20
        assert np.percentile(solves, 90) <= 10


def test_points_close_together_end_in_the_plain_scheme():
    rng = np.random.default_rng(4)
    gave_up = 0
    for _ in range(60):
        n = int(rng.integers(6, 20))
        t = rng.random(8) * (n - 1)
        half = rng.integers(0, n - 1) + 0.5
        t[:2] = half - 1e-7, half + 1e-7
        y = rng.random(8)
        found = scattered_surrogate(t, y, n)
        gave_up += found.fallback
        assert np.abs(found.b).max() < 10.0
        assert (spline_of(found.b, "clamped")(t) >= y - 1e-9).all()
    assert gave_up > 0


def test_labelled_segments_are_left_to_energy():
    t = np.linspace(0.0, 9.0, 200)
    y = np.where(np.abs(t - 5.0) < 0.6, 3.0, 0.0)
    free = np.zeros(10, bool)
    free[4:7] = True
    assert np.abs(scattered_surrogate(t, y, 10, free).b).max() < 0.2
    curve = surfel.bound_curve(t, y, 10, free=free)
    assert curve.verify(t, y) == (0, 0.0)


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("side", ["above", "below"])
@pytest.mark.parametrize("method", ["scattered", "trial"])
def test_curves_are_safe_by_every_evaluator(method, side, boundary):
    rng = np.random.default_rng(5)
    sign = 1.0 if side == "above" else -1.0
    for i in range(40):
        n, count = int(rng.integers(4, 30)), int(rng.choice([1, 2, 5, 100]))
        x = rng.standard_normal(count) * 10.0 ** rng.integers(-9, 9) + rng.choice([0.0, 1e6])
        y = rng.standard_normal(count) * 10.0 ** rng.integers(-12, 12)
        if i % 5 == 0:
            x[:] = x[0]
        if i % 7 == 0:
            y[:] = y[0]
        curve = surfel.bound_curve(x, y, n, side, method, boundary)
        assert curve.verify(x, y) == (0, 0.0)
        t = curve.to_domain(x)
        gap = sign * (curve.to_scipy()(t) - y)
        assert (gap >= 0.0).all()
        tightest = int(np.argmin(gap))
        u = Fraction(float(t[tightest]))
        h = min(int(u), n - 2)
        u -= h
        q = 1 - u
        weights = [q**3, 4 + u * u * (3 * u - 6), 4 + q * q * (3 * q - 6), u**3]
        exact = sum(w * Fraction(float(c)) for w, c in zip(weights, curve.coefficients[h : h + 4], strict=True)) / 6
        assert sign * (exact - Fraction(float(y[tightest]))) >= 0
        if boundary == "clamped":
            assert curve.coefficients[0] == curve.coefficients[1] and curve.coefficients[-1] == curve.coefficients[-2]
    assert np.isnan(curve([x.min() - 1e3 * (np.ptp(x) + 1.0)])).all()
    assert curve.verify([x.max() + 1e3 * (np.ptp(x) + 1.0)], [0.0]) == (1, np.inf)


@pytest.mark.parametrize(
    ("x", "y", "options"),
    [
        ([], [], {}),
        ([0.0, np.nan], [0.0, 1.0], {}),
        ([0.0, 1.0], [0.0, np.inf], {}),
        ([0.0, 1.0], [0.0], {}),
        ([0.0, 1.0], [0.0, 1.0], {"n": 3}),
        ([0.0, 1.0], [0.0, 1.0], {"side": "left"}),
        ([0.0, 1.0], [0.0, 1.0], {"method": "best"}),
        ([0.0, 1.0], [0.0, 1.0], {"boundary": "free"}),
        ([0.0, 1.0], [0.0, 1.0], {"free": [True, False]}),
    ],
)
def test_bad_curves_are_refused(x, y, options):
    with pytest.raises(surfel.InputError):
        surfel.bound_curve(x, y, **options)


@pytest.mark.parametrize("call", [
    lambda: lower_broken_line([1.0]),
    lambda: lower_at([1.0, 2.0], [1.5]),
    lambda: lower_broken_line([1.0, np.nan]),
    lambda: broken_line_surrogate([1.0, 2.0], [True]),
    lambda: scattered_surrogate([5.0], [1.0], 4),
    lambda: scattered_surrogate([], [], 4),
    lambda: trial_and_error([1.0, 2.0], [1.0], 4),
])  # fmt: skip
def test_bad_pieces_are_refused(call):
    with pytest.raises(surfel.InputError):
        call()
