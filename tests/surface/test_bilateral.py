"""The bilateral filter: noise goes, edges stay, and no point moves by more than is told."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
from surfel.surface.bilateral import bilateral

RNG = np.random.default_rng(0)


def test_noise_on_a_sphere_falls():
    ball = truth.even_sphere(8000)
    noisy = ball.noisy(0.15)
    found = bilateral(noisy, ball.normals)
    before, after = (np.abs(np.linalg.norm(p, axis=1) - 1.0).std() for p in (noisy, found.points))
    assert after < 0.6 * before
    assert np.allclose(np.linalg.norm(found.normals, axis=1), 1.0)


def test_an_edge_stays_where_it_is():
    box = truth.box(12_000, 1)
    sigma = 0.1 * box.spacing
    noisy = box.points + sigma * RNG.standard_normal((12_000, 1)) * box.normals
    found = bilateral(noisy, box.normals)
    off = np.abs(np.abs(found.points) - 0.5).min(axis=1)
    near_edge = np.sort(np.abs(box.points), axis=1)[:, 1] > 0.5 - 1.5 * box.spacing
    assert np.sqrt(np.mean(off[~near_edge] ** 2)) < 0.6 * sigma
    assert np.median(off[near_edge]) < sigma  # a plain mean would move these by a spacing, ten times as far
    assert (np.einsum("ij,ij->i", found.normals, box.normals)[near_edge] > 0.7).mean() > 0.9


def test_points_of_a_plane_stay_to_the_last_bits():
    flat = truth.square(2000)
    found = bilateral(flat.points, flat.normals, 3)
    assert found.moved.max() < 1e-12 and np.allclose(found.normals, flat.normals)


@pytest.mark.parametrize("passes", [1, 3])
def test_moves_are_told_point_by_point(passes):
    ball = truth.sphere(3000)
    noisy = ball.noisy(0.3)
    found = bilateral(noisy, ball.normals, passes)
    assert np.allclose(found.moved, np.linalg.norm(found.points - noisy, axis=1), rtol=1e-12)
    assert found.moved.max() > 0.0


def test_signs_of_normals_change_no_place():
    ball = truth.sphere(2000)
    signs = np.where(RNG.random((2000, 1)) < 0.5, -1.0, 1.0)
    one, other = bilateral(ball.noisy(0.2), ball.normals), bilateral(ball.noisy(0.2), ball.normals * signs)
    assert np.allclose(one.points, other.points, atol=1e-12)
    assert np.allclose(one.normals * signs, other.normals, atol=1e-9)


def test_passes_follow_each_other():
    ball = truth.sphere(1500)
    once = bilateral(ball.noisy(0.2), ball.normals)
    again, both = bilateral(once.points, once.normals), bilateral(ball.noisy(0.2), ball.normals, 2)
    assert np.array_equal(again.points, both.points) and np.array_equal(again.normals, both.normals)


def test_few_points_and_no_passes():
    two = np.array([[0.0, 0, 0], [1, 0, 0]])
    up = np.tile([0.0, 0, 1.0], (2, 1))
    assert np.allclose(bilateral(two, up).points, two)
    assert bilateral(two, up, 0).moved.max() == 0.0
    assert np.array_equal(bilateral(np.zeros((4, 3)), np.tile([0.0, 0, 1], (4, 1))).points, np.zeros((4, 3)))
