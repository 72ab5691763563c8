"""The smallest ball: against brute force, and with a certificate that no smaller one exists."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from surfel.core.errors import InputError
from surfel.lines.enclosing import Ball, smallest_ball

RNG = np.random.default_rng(42)


def brute_force(points):
    """The smallest ball through one to four points that holds all of them."""
    best = np.inf
    for size in range(1, 5):
        for subset in combinations(points, min(size, len(points))):
            edges = np.array(subset[1:]).reshape(-1, 3) - subset[0]
            centre = subset[0] + np.linalg.lstsq(2.0 * edges, np.square(edges).sum(axis=1), rcond=1e-10)[0]
            best = min(best, np.linalg.norm(points - centre, axis=1).max())
    return best


def assert_smallest(points, tolerance=1e-9):
    """Every point lies inside, and the centre is a convex combination of the points on the sphere."""
    centre, radius = smallest_ball(points)
    away = np.linalg.norm(points - centre, axis=1)
    size = np.abs(points - points[0]).max() + np.finfo(float).eps * np.abs(points).max()
    assert away.max() <= radius + 1e-12 * size
    if radius == 0.0:
        return
    support = points[away > radius * (1.0 - tolerance)]
    matrix = np.vstack([((support - centre) / radius).T, np.ones(len(support))])
    _, residual = nnls(matrix, np.array([0.0, 0.0, 0.0, 1.0]))
    assert residual < 10.0 * tolerance


@given(st.lists(st.tuples(*[st.integers(-3, 3)] * 3), min_size=1, max_size=7))
@settings(max_examples=60, deadline=None)
def test_on_a_lattice_against_brute_force(rows):
    points = np.array(rows, dtype=float)
    ball = smallest_ball(points)
    assert np.isclose(ball.radius, brute_force(points), rtol=1e-12, atol=1e-15)
    assert_smallest(points)


@given(st.integers(0, 10**6), st.integers(1, 9), st.floats(1e-9, 1.0))
@settings(max_examples=60, deadline=None)
def test_on_flat_clouds_against_brute_force(seed, number, flatness):
    points = np.random.default_rng(seed).normal(size=(number, 3)) * [1.0, flatness, flatness**2]
    assert np.isclose(smallest_ball(points).radius, brute_force(points), rtol=1e-9)


def large_clouds():
    normal = RNG.normal(size=(60_000, 3))
    sphere = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    yield "normal", normal
    yield "on a sphere", sphere
    yield "on a half sphere", sphere * np.sign(sphere[:, 2:])
    yield "on a cap", sphere[sphere[:, 2] > 0.8]
    yield "cube", RNG.random((60_000, 3))
    yield "lattice", np.array(np.meshgrid(*[np.arange(20.0)] * 3)).reshape(3, -1).T
    yield "rod", normal * [100.0, 1.0, 0.01]
    yield "plane", normal * [1.0, 1.0, 0.0]
    yield "line", normal[:, :1] * [1.0, 2.0, 3.0]
    yield "circle", np.c_[np.cos(normal[:, 0]), np.sin(normal[:, 0]), 0.0 * normal[:, 0]]
    yield "doubled", np.repeat(normal[:100], 50, axis=0)
    yield "far away", normal + 1e7
    yield "two clusters", np.vstack([normal[:1000] * 1e-9, normal[1000:2000] * 1e-9 + 1.0])


@pytest.mark.parametrize(("name", "points"), list(large_clouds()))
def test_certificate(name, points):
    assert_smallest(points, 1e-7 if name == "far away" else 1e-9)


def test_known_balls():
    cube = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    centre, radius = smallest_ball(cube)
    assert np.allclose(centre, 0.0, atol=1e-15) and np.isclose(radius, np.sqrt(3.0), rtol=1e-15)
    triangle = smallest_ball([(1, 0, 0), (-0.5, 3**0.5 / 2, 0), (-0.5, -(3**0.5) / 2, 0)])
    assert np.isclose(triangle.radius, 1.0, rtol=1e-15)
    obtuse = smallest_ball([(0, 0, 0), (10, 0, 0), (5, 1, 0)])
    assert obtuse.radius == 5.0 and obtuse.centre.tolist() == [5.0, 0.0, 0.0]
    assert smallest_ball([(1, 2, 3)]).radius == 0.0
    assert smallest_ball([(1, 2, 3)] * 5).centre.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("number", [2, 3, 4, 5, 100, 20_000])
def test_permutation_and_rigid_motion(number):
    points = RNG.normal(size=(number, 3))
    centre, radius = smallest_ball(points)
    for seed in range(3):
        other = smallest_ball(np.random.default_rng(seed).permutation(points))
        assert np.allclose(other.centre, centre, atol=1e-12) and np.isclose(other.radius, radius, rtol=1e-12)
        turn, move = Rotation.random(random_state=seed).as_matrix(), np.array([0.1, -0.7, 0.4])
        moved = smallest_ball(points @ turn.T + move)
        assert np.allclose(moved.centre, turn @ centre + move, atol=1e-12)
        assert np.isclose(moved.radius, radius, rtol=1e-12)


@pytest.mark.parametrize("scale", [1e-300, 1e-160, 1e-3, 1e160, 1e300])
def test_scale(scale):
    points = RNG.normal(size=(50, 3))
    plain, scaled = smallest_ball(points), smallest_ball(points * scale)
    assert np.isclose(scaled.radius / scale, plain.radius, rtol=1e-12)
    assert np.allclose(scaled.centre / scale, plain.centre, atol=1e-12)


def test_largest_coordinates():
    most = float(np.finfo(np.float32).max)
    ball = smallest_ball([(most, 0, 0), (-most, 0, 0), (0, 1, 1)])
    assert np.isclose(ball.radius, most, rtol=1e-15)


def test_single_precision_and_strides_are_cast():
    points = RNG.normal(size=(40, 6)).astype(np.float32)[::2, ::2]
    assert smallest_ball(points).radius == smallest_ball(points.astype(float).copy()).radius


def test_surface_and_growth():
    ball = Ball(np.zeros(3), 2.0)
    assert np.isclose(ball.surface, 16.0 * np.pi)
    assert ball.grown(0.5).radius == 2.5


@pytest.mark.parametrize("points", [[], np.empty((0, 3)), [(0, 0)], [(0, 0, np.nan)], [(0, np.inf, 0)], "abc"])
def test_bad_points(points):
    with pytest.raises(InputError):
        smallest_ball(points)
