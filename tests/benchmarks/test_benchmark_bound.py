"""What the benchmarks of safe splines measure with is right: their clouds, their basis, their exact evaluation."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from benchmarks.heights import CONFIGURATIONS, RANDOM, balls

import surfel
from benchmarks import myles2005, myles2005_checks, myles2005_counts, peers_bound


@pytest.mark.parametrize("name", RANDOM)
def test_clouds_are_finite_of_the_size_asked_for_and_the_same_again(name):
    one, again = (RANDOM[name](500, np.random.default_rng(3)) for _ in range(2))
    assert one.shape == (500, 3) and np.isfinite(one).all()
    np.testing.assert_array_equal(one, again)


def test_the_balls_move_apart():
    reach = [np.ptp(balls(4000, np.random.default_rng(0), step), axis=0) for step in range(CONFIGURATIONS)]
    assert (np.diff(reach, axis=0) > 0.0).all()
    assert np.linalg.norm(balls(1000, np.random.default_rng(0), 0), axis=1).max() <= 1.0


def test_the_programs_basis_is_that_of_the_surface():
    points = RANDOM["smooth"](400, np.random.default_rng(0))
    fitted = surfel.bound(points, shape=peers_bound.GRID)
    basis = peers_bound.Domain(*fitted.to_domain(points)).basis()
    np.testing.assert_allclose(basis @ fitted.coefficients.ravel(), fitted(points), atol=1e-13)
    np.testing.assert_allclose(np.asarray(basis.sum(axis=1)).ravel(), 1.0, atol=1e-14)


def test_the_program_is_a_lower_bound_and_nearly_safe():
    points = RANDOM["cliff"](1500, np.random.default_rng(0))
    best, _, _ = peers_bound.by_linear_program(points)
    tight, _, _ = peers_bound.by_surfel(points, "tight")
    lifted, _, _ = peers_bound.by_least_squares(points)
    assert best.min() > -1e-6 and tight.min() >= 0.0 and lifted.min() >= -1e-12
    assert best.mean() <= tight.mean() <= lifted.mean()


def test_exact_values_are_those_of_the_kernel():
    points = RANDOM["terrain"](2000, np.random.default_rng(0))
    fitted = surfel.bound(points, shape=(7, 9))
    uv, _ = fitted.to_domain(points[:50])
    for place, value in zip([*uv, np.array([6.0, 8.0])], [*fitted(uv), float(fitted([[6.0, 8.0]])[0])], strict=True):
        exact = myles2005_checks.exact_value(fitted, *place)
        assert isinstance(exact, Fraction)
        assert np.isnan(value) or abs(float(exact) - value) < 1e-13


def test_lines_are_counted_once_each():
    scattered, uniform, _ = myles2005_counts.counts(3000, configurations=1)
    assert sum(scattered.values()) <= myles2005_counts.SIDE and sum(uniform.values()) == myles2005_counts.SIDE


def test_parts_run_and_say_what_was_aimed_at(monkeypatch):
    monkeypatch.setattr(
        myles2005_checks, "_cases", lambda quick: [("smooth", RANDOM["smooth"](60_000, np.random.default_rng(0)))]
    )
    text = myles2005_checks.checks(quick=True)
    assert "0 violations: a short run" in text and "| tight |" in text


def test_parts_take_the_place_of_older_ones_in_a_file(tmp_path, monkeypatch):
    out = tmp_path / "myles2005.md"
    monkeypatch.setitem(myles2005.PARTS, "table1", lambda quick: "## Table 1\n\none")
    monkeypatch.setitem(myles2005.PARTS, "checks", lambda quick: "## Checks\n\nnone")
    myles2005.run(["checks", "table1"], str(out))
    monkeypatch.setitem(myles2005.PARTS, "checks", lambda quick: "## Checks\n\nnone again")
    text = myles2005.run(["checks"], str(out))
    assert out.read_text(encoding="utf-8") == text
    assert text.index("## Table 1") < text.index("none again") and "none\n" not in text and text.count("<!--") == 2
