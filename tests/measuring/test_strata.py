"""Areas of single leaves in trees: closed forms under any affine map, and honest errors where a cut hides."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from primitives_with_truth import CASES
from surfel.core.estimate import Estimate, at_best_halved
from surfel.measuring.by_patches import measure_by_patches
from surfel.shapes.stretched import area_under

CLOSED = [
    case
    for case in CASES
    if isinstance(case.shape, surfel.Box | surfel.Sphere | surfel.Ellipsoid | surfel.Cylinder | surfel.Cone)
]
SAMPLED = [case for case in CASES if case.shape.sampled]


@pytest.mark.parametrize("case", CLOSED, ids=lambda case: case.name)
def test_areas_under_any_map_are_those_of_samples(case):
    linear = np.random.default_rng(2).standard_normal((3, 3))
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    elements = case.shape.transformed(matrix).patches(1 << 16)
    assert area_under(case.shape, linear) == pytest.approx(elements.areas.sum(), rel=2e-4)
    assert area_under(case.shape, np.eye(3)) == pytest.approx(case.shape.area, rel=1e-14)


def test_an_ellipsoid_is_an_affine_image_of_a_sphere():
    image = surfel.Sphere(1).scaled((1.0, 2.0, 3.0)).rotated((1, 2, 3), 40.0)
    assert surfel.measure(image).area.value == pytest.approx(surfel.Ellipsoid((1, 2, 3)).area, rel=1e-13)
    assert surfel.measure(surfel.Box(2).scaled((1.0, 2.0, 3.0))).area.value == pytest.approx(88.0, rel=1e-13)
    assert surfel.measure(surfel.Torus(2, 1).scaled(3)).area.value == pytest.approx(9 * 8 * np.pi**2, rel=1e-13)


@pytest.mark.parametrize("points", [1024, 16_384])
@pytest.mark.parametrize("case", SAMPLED, ids=lambda case: case.name)
def test_a_stretched_leaf_that_is_cut_away_elsewhere_keeps_its_area(case, points):
    """The same surface in two trees: alone, and beside a leaf that its box meets but it does not."""
    matrix = np.diag([1.0, 0.5, 3.0, 1.0])
    leaf = case.shape.transformed(matrix)
    truth = leaf.patches(1 << 18).areas.sum()
    corner = np.asarray(leaf.bounds)[1] * (1.0, 1.0, 0.999)
    speck = surfel.Sphere(1e-3 * case.size).translated(corner)
    for tree in (surfel.Union(leaf), leaf - speck):
        off = []
        for seed in range(4):
            area = measure_by_patches(tree, np.asarray(tree.bounds), points, seed).area
            off.append((float(area.value) - truth) / (float(area.standard_error) + 1e-4 * truth))
        assert np.sqrt(np.mean(np.square(off))) < 2.5


def test_a_feature_smaller_than_a_cell_is_in_the_error():
    """A needle that no cell of the ball is likely to see: what may hide is counted whether seen or not."""
    needle = surfel.Cylinder(0.02, 4.0)
    tree = surfel.Sphere(1) - needle
    truth = 4.0 * np.pi + 2.0 * np.pi * 0.02 * 2.0 - 2.0 * np.pi * 0.02**2
    held = []
    for seed in range(40):
        low, high = measure_by_patches(tree, np.asarray(tree.bounds), 1024, seed).area.interval(0.95)
        held.append(low <= truth <= high)
    assert np.mean(held) >= 0.85


def test_an_error_at_best_halves_when_points_double():
    before = Estimate(10.0, 1.0)
    assert at_best_halved(Estimate(10.0, 0.2), before).standard_error == 0.5
    assert at_best_halved(Estimate(10.0, 0.7), before).standard_error == 0.7
    assert at_best_halved(Estimate(9.0, 0.2, freedom=15.0), before).value == 9.0
