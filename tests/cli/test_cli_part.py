"""The demo's part: its closed forms against counting, and its sample against its surface."""

from __future__ import annotations

import numpy as np
import pytest

from surfel.cli.part import BoredBlock

PART = BoredBlock()


def inside(points):
    half = np.array([PART.width, PART.depth, PART.height]) / 2
    return (np.abs(points) < half).all(axis=1) & (np.hypot(points[:, 0], points[:, 1]) > PART.radius)


def test_volume_by_counting():
    half = np.array([PART.width, PART.depth, PART.height]) / 2
    points = np.random.default_rng(1).uniform(-half, half, (400_000, 3))
    assert inside(points).mean() * 8 * half.prod() == pytest.approx(PART.volume, rel=0.003)


def test_area_by_the_growth_of_the_volume():
    """The derivative of the volume along the outward normal is the area, found by finite differences of the sizes."""
    step = 1e-6

    def volume(t):
        return BoredBlock(PART.width + 2 * t, PART.depth + 2 * t, PART.height + 2 * t, PART.radius - t).volume

    assert (volume(step) - volume(-step)) / (2 * step) == pytest.approx(PART.area, rel=1e-6)


def test_sampled_points_lie_between_in_and_out_along_their_normals():
    points, normals = PART.sample(5000, seed=3)
    assert points.shape == normals.shape == (5000, 3)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert inside(points - 1e-9 * normals).all()
    assert not inside(points + 1e-9 * normals).any()


def test_every_part_of_the_surface_gets_its_share():
    points, normals = PART.sample(100_000, seed=4)
    wall = np.abs(np.abs(np.hypot(points[:, 0], points[:, 1])) - PART.radius) < 1e-9
    assert wall.mean() == pytest.approx(2 * np.pi * PART.radius * PART.height / PART.area, abs=0.005)
    top = normals[:, 2] > 0.5
    lid = PART.width * PART.depth - np.pi * PART.radius**2
    assert top.mean() == pytest.approx(lid / PART.area, abs=0.006)
    ring = np.hypot(points[top, 0], points[top, 1]) < 1.2
    assert ring.mean() == pytest.approx(np.pi * (1.2**2 - PART.radius**2) / lid, abs=0.01)


def test_the_same_seed_gives_the_same_points():
    first, again, other = PART.sample(100, 5), PART.sample(100, 5), PART.sample(100, 6)
    assert np.array_equal(first[0], again[0]) and np.array_equal(first[1], again[1])
    assert not np.array_equal(first[0], other[0])
