"""Surfaces that cross at flat angles are cut, not taken for one; what is one and the same is not cut."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from booleans_with_truth import PI, area, sampled


def shifted(shift, seed, n=6000):
    return sampled(surfel.Sphere(1.0).translated((shift, 0.0, 0.0)), n, seed, "random")


@pytest.mark.parametrize("shift", [0.3, 0.24], ids=["17 degrees", "14 degrees"])
def test_balls_that_cross_at_a_flat_angle(shift):
    a, b = shifted(0.0, 1), shifted(shift, 2)
    union, common = 4.0 * PI * (1.0 + 0.5 * shift), 4.0 * PI * (1.0 - 0.5 * shift)
    for tree, true in ((a | b, union), (b | a, union), (a & b, common), (b & a, common), (a - b, 4.0 * PI)):
        assert area(surfel.combine(tree)) == pytest.approx(true, rel=2e-3)


def test_a_scan_and_an_exact_ball_that_cross_at_a_flat_angle():
    a, b = shifted(0.0, 1), surfel.Sphere(1.0).translated((0.3, 0.0, 0.0))
    assert area(surfel.combine(a - b)) == pytest.approx(4.0 * PI, rel=3e-3)
    assert area(surfel.combine(a | b)) == pytest.approx(4.0 * PI * 1.15, rel=2e-3)


def test_one_surface_sampled_twice_is_one_also_where_normals_and_places_are_noisy():
    clouds = []
    for seed in (1, 2):
        clean, rng = shifted(0.0, seed), np.random.default_rng(seed)
        tilt = np.tan(np.radians(3.0)) / np.sqrt(2.0) * rng.standard_normal(clean.points.shape)
        off = 0.05 * np.sqrt(4.0 * PI / len(clean)) * rng.standard_normal(clean.points.shape)
        clouds.append(surfel.Surfels(clean.points + off, clean.normals + tilt))
    a, b = clouds
    assert area(surfel.combine(a | b)) == pytest.approx(4.0 * PI, rel=5e-3)
    assert area(surfel.combine(a & b)) == pytest.approx(4.0 * PI, rel=5e-3)
    assert area(surfel.combine(a - b)) < 5e-3 * 4.0 * PI
