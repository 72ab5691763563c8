"""Steps between close pairs, against planted noise."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.steps import LEAST_PAIRS, step_level


def level_of(points: np.ndarray) -> float:
    return step_level(Neighbourhoods.of(points, np.arange(len(points))))


def with_relief(n: int, seed: int) -> truth.Sampled:
    """Return a sphere whose relief is short against its radius, and hides small noise from wide fits."""
    ball = truth.sphere(n, seed)
    high = 1.0 + 0.03 * np.sin(12.0 * ball.points[:, :1]) * np.sin(11.0 * ball.points[:, 1:2])
    return truth.Sampled(ball.points * high, ball.normals, ball.area)


@pytest.mark.parametrize("sigma", [0.01, 0.02, 0.04])
@pytest.mark.parametrize("shape", [truth.sphere, truth.torus, with_relief])
def test_small_noise_is_recovered_though_there_is_relief(shape, sigma):
    assert level_of(shape(12000, 3).noisy(sigma, 4)) == pytest.approx(sigma, rel=0.25)


@pytest.mark.parametrize("shape", [truth.sphere, truth.torus, truth.box, truth.square, truth.cylinder, with_relief])
def test_clean_points_have_none(shape):
    assert level_of(shape(12000, 5).points) < 0.006


def test_more_noise_than_the_pairs_can_tell_is_not_overstated():
    assert 0.06 < level_of(truth.sphere(12000, 1).noisy(0.3, 2)) <= 0.1


def test_even_points_have_no_close_pairs():
    assert level_of(truth.even_sphere(3000, 1).points) == 0.0
    assert level_of(truth.sphere(LEAST_PAIRS, 1).points) == 0.0
    assert level_of(truth.sphere(5, 1).points) == 0.0


def test_two_sheets_half_a_spacing_apart_are_no_noise():
    lower, upper = truth.square(6000, 1), truth.square(6000, 2)
    apart = 0.5 * lower.spacing
    assert level_of(np.concatenate([lower.points, upper.points + [0.0, 0.0, apart]])) < 0.006


def test_order_and_place_change_nothing_but_rounding():
    points = with_relief(12000, 6).noisy(0.02, 7)
    moved = points[np.random.default_rng(8).permutation(len(points))] @ truth.rotation(9).T + 3.0
    assert level_of(moved) == pytest.approx(level_of(points), rel=1e-6)
