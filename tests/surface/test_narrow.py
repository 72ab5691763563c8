"""Neighbourhoods that lie on two rows, or on one: found, and given more neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from surfel.surface.narrow import narrow_rows, on_two_rows
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import sample_rows
from surfel.surface.normals import fitted_normals


def hood_of(points: np.ndarray) -> Neighbourhoods:
    return Neighbourhoods.of(np.ascontiguousarray(points), np.arange(len(points)))


def raster(columns: int, lines: int, apart: float, bend: float = 0.0) -> np.ndarray:
    x, y = (a.ravel() for a in np.meshgrid(np.arange(float(columns)), apart * np.arange(float(lines))))
    return np.column_stack([x, y, 0.5 * bend * (x * x - y * y)])


@pytest.mark.parametrize("apart", [1.0, 1.3, 2.0, 3.0, 6.0])
@pytest.mark.parametrize("bend", [0.0, 0.002])
def test_points_on_two_rows_are_those_whose_neighbours_have_two_heights(apart, bend):
    points = raster(60, 20, apart, bend)
    hood = hood_of(points)
    lines = np.rint(hood.points[:, 1] / apart + hood.index.origin[1] / apart)
    heights = [len({*lines[near[:12]], lines[i]}) for i, near in enumerate(hood.near)]
    found = on_two_rows(hood.points, np.arange(len(points), dtype=np.int32), hood.near, 12)
    np.testing.assert_array_equal(found, np.array(heights) <= 2)
    assert found.any() == (apart > 1.5)


def test_random_points_and_square_grids_have_none():
    rng = np.random.default_rng(0)
    flat = np.column_stack([rng.random((4000, 2)), np.zeros(4000)])
    ball = rng.standard_normal((4000, 3))
    for points in (flat, ball / np.linalg.norm(ball, axis=1, keepdims=True), raster(50, 50, 1.0, 0.01)):
        hood = hood_of(points)
        assert len(narrow_rows(hood.points, hood.near, 12, sample_rows(hood.points, 1500))) < 0.002 * len(points)


@pytest.mark.parametrize("few", [3, 4, 5, 30])
def test_few_points_are_asked_for_nothing(few):
    hood = hood_of(np.random.default_rng(1).random((few, 3)))
    normals = fitted_normals(hood)
    assert normals.shape == (few, 3)
    assert np.isfinite(normals).all()


@pytest.mark.parametrize("apart", [2.0, 4.0, 7.0])
def test_normals_of_rows_that_lie_apart_are_those_of_the_surface(apart):
    points = raster(int(20 * apart), 20, apart, 0.002)
    hood = hood_of(points)
    place = hood.points + hood.index.origin
    truth = np.column_stack([-0.002 * place[:, 0], 0.002 * place[:, 1], np.ones(len(place))])
    truth /= np.linalg.norm(truth, axis=1, keepdims=True)
    cosine = np.abs(np.einsum("ij,ij->i", fitted_normals(hood), truth))
    assert np.degrees(np.arccos(min(1.0, cosine.min()))) < 5.0  # they stood at right angles
