"""Distance skipping: nothing gets wrong by it, and places far away or equally far cost next to nothing."""

from __future__ import annotations

import numpy as np
import pytest

from shapes_with_truth import box, sphere, uneven_sphere
from surfel.inside.judges import named
from surfel.inside.judges.nearest import _rule
from surfel.inside.judges.skipping import judge_by, look_with
from surfel.inside.operand import Operand

NEIGHBOUR_JUDGES = ("nearest", "two-nearest", "two-cluster", "imls", "mls")


class Counted:
    """Judges by the nearest surfel, and counts what it is asked."""

    def __init__(self) -> None:
        self.asked = 0
        self._look = look_with(_rule, 1)

    def __call__(self, operand, places):
        self.asked += len(places)
        return self._look(operand, places)


@pytest.mark.parametrize("name", NEIGHBOUR_JUDGES)
@pytest.mark.parametrize("shape", ["box", "uneven"])
def test_skipping_makes_nothing_worse(name, shape):
    cloud = box(4000, 1, (1.0, 0.7, 0.2)) if shape == "box" else uneven_sphere(4000)
    operand = Operand.of(cloud.points, cloud.normals)
    places = np.random.default_rng(1).uniform(-1.3, 1.3, (20_000, 3))
    inside = (np.abs(places) < [0.5, 0.35, 0.1]).all(axis=1) if shape == "box" else (places**2).sum(axis=1) < 1.0
    with_it, without = (named(name)(operand, places, skip=skip) for skip in (True, False))
    assert np.mean(with_it.inside != inside) < np.mean(without.inside != inside) + 5e-4
    assert np.mean(with_it.inside != inside) < 4e-3
    both = with_it.certain & without.certain
    assert np.mean(with_it.inside[both] != without.inside[both]) < 5e-4


def test_skipped_values_are_lower_bounds_of_the_distance():
    cloud = sphere(3000)
    operand = Operand.of(cloud.points, cloud.normals)
    places = np.random.default_rng(2).uniform(-3.0, 3.0, (20_000, 3))
    value = named("nearest")(operand, places).value
    from scipy.spatial import cKDTree

    assert (np.abs(value) <= cKDTree(cloud.points).query(places)[0] * (1.0 + 1e-12)).all()


@pytest.mark.parametrize("away", [1e6, 1e12])
def test_places_a_million_spacings_away_are_settled_at_once(away):
    cloud = sphere(20_000)
    operand = Operand.of(cloud.points, cloud.normals)
    look = Counted()
    places = sphere(50_000, seed=3).points + [away * operand.spacing, 0.0, 0.0]
    assert not judge_by(look, operand, places, skip=True).inside.any()
    assert look.asked <= 2


def test_places_in_the_middle_of_a_sphere_are_settled_at_once():
    cloud = sphere(20_000)
    operand = Operand.of(cloud.points, cloud.normals)
    look = Counted()
    places = sphere(50_000, seed=3).points * 1e-3
    assert judge_by(look, operand, places, skip=True).inside.all()
    assert look.asked <= 2


def test_unknown_normals_do_not_bring_the_far_places_back():
    cloud = sphere(20_000)
    operand = Operand.of(cloud.points, np.zeros_like(cloud.points))
    look = Counted()
    found = judge_by(look, operand, sphere(50_000, seed=3).points * 1e-3, skip=True)
    assert look.asked <= 2 and not found.inside.any() and not found.certain.any()


def test_far_and_near_places_at_once_cost_what_the_near_ones_cost():
    cloud = sphere(20_000)
    operand = Operand.of(cloud.points, cloud.normals)
    rng = np.random.default_rng(4)
    near = sphere(20_000, seed=5).points * (1.0 + rng.uniform(-1.0, 1.0, (20_000, 1)) * operand.spacing)
    far = rng.standard_normal((20_000, 3)) * 1e4
    alone, together = Counted(), Counted()
    judge_by(alone, operand, near, skip=True)
    inside = judge_by(together, operand, np.concatenate([near, far]), skip=True).inside
    assert together.asked < alone.asked + 6000
    assert np.array_equal(inside[20_000:], np.linalg.norm(far, axis=1) < 1.0)


@pytest.mark.parametrize("name", [*NEIGHBOUR_JUDGES, "winding", "indicator"])
def test_every_judge_answers_far_places(name):
    cloud = sphere(3000)
    operand = Operand.of(cloud.points, cloud.normals)
    for away in (1e3, 1e9, 1e100):
        places = sphere(2000, seed=6).points * [1.0, 1.0, 0.1] + [0.0, 0.0, away]
        assert not named(name)(operand, places).inside.any()


@pytest.mark.parametrize("name", NEIGHBOUR_JUDGES)
def test_without_skipping_far_places_end_too(name):
    cloud = sphere(3000)
    operand = Operand.of(cloud.points, cloud.normals)
    places = sphere(500, seed=6).points + [1e6 * operand.spacing, 0.0, 0.0]
    assert not named(name)(operand, places, skip=False).inside.any()
