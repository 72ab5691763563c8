"""Resampling: gaps are filled on the curved surface, dense parts and edges are left alone."""

from __future__ import annotations

import numpy as np

import shapes_with_truth as truth
from surfel.surface.resample import FAR, resample


def farthest_hole(points, places):
    """Return the largest distance from places of the surface to the nearest point."""
    return max(np.sqrt(np.square(points - place).sum(axis=1).min()) for place in places)


def test_gaps_on_a_sphere_are_filled_on_the_sphere():
    ball = truth.even_sphere(1500)
    more, sides = resample(ball.points, ball.normals, 0.03)
    places = truth.sphere(300, 9).points
    assert np.array_equal(more[:1500], ball.points) and np.array_equal(sides[:1500], ball.normals)
    assert len(more) > 4000 and farthest_hole(more, places) < 0.6 * farthest_hole(ball.points, places)
    assert np.abs(np.linalg.norm(more, axis=1) - 1.0).max() < 1e-3
    assert np.einsum("ij,ij->i", more, sides).min() > 0.999


def test_new_points_keep_their_distance():
    ball = truth.even_sphere(800)
    more, _ = resample(ball.points, ball.normals, 0.05)
    new = more[800:]
    apart = np.sqrt(np.square(new[:, None] - more[None]).sum(axis=2))
    apart[np.arange(len(new)), 800 + np.arange(len(new))] = np.inf
    assert apart.min() > 0.7 * 0.05 * (1.0 - 1e-9)


def test_a_dense_cloud_is_left_alone():
    ball = truth.even_sphere(2000)
    same, _ = resample(ball.points, ball.normals, 0.2)
    assert np.array_equal(same, ball.points)


def test_nothing_is_put_across_an_edge_or_between_two_sides():
    p = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    for normals in ([[0, 0, 1.0], [1.0, 0, 0]], [[0, 0, 1.0], [0, 0, -1.0]]):
        assert len(resample(p, np.array(normals), 0.1)[0]) == 2
    assert len(resample(p, np.array([[0, 0, 1.0], [0, 0, 1.0]]), 0.1)[0]) > 2


def test_the_number_of_points_is_bounded():
    ball = truth.sphere(100)
    more, _ = resample(ball.points, ball.normals, 1e-4)
    assert len(more) <= 16 * 100 and FAR > 1.0
