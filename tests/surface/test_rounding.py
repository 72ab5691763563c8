"""Rounded coordinates, told by their steps, against rounding that was made."""

from __future__ import annotations

import math

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.rounding import rounding_level

N = 8000


def level_of(points: np.ndarray) -> float:
    """Return the level of points that are shifted and scaled as a cloud's surface does."""
    low, high = points.min(axis=0), points.max(axis=0)
    scale = 2.0 ** math.frexp(float((high - low).max()))[1]
    points = (points - 0.5 * (low + high)) / scale
    return rounding_level(Neighbourhoods.of(np.unique(points, axis=0), np.arange(len(points))))


def rounded(points: np.ndarray, step: float) -> np.ndarray:
    return np.round(points / step) * step


def spacing_of(points: np.ndarray) -> float:
    return float(np.median(Neighbourhoods.of(points, np.arange(len(points))).spacing))


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("shift", [0.0, 12345.678, 5.0e6])
@pytest.mark.parametrize("shape", [truth.sphere, truth.box])
def test_the_noise_of_rounding_is_known(shape, shift, share):
    points = shape(N, 1).points
    step = share * spacing_of(points)
    assert level_of(rounded(points + shift, step)) == pytest.approx(share / math.sqrt(12.0), rel=0.15)


def test_few_decimals_are_rounding():
    points = 100.0 * truth.torus(N, 2).points
    step = 10.0 ** math.floor(math.log10(0.3 * spacing_of(points)))
    expected = step / spacing_of(points) / math.sqrt(12.0)
    assert level_of(np.round(points, -round(math.log10(step)))) == pytest.approx(expected, rel=0.15)


def test_single_precision_far_from_the_origin_is_rounding():
    points = (10.0 * truth.sphere(N, 3).points + 5.0e5).astype(np.float32).astype(float)
    assert level_of(points) == pytest.approx(2.0**-5 / spacing_of(points) / math.sqrt(12.0), rel=0.3)


@pytest.mark.parametrize("shape", [truth.sphere, truth.torus, truth.square])
def test_points_as_they_are_have_none(shape):
    points = shape(N, 4).points
    assert level_of(points) == 0.0
    assert level_of(points.astype(np.float32).astype(float)) == 0.0
    assert level_of(rounded(points, 0.002 * spacing_of(points))) == 0.0


@pytest.mark.parametrize("stretch", [1.0, 3.0])
@pytest.mark.parametrize("kept", [1.0, 0.7])
def test_rows_of_a_grid_are_no_rounding_but_rounded_heights_are(stretch, kept):
    rng = np.random.default_rng(5)
    place = np.stack(np.meshgrid(np.arange(70.0) * stretch, np.arange(70.0)), axis=-1).reshape(-1, 2)
    place = place[rng.random(len(place)) < kept]
    heights = 5.0 * np.sin(place[:, 0] / 9.0) + rng.random(len(place)) * 0.3
    points = np.column_stack([place, heights])
    assert level_of(points) == 0.0
    points[:, 2] = rounded(heights, 0.1)
    assert level_of(points) == pytest.approx(0.1 / spacing_of(points) / math.sqrt(12.0), rel=0.3)


def test_a_few_points_tell_nothing():
    assert level_of(rounded(truth.sphere(6, 1).points, 0.01)) == 0.0


@pytest.mark.parametrize("given", [True, False])
def test_flat_parts_do_not_hide_what_rounding_makes_of_the_others(given):
    """A flat field with two hills: most points stay exactly flat, and the others get steps."""
    rng = np.random.default_rng(6)
    x, y = 20.0 * (rng.random((2, N)) - 0.5)
    bump = [np.exp(-((x - a) ** 2 + (y - b) ** 2) / 2.0) for a, b in ((-2.0, 1.0), (3.0, -2.0))]
    points = np.column_stack([x, y, 3.0 * (bump[0] + bump[1])])
    slope = [-3.0 * sum(-(u - c[k]) * h for h, c in zip(bump, ((-2.0, 1.0), (3.0, -2.0)), strict=True))
             for k, u in enumerate((x, y))]  # fmt: skip
    normals = np.column_stack([*slope, np.ones(N)])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    exact = surfel.measure(surfel.Surfels(points, normals if given else None), lines=16, seed=1).area
    points = rounded(points, 0.3 * spacing_of(points))
    found = surfel.measure(surfel.Surfels(points, normals if given else None), lines=16, seed=1)
    assert float(found.area.value) == pytest.approx(float(exact.value), rel=0.01)  # 6 % too large without
    assert found.noise == pytest.approx(0.3 / math.sqrt(12.0), rel=0.2)


@pytest.mark.parametrize("cells", [18, 30])
@pytest.mark.parametrize("phase", [0.1, 0.25, 0.5])
def test_faces_between_the_rows_of_a_lattice_are_no_rounding(cells, phase):
    """Vertices as marching cubes give them: on the edges of a lattice, where these pass through the faces of a box."""
    along = (np.arange(cells) + phase) / cells
    u, v = (side.ravel() for side in np.meshgrid(along, along))
    faces = [
        np.roll(np.column_stack([np.full(u.size, w), u, v]), axis, axis=1) for axis in range(3) for w in (0.0, 1.0)
    ]
    points = np.concatenate(faces)
    assert level_of(points) == 0.0
    area = surfel.measure(surfel.Surfels(points), lines=16).area
    assert area.value == pytest.approx(6.0, rel=0.002)
