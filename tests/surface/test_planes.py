"""Eigenpairs, plane fits and small systems against numpy."""

from __future__ import annotations

import numpy as np
import pytest

import naive
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.normals import Planes, choose_planes, fit_planes, fitted_normals, widths
from surfel.surface.planes import plane_of_neighbours, smallest_eigenpair, solve_spd
from surfel.surface.spacing import local_spacing, regularity


def _upper(matrix):
    return matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 1], matrix[1, 2], matrix[2, 2]


@pytest.mark.parametrize("scale", [1.0, 1e-20, 1e20])
@pytest.mark.parametrize("seed", range(20))
def test_the_smallest_eigenpair_is_that_of_numpy(seed, scale):
    half = np.random.default_rng(seed).standard_normal((3, 5)) * [[1.0], [0.3], [0.05]]
    matrix = half @ half.T * scale
    low, *vector = smallest_eigenpair(*_upper(matrix))
    values, vectors = np.linalg.eigh(matrix)
    assert low == pytest.approx(values[0], rel=1e-6, abs=1e-9 * values[2])
    assert abs(np.dot(vector, vectors[:, 0])) == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("direction", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, -2, 3]])
def test_points_on_a_line_have_some_unit_normal_across_it(direction):
    d = np.array(direction, float)
    low, *vector = smallest_eigenpair(*_upper(np.outer(d, d)))
    assert abs(low) < 1e-9
    assert np.linalg.norm(vector) == pytest.approx(1.0, abs=1e-9)
    assert abs(np.dot(vector, d)) < 1e-6


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.eye(3), 7e-30 * np.eye(3)])
def test_without_a_preferred_direction_any_unit_vector_does(matrix):
    low, *vector = smallest_eigenpair(*_upper(matrix))
    assert low == pytest.approx(matrix[0, 0]) and np.linalg.norm(vector) == pytest.approx(1.0)


def test_planes_are_those_of_numpy():
    points = np.random.default_rng(1).random((60, 3)) * [1.0, 0.7, 0.1] + 100.0
    _, rows = naive.nearest(points, 10)
    for i in range(len(points)):
        *normal, off, x, y, z = plane_of_neighbours(points, i, rows, i, 10)
        expected, residual, centre = naive.plane(points[[i, *rows[i]]])
        assert abs(np.dot(normal, expected)) == pytest.approx(1.0, abs=1e-9)
        assert off == pytest.approx(residual, rel=1e-6)
        np.testing.assert_allclose([x, y, z], centre, rtol=1e-12)


@pytest.mark.parametrize("size", [1, 3, 6])
def test_small_systems_are_solved(size):
    rng = np.random.default_rng(size)
    half = rng.standard_normal((size, size + 3))
    matrix, right = half @ half.T, rng.standard_normal(size)
    solution = right.copy()
    solve_spd(matrix.copy(), solution)
    np.testing.assert_allclose(solution, np.linalg.solve(matrix, right), rtol=1e-9)


def _cube_edge(n):
    """Return points of two faces that meet in the y axis, and which face each is on."""
    rng = np.random.default_rng(5)
    s, y = rng.random(n), rng.random(n)
    upright = rng.random(n) < 0.5
    return np.where(upright[:, None], np.column_stack([0 * s, y, s]), np.column_stack([s, y, 0 * s])), upright


def test_normals_stay_sharp_at_an_edge():
    points, upright = _cube_edge(3000)
    hood = Neighbourhoods.of(points, np.arange(len(points)))
    points, rows, upright = hood.points, hood.near, upright[hood.rows]
    normals = fitted_normals(hood)
    truth = np.where(upright[:, None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    right = np.abs(np.einsum("ij,ij->i", normals, truth)) > 0.99
    planes = Planes.empty(len(points))
    fit_planes(points, np.arange(len(points), dtype=np.int32), rows, widths(len(points), 12, rows), planes)
    rounded = np.abs(np.einsum("ij,ij->i", planes.normal, truth)) < 0.99
    assert rounded.mean() > 0.02  # a least-squares plane cuts the corner there
    assert right.mean() > 0.99
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)


def test_the_best_plane_is_chosen_as_by_hand():
    points, _ = _cube_edge(300)
    squared, rows = naive.nearest(points, 24)
    spacing = local_spacing(squared)
    planes = Planes.empty(len(points))
    fit_planes(points, np.arange(len(points), dtype=np.int32), rows, widths(len(points), 12, rows), planes)
    chosen = choose_planes(points, rows, 0.1 * spacing, planes, better=0.5)
    for i in range(len(points)):
        expected = planes.normal[i]
        if planes.residual[i] >= 0.1 * spacing[i]:
            off = np.einsum("ij,ij->i", points[i] - planes.centre[rows[i]], planes.normal[rows[i]])
            cost = np.sqrt(planes.residual[rows[i]] ** 2 + off**2)
            if cost.min() < 0.5 * planes.residual[i]:
                expected = planes.normal[rows[i][cost.argmin()]]
        np.testing.assert_array_equal(chosen[i], expected)


def test_spacing_and_regularity_of_a_grid_and_of_random_points():
    x, y = np.meshgrid(np.arange(30.0), np.arange(30.0))
    grid = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]) * 0.5
    squared, _ = naive.nearest(grid, 12)
    inner = ((grid[:, :2] > 2) & (grid[:, :2] < 12)).all(axis=1)
    assert local_spacing(squared)[inner] == pytest.approx(2.0 * 0.5 * np.sqrt(np.pi / 12), rel=1e-12)
    assert regularity(squared[inner], np.full(inner.sum(), 0.5)) == pytest.approx(1.0)
    random = np.column_stack([np.random.default_rng(0).random((2000, 2)), np.zeros(2000)])
    squared, _ = naive.nearest(random, 12)
    spacing = local_spacing(squared)
    assert np.median(spacing) == pytest.approx(np.sqrt(1 / 2000), rel=0.1)
    assert regularity(squared, spacing) == pytest.approx(0.5, abs=0.04)
