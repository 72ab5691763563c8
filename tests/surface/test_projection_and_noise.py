"""Moving least squares against numpy, and the noise level against planted noise."""

from __future__ import annotations

import numpy as np
import pytest

import naive
import shapes_with_truth as truth
from surfel.index.neighbours import PointIndex
from surfel.surface.denoise import denoise, fit_widths
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import axial_ranks, is_two_sheets, noise_level, sample_rows
from surfel.surface.projection import project
from surfel.surface.quadric import RIDGE, gaussian, solve_quadric


@pytest.fixture(scope="module")
def rough_cloud():
    ball = truth.torus(400, 3)
    points = ball.noisy(0.1, 4)
    rng = np.random.default_rng(5)
    normals = ball.normals + 0.05 * rng.standard_normal((400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return points, normals * np.where(rng.random(400) < 0.5, -1.0, 1.0)[:, None]


@pytest.mark.parametrize("alike", [0.8, 0.0])
def test_projection_is_the_weighted_least_squares_quadric(rough_cloud, alike):
    points, normals = rough_cloud
    _, rows = naive.nearest(points, 24)
    chosen = np.arange(0, 400, 3, dtype=np.int32)
    near, counts = np.ascontiguousarray(rows[chosen]), np.where(chosen % 2, 24, 18).astype(np.int32)
    moved, turned, bend = project(points, normals, chosen, near, counts, alike=alike)
    fitted = 0
    for row, i in enumerate(chosen):
        a, b = naive.frame(normals[i])
        taken = rows[i, : counts[row]]
        width = 0.5 * np.linalg.norm(points[taken[-1]] - points[i])
        alikes = [j for j in taken if abs(normals[j] @ normals[i]) >= alike]
        if len(alikes) < 6:  # too few to tell: the point stays
            np.testing.assert_array_equal(moved[row], points[i])
            np.testing.assert_array_equal(turned[row], normals[i])
            continue
        fitted += 1
        offset = np.concatenate([[np.zeros(3)], points[alikes] - points[i]])
        u, v, w = offset @ a / width, offset @ b / width, offset @ normals[i]
        found = naive.quadric(u, v, w, np.exp(-0.5 * (u**2 + v**2)))
        np.testing.assert_allclose(moved[row], points[i] + found[0] * normals[i], atol=1e-6 * width)
        np.testing.assert_allclose(bend[row], 2.0 * (found[3] + found[5]) / width**2, rtol=1e-3, atol=1e-4)
        slope = normals[i] - found[1] / width * a - found[2] / width * b
        np.testing.assert_allclose(turned[row], slope / np.linalg.norm(slope), atol=1e-4)
    assert fitted > 100


def test_the_weight_is_the_exponential():
    squares = np.linspace(0.0, 4.0, 1001)
    np.testing.assert_allclose(gaussian.py_func(squares), np.exp(-0.5 * squares), rtol=1e-13)


@pytest.mark.parametrize("points", [3, 6, 12])
def test_the_quadric_solves_the_normal_equations_with_their_ridge(points):
    rng = np.random.default_rng(points)
    u, v = rng.standard_normal((2, points))
    w, g = rng.standard_normal(points), rng.random(points)
    powers = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)]
    powers += [(4, 0), (3, 1), (2, 2), (1, 3), (0, 4)]
    sums = [(g * u**a * v**b).sum() for a, b in powers]
    loads = [(g * u**a * v**b * w).sum() for a, b in powers[:6]]
    found = solve_quadric.py_func(*sums, *loads)
    base = np.stack([u**a * v**b for a, b in powers[:6]])
    matrix = (base * g) @ base.T + RIDGE * g.sum() * np.diag([1, 1, 1, 1, 0.5, 1])
    np.testing.assert_allclose(matrix @ np.array(found), loads, atol=1e-6 * np.abs(found).max())
    if points == 12:
        np.testing.assert_allclose(found, np.linalg.solve(matrix, loads), rtol=1e-9)


def test_points_across_the_planes_take_no_part():
    u, v = np.random.default_rng(2).uniform(-1.0, 1.0, (2, 12))
    points = np.stack([np.append(0.0, u), np.append(0.0, v), np.zeros(13)], axis=1)
    points[9:, :2] *= 0.2
    points[9:, 2] = 1.0  # another sheet
    normals, chosen = np.tile([0.0, 0.0, 1.0], (13, 1)), np.zeros(1, np.int32)
    near = np.argsort(np.square(points).sum(axis=1))[None, 1:].astype(np.int32)
    counts = np.array([12], np.int32)
    np.testing.assert_allclose(project(points, normals, chosen, near, counts, steep=1.4)[0], 0.0, atol=1e-12)
    assert project(points, normals, chosen, near, counts)[0][0, 2] > 0.1


