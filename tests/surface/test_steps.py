"""Steps between close pairs, against planted noise."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
from surfel.surface.close_sheets import faces_one_way, has_close_sheets
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.patches import local_patches
from surfel.surface.steps import DENIED_BELOW, LEAST_PAIRS, given_level, step_level


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


def sheets(gap: float, up: float) -> tuple[np.ndarray, np.ndarray]:
    """Return two squares ``gap`` spacings apart, the lower one facing down, the upper one along ``up``."""
    lower, upper = truth.square(6000, 1), truth.square(6000, 2)
    points = np.concatenate([lower.points, upper.points + [0.0, 0.0, gap * lower.spacing]])
    return points, np.repeat([[0.0, 0.0, -1.0], [0.0, 0.0, up]], 6000, axis=0)


@pytest.mark.parametrize("gap", [0.5, 1.0, 2.0])
def test_given_normals_tell_close_sheets_from_noise(gap):
    points, normals = sheets(gap, 1.0)
    hood = Neighbourhoods.of(points, np.arange(len(points)))
    assert given_level(hood, normals[hood.rows]) < 1e-6
    local = local_patches(hood, normals)
    assert local.noise < 1e-6
    assert local.area == pytest.approx(2.0, rel=0.006)  # most of that is the borders


def test_given_normals_do_not_deny_noise():
    ball = truth.sphere(8000, 1)
    points = ball.noisy(0.3, 2)
    hood = Neighbourhoods.of(points, np.arange(len(points)))
    assert given_level(hood, ball.normals[hood.rows]) > DENIED_BELOW
    assert local_patches(hood, ball.normals).noise == pytest.approx(0.3, rel=0.15)


def test_unknown_and_wrong_normals_are_not_believed():
    ball = truth.sphere(4000, 1)
    hood = Neighbourhoods.of(ball.points, np.arange(len(ball.points)))
    assert given_level(hood, np.zeros_like(ball.points)) > DENIED_BELOW
    wrong = np.random.default_rng(0).standard_normal(ball.points.shape)
    assert given_level(hood, wrong / np.linalg.norm(wrong, axis=1, keepdims=True)) > DENIED_BELOW


def test_layers_of_scans_face_one_way_and_plates_do_not():
    for up, layers in ((1.0, False), (-1.0, True)):
        points, normals = sheets(0.7, up)
        hood = Neighbourhoods.of(points, np.arange(len(points)))
        assert has_close_sheets(hood, normals[hood.rows])
        assert faces_one_way(hood, normals[hood.rows]) is layers
    signs = np.random.default_rng(3).choice([-1.0, 1.0], (len(points), 1))
    assert not faces_one_way(hood, (normals * signs)[hood.rows])


@pytest.mark.parametrize("shape", [truth.sphere, truth.torus, truth.box, with_relief])
def test_one_sheet_is_not_taken_for_two(shape):
    cloud = shape(6000, 1)
    hood = Neighbourhoods.of(cloud.points, np.arange(len(cloud.points)))
    assert not has_close_sheets(hood, cloud.normals[hood.rows])


def test_order_and_place_change_nothing_but_rounding():
    points = with_relief(12000, 6).noisy(0.02, 7)
    moved = points[np.random.default_rng(8).permutation(len(points))] @ truth.rotation(9).T + 3.0
    assert level_of(moved) == pytest.approx(level_of(points), rel=1e-6)
