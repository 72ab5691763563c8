"""No point on the wrong side: by our kernel, by SciPy's evaluator and in exact rationals; on all degenerate input."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import surfel

MODES = ["paper", "fast", "tight"]
RNG = np.random.default_rng(11)


def exact_value(coefficients, u, v):
    """Evaluate the spline in rational arithmetic, by the formula of the uniform cubic B-spline."""

    def weights(t):
        q = 1 - t
        return [q**3, 4 + t * t * (3 * t - 6), 4 + q * q * (3 * q - 6), t**3]

    u, v = Fraction(float(u)), Fraction(float(v))
    h, k = min(int(u), coefficients.shape[0] - 4), min(int(v), coefficients.shape[1] - 4)
    a, b = weights(u - h), weights(v - k)
    return sum(a[i] * b[j] * Fraction(float(coefficients[h + i, k + j])) for i in range(4) for j in range(4)) / 36


def check_safe(spline, points, tightest=4):
    """Assert the guarantee by three evaluators, and what the report says."""
    assert spline.verify(points) == (0, 0.0)
    uv, heights = spline.to_domain(points)
    sign = 1.0 if spline.side == "above" else -1.0
    values = spline.to_scipy()(uv)
    assert (sign * values >= sign * heights).all()
    assert (sign * spline(uv) >= sign * heights).all()  # a NaN outside the trim would fail
    gap = sign * (values - heights)
    for i in np.argsort(gap)[:tightest]:
        assert sign * (exact_value(spline.coefficients, *uv[i]) - Fraction(float(heights[i]))) >= 0
    reach = float(np.ptp(heights)) or float(np.abs(heights).max())
    rounding = 1e-9 * reach + 2.0 * spline.report.slack
    assert spline.report.gap_mean == pytest.approx(gap.mean(), rel=1e-6, abs=rounding)
    assert spline.report.gap_max >= gap.max() - rounding
    return gap


def lattice():
    x, y = np.meshgrid(np.arange(0.0, 10.0, 0.5), np.arange(0.0, 10.0, 0.5))
    return np.column_stack([x.ravel(), y.ravel(), RNG.random(x.size)])


def with_rows(points, column, value):
    points = points.copy()
    points[:, column] = value
    return points


def spiked(height):
    points = RNG.random((200, 3)) * [1.0, 1.0, 1e-12]
    points[7, 2] = height
    return points


PAIR = RNG.random((60, 3))
PAIR[1] = PAIR[0] + [1e-9, 0.0, 0.7]
LINE = RNG.random(100)
DEGENERATE = {
    "one point": RNG.random((1, 3)),
    "two points": RNG.random((2, 3)),
    "five points": RNG.random((5, 3)),
    "all x equal": with_rows(RNG.random((100, 3)), 0, 0.3),
    "all points equal": np.tile(RNG.random(3), (50, 1)),
    "collinear": np.column_stack([LINE, 2 * LINE + 1, 3 * LINE]),
    "vertical line": np.column_stack([np.zeros(50), np.zeros(50), RNG.random(50)]),
    "constant height": with_rows(RNG.random((200, 3)), 2, 0.1),
    "half-integer lattice": lattice(),
    "two points 1e-9 apart": PAIR,
    "1e12 beside 1e-12": spiked(1e12),
    "-1e12 beside 1e-12": spiked(-1e12),
    "big hole": np.concatenate([RNG.random((100, 3)), RNG.random((100, 3)) + [50.0, 70.0, 0.0]]),
    "far from the origin": RNG.random((300, 3)) * [100.0, 100.0, 20.0] + [5e5, 5e6, 100.0],
    "tiny": RNG.random((300, 3)) * 1e-300,
    "vast": RNG.standard_normal((300, 3)) * 1e299,
    "denormal": RNG.random((30, 3)) * 1e-320,
}
OPTIONS = [
    {},
    {"boundary": "clamped", "shape": (4, 7)},
    {"side": "below", "shape": (30, 5)},
    {"direction": (1.0, 2.0, 3.0), "symmetric": True, "shape": 8},
    {"chunks": 3},
]


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_input_gives_a_safe_answer(name, mode):
    points = DEGENERATE[name]
    for options in OPTIONS:
        options = dict(options)
        parts = options.pop("chunks", None)
        given_points = [points[i::parts] for i in range(parts)] if parts else points
        spline = surfel.bound(given_points, mode=mode, **options)
        check_safe(spline, points)
        heights = spline.to_domain(points)[1]
        reach = float(np.ptp(heights)) or float(np.abs(heights).max())
        if name != "denormal":  # where the slack is larger than the data
            assert np.abs(spline.coefficients - heights.mean()).max() <= 10.0 * reach


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("boundary", ["open", "clamped"])
def test_random_clouds_are_bounded_tightly_from_both_sides(mode, boundary):
    for n in (50, 3000):
        points = np.random.default_rng(n).standard_normal((n, 3))
        for side in ("above", "below"):
            gap = check_safe(surfel.bound(points, shape=(12, 9), mode=mode, boundary=boundary, side=side), points)
            assert gap.min() < 1e-2 * gap.max()  # it touches


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 200),
    mode=st.sampled_from(MODES),
    boundary=st.sampled_from(["open", "clamped"]),
    side=st.sampled_from(["above", "below"]),
    shape=st.tuples(st.integers(4, 24), st.integers(4, 24)),
    power=st.integers(-12, 12),
    direction=st.sampled_from([(0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 2, 0.5)]),
)
def test_every_cloud_is_bounded(seed, count, mode, boundary, side, shape, power, direction):
    rng = np.random.default_rng(seed)
    points = rng.standard_normal((count, 3)) * [1.0, 10.0 ** rng.integers(-3, 4), 10.0**power] + 10.0 ** rng.integers(
        -3, 4
    )
    points[rng.random(count) < 0.2] = points[0]
    check_safe(surfel.bound(points, direction, shape, side, mode, boundary), points)


def test_the_clamped_rule_holds_to_the_last_bit():
    points = np.random.default_rng(1).random((500, 3))
    for mode in MODES:
        c = surfel.bound(points, mode=mode, boundary="clamped").coefficients
        assert (c[0] == c[1]).all() and (c[-1] == c[-2]).all()
        assert (c[:, 0] == c[:, 1]).all() and (c[:, -1] == c[:, -2]).all()


def test_a_violation_is_counted_and_measured():
    points = np.random.default_rng(2).random((400, 3))
    lid = surfel.bound(points)
    uv, heights = lid.to_domain(points)
    above = points.copy()
    above[17, 2] += (lid(uv) - heights)[17] + 0.25
    count, worst = lid.verify(above)
    assert count == 1 and worst == pytest.approx(0.25)
    assert lid.verify([[9.0, 9.0, -5.0]]) == (1, np.inf)  # outside: the surface says nothing there
    assert lid.verify([above[:200], above[200:]]) == (count, worst)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.empty((0, 3)), "at least one point"),
        ([], "at least one point"),
        ([[0.0, 0.0, np.nan]], "not finite"),
        ([[0.0, 0.0, np.inf]], "not finite"),
        ([np.zeros((2, 3)), np.full((1, 3), np.nan)], "not finite"),
        (np.zeros((3, 2)), "shape"),
        (np.full((3, 3), 1e305), "scale them down"),
        (None, "NoneType"),
        ("abc", "str"),
        ((chunk for chunk in [np.zeros((3, 3))]), "only once"),
    ],
)
def test_bad_points_are_refused(points, words):
    with pytest.raises(surfel.InputError, match=words):
        surfel.bound(points)


@pytest.mark.parametrize(
    "options",
    [
        {"shape": (3, 20)},
        {"shape": (20, 3)},
        {"shape": (4, 4, 4)},
        {"shape": 5.5},
        {"direction": (0, 0, 0)},
        {"direction": (0, np.nan, 1)},
        {"mode": "best"},
        {"side": "left"},
        {"boundary": "free"},
    ],
)
def test_bad_options_are_refused(options):
    with pytest.raises(surfel.InputError):
        surfel.bound(np.random.default_rng(0).random((9, 3)), **options)


def test_a_mesh_is_refused_because_its_faces_may_reach_beyond():
    mesh = surfel.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    with pytest.raises(surfel.InputError, match="Mesh"):
        surfel.bound(mesh)


def test_a_cloud_and_its_points_give_the_same_surface():
    points = np.random.default_rng(4).random((700, 3))
    cloud = surfel.bound(surfel.Surfels(points))
    assert (cloud.coefficients == surfel.bound(points).coefficients).all()
    assert (cloud.coefficients == surfel.bound(points).coefficients).all()  # and again