def test_points_side_by_side_are_fitted_each_by_itself(rough_cloud):
    points, normals = rough_cloud
    near = naive.nearest(points, 24)[1]
    counts = np.random.default_rng(1).integers(3, 25, 100).astype(np.int32)
    chosen = np.arange(100, dtype=np.int32)
    together = project(points, normals, chosen, near[:100], counts)
    for row in range(100):
        alone = project(points, normals, chosen[row : row + 1], near[row : row + 1], counts[row : row + 1])
        for one, all_of_them in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one[0], all_of_them[row])


def test_projection_does_not_depend_on_the_signs_of_the_neighbours(rough_cloud):
    points, normals = rough_cloud
    _, rows = naive.nearest(points, 24)
    chosen = np.arange(100, dtype=np.int32)
    turned_round = normals.copy()
    turned_round[100:] *= -1.0
    ours, theirs = (
        project(points, n, chosen, rows[:100], np.full(100, 24, np.int32))[0] for n in (normals, turned_round)
    )
    np.testing.assert_array_equal(ours, theirs)


def test_projection_takes_most_of_the_noise_off():
    ball = truth.sphere(6000, 1)
    for sigma, left in ((0.1, 0.6), (0.5, 0.35)):
        hood = Neighbourhoods.of(ball.noisy(sigma, 2), np.arange(6000))
        smooth, normals, bend, levels = denoise(hood, sigma)
        off = np.linalg.norm(smooth.points + smooth.index.origin, axis=1) - 1.0
        assert np.std(off) < left * sigma * ball.spacing
        assert sorted(smooth.rows) == list(range(6000))
        assert (levels == sigma).all()
        assert np.median(np.abs(bend)) == pytest.approx(2.0, rel=0.5)
        outward = ball.points[smooth.rows]
        assert np.median(np.abs(np.einsum("ij,ij->i", normals, outward))) > 0.99


def test_the_width_of_the_fit_grows_with_the_noise_within_limits():
    levels = np.array([0.2, 0.4, 0.5, 1.0, 5.0])
    assert fit_widths(levels, 10**6, twice=True).tolist() == [18, 26, 32, 130, 500]
    assert set(fit_widths(levels, 10**6, twice=False)) == {24}
    assert fit_widths(levels, 80, twice=True)[-1] == 10


@pytest.mark.parametrize("sigma", [0.05, 0.1, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("shape", [truth.sphere, truth.torus])
def test_planted_noise_is_recovered_within_a_fifth(shape, sigma):
    cloud = shape(8000, 11)
    assert noise_level(PointIndex(cloud.noisy(sigma, 12))) == pytest.approx(sigma, rel=0.2)


@pytest.mark.parametrize("shape", [truth.sphere, truth.torus, truth.box, truth.square, truth.cylinder])
def test_clean_surfaces_have_no_noise(shape):
    assert noise_level(PointIndex(shape(8000, 2).points)) < 0.01


@pytest.mark.parametrize("n", [4, 25, 191, 192, 193, 194, 195, 196, 197, 575, 576, 580])
def test_any_number_of_points_has_some_noise_level(n):
    assert 0.0 <= noise_level(PointIndex(truth.sphere(n, 1).points)) < 0.2


def test_chosen_rows_are_the_same_places_after_permutation_and_rotation():
    points = np.random.default_rng(0).random((500, 3))
    order = np.random.default_rng(1).permutation(500)
    rows = sample_rows(points, 60)
    again = sample_rows((points @ truth.rotation(2).T)[order], 60)
    assert sorted(order[again]) == sorted(rows)
    assert len(set(rows)) == 60
    assert sorted(axial_ranks(points)) == list(range(500))
    assert sample_rows(points[:40], 60).tolist() == list(range(40))


@pytest.mark.parametrize("level", [0.15, 0.3, 0.6])
@pytest.mark.parametrize("kind", ["normal", "uniform"])
def test_noise_is_not_taken_for_two_sheets(level, kind):
    ball = truth.sphere(6000, 1)
    h = np.sqrt(4.0 * np.pi / 6000)
    rng = np.random.default_rng(3)
    if kind == "normal":
        off = rng.standard_normal(ball.points.shape)
    else:
        off = rng.uniform(-1.0, 1.0, ball.points.shape) * np.sqrt(3.0)
    index = PointIndex(ball.points + level * h * off)
    assert not is_two_sheets(index, noise_level(index))


@pytest.mark.parametrize("gap", [0.3, 0.5, 0.7])
def test_two_sheets_are_not_taken_for_noise(gap):
    inner, outer = truth.sphere(4000, 1), truth.sphere(4000, 2)
    h = np.sqrt(4.0 * np.pi / 4000)
    index = PointIndex(np.concatenate([inner.points, outer.points * (1.0 + gap * h)]))
    level = noise_level(index)
    assert level > 0.12
    assert is_two_sheets(index, level)
