"""Results combined again: their own inside honours their clips."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import surfel
from booleans_with_truth import PI, area, ball, sampled

SMALL = surfel.Sphere(0.8).translated((0.5, 0.6, 0.0))


def test_a_chain_is_what_the_tree_is():
    a, b, c = ball(8000, 1), ball(8000, 2, x=1.0), sampled(SMALL, 5000, 3)
    exact = surfel.Sphere(1) | surfel.Sphere(1).translated((1, 0, 0))
    both = surfel.combine(a | b).surfels
    for chain, tree, truth in (
        (both - c, (a | b) - c, exact - SMALL),
        (c - both, c - (a | b), SMALL - exact),
        (both & c, (a | b) & c, exact & SMALL),
    ):
        one, other = surfel.combine(chain), surfel.combine(tree)
        true = surfel.measure(truth).area.value
        assert area(one) == pytest.approx(true, rel=2e-3)
        assert area(one) == pytest.approx(area(other), rel=1e-3)
        assert not one.leaky


def test_three_drills_one_after_the_other():
    part, exact = ball(8000, 1), surfel.Sphere(1)
    for x in (-0.4, 0.0, 0.4):
        drill = surfel.Cylinder(0.15, 4.0).translated((x, 0.0, 0.0))
        part, exact = surfel.combine(part - drill).surfels, exact - drill
    assert float(part.clips.areas.sum()) == pytest.approx(surfel.measure(exact).area.value, rel=3e-3)
    assert surfel.measure(part, lines=4096).closed


def test_a_cut_crossed_again_keeps_both_planes():
    a = ball(8000, 1)
    quarter = surfel.combine(
        surfel.combine(a & surfel.HalfSpace((1, 0, 0), 0.0)).surfels & surfel.HalfSpace((0, 1, 0), 0.0)
    )
    assert area(quarter) == pytest.approx(PI + PI, rel=2e-3)
    assert quarter.surfels.clips.counts.max() >= 2


def test_the_inside_of_a_result_is_not_disturbed_by_what_hangs_over():
    lens = surfel.combine(ball(8000, 1) & ball(8000, 2, x=1.0)).surfels
    rng = np.random.default_rng(0)
    places = rng.uniform([-0.2, -1, -1], [1.2, 1, 1], (4000, 3))
    true = (np.linalg.norm(places, axis=1) < 1.0) & (np.linalg.norm(places - [1, 0, 0], axis=1) < 1.0)
    found = surfel.Classifier(lens).classify(places).inside
    assert (found != true).mean() < 2e-3


def test_results_survive_pickling_slicing_and_motion():
    result = surfel.combine(ball(3000, 1) - ball(3000, 2, x=1.0)).surfels
    again = pickle.loads(pickle.dumps(result))
    assert np.array_equal(again.clips.areas, result.clips.areas)
    assert np.array_equal(again.clips.planes, result.clips.planes)
    some = np.arange(0, len(result), 3)
    assert np.array_equal(result[some].clips.areas, result.clips.areas[some])
    twice = result.scaled(2.0).rotated((1, 1, 0), 30.0)
    assert twice.clips.areas == pytest.approx(4.0 * result.clips.areas)
    assert surfel.measure(twice, lines=4096).area.value == pytest.approx(16.0 * PI, rel=1e-3)
    joined = result + ball(2000, 3, 1.0, 9.0)
    assert float(joined.clips.areas.sum()) == pytest.approx(8.0 * PI, rel=1e-3)
