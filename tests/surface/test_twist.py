"""Neighbours that given normals put on another sheet, and noise that keeps its length where the density changes."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel
from surfel.surface.denoise import denoise
from surfel.surface.flattened import LEVELS, restored
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.patches import local_patches
from surfel.surface.twist import LOOSE, TIGHT, largest_twist
from surfel.surface.uneven_noise import local_levels, mean_spacing, uneven_level


def hood_of(points: np.ndarray) -> Neighbourhoods:
    return Neighbourhoods.of(points, np.arange(len(points)))


def wedge(n: int, angle: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit squares that meet in the y axis at an angle."""
    rng = np.random.default_rng(seed)
    s, y, upper = rng.random(n), rng.random(n), rng.random(n) < 0.5
    c, z = np.cos(angle), np.sin(angle)
    points = np.where(upper[:, None], np.column_stack([c * s, y, z * s]), np.column_stack([s, y, 0.0 * s]))
    return points, np.where(upper[:, None], [-z, 0.0, c], [0.0, 0.0, -1.0])


def test_the_sheets_of_a_wedge_do_not_take_area_from_each_other():
    for seed in (1, 2):
        points, normals = wedge(12_000, np.radians(15.0), seed)
        assert local_patches(hood_of(points), normals).area == pytest.approx(2.0, rel=0.006)


@pytest.mark.parametrize("shape", [truth.sphere, truth.torus, truth.box])
def test_a_smooth_surface_is_tight_and_a_rough_one_loose(shape):
    cloud = shape(6000, 1)
    hood = hood_of(cloud.points)
    assert largest_twist(hood, cloud.normals[hood.rows]) == TIGHT
    rng = np.random.default_rng(2)
    rough = cloud.normals + 0.3 * rng.standard_normal(cloud.normals.shape)
    rough /= np.linalg.norm(rough, axis=1, keepdims=True)
    assert largest_twist(hood, rough[hood.rows]) > 2.0 * TIGHT
    assert largest_twist(hood, np.zeros_like(rough)) == LOOSE


def uneven_ball(falls: float, sigma: float, seed: int) -> np.ndarray:
    """Return a sphere 30 times as dense at one pole as at the other, with noise of a power of the spacing."""
    rng = np.random.default_rng(seed)
    place = rng.standard_normal((200_000, 3))
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    density = 30.0 ** (0.5 * (place[:, 2] - 1.0))
    kept = rng.random(len(place)) < density
    place, density = place[kept][:20_000], density[kept][:20_000]
    spacing = 1.0 / np.sqrt(density)
    spacing *= np.sqrt(4.0 * np.pi / len(place)) / np.sqrt(np.mean(spacing**2))
    mean = np.sqrt(np.mean(spacing**2))
    length = sigma * mean * (spacing / mean) ** (1.0 - falls)
    return np.asarray(place + length[:, None] * rng.standard_normal(place.shape))


@pytest.mark.parametrize("falls", [0.0, 1.0])
def test_noise_that_keeps_its_length_is_told_from_noise_that_grows_with_the_spacing(falls):
    hood = hood_of(uneven_ball(falls, 0.3, 1))
    level, found = uneven_level(hood, 0.3)
    assert level == pytest.approx(0.3, rel=0.15)
    assert found == pytest.approx(falls, abs=0.2)
    levels = local_levels(hood, level, 1.0)
    np.testing.assert_allclose(levels * hood.spacing[hood.near].mean(axis=1), level * mean_spacing(hood))


def test_even_clouds_have_one_level():
    hood = hood_of(truth.sphere(8000, 1).noisy(0.3, 2))
    assert uneven_level(hood, 0.3) == (0.3, 0.0)
    assert (local_levels(hood, 0.3, 0.0) == 0.3).all()


def test_the_area_of_an_uneven_noisy_cloud_is_that_of_the_sphere():
    assert local_patches(hood_of(uneven_ball(1.0, 0.4, 3))).area == pytest.approx(4.0 * np.pi, rel=0.006)


def test_what_noise_leaves_on_a_sphere_is_known():
    """Bends and relief give nothing back where there are none, and noise takes back what it added."""
    ball = truth.sphere(20_000, 4)
    for sigma in (0.1, 0.3, 0.5):
        smooth = denoise(hood_of(ball.noisy(sigma, 5)), sigma)
        found = restored(np.zeros(4), np.zeros(4), np.ones(4), np.full(4, sigma))
        assert (found.relief < 0.0).all() and (found.drawn_in < 0.0).all() and (found.noise < 0.0).all()
        drawn_in = restored(np.zeros(20_000), smooth.bend, smooth.hood.spacing, smooth.levels).drawn_in
        assert abs(drawn_in.mean()) < 0.0005
    assert not np.any(restored(np.zeros(1), np.zeros(1), np.ones(1), LEVELS[:1]))


@pytest.mark.parametrize("sides", [10, 12, 16])
def test_the_folds_of_a_prism_are_not_taken_for_two_sheets(sides):
    """Its faces meet at 36, 30 and 22.5 degrees; refused neighbours across them would each widen a cell."""
    rng = np.random.default_rng(sides)
    n = 20_000
    turn = 2.0 * np.pi / sides
    face, u, height = rng.integers(0, sides, n), rng.random(n) - 0.5, 3.0 * rng.random(n)
    normals = np.column_stack([np.cos(face * turn), np.sin(face * turn), np.zeros(n)])
    along = np.column_stack([-normals[:, 1], normals[:, 0], np.zeros(n)])
    width = 2.0 * np.tan(turn / 2.0)
    points = normals + along * (width * u)[:, None] + np.column_stack([np.zeros((n, 2)), height])
    area = surfel.measure(surfel.Surfels(points, normals=normals)).area
    assert abs(float(area) / (3.0 * sides * width) - 1.0) < 2.5e-3
