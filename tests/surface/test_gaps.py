"""Gaps between points that are taken for surface: what the interval says of them."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from surfel.surface.gaps import gap_area
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.patches import local_patches

COUNT = 12_000
SIZE = np.array([1.0, 1.2])
SPACING = float(np.sqrt(SIZE.prod() / COUNT))


def plane(seed: int) -> np.ndarray:
    """Return random points of a rectangle."""
    flat = np.random.default_rng(seed).random((COUNT, 2)) * SIZE
    return np.column_stack([flat, np.zeros(COUNT)])


def measured(points: np.ndarray) -> surfel.Measurement:
    return surfel.measure(surfel.Surfels(points), lines=256)


@pytest.mark.parametrize("width", [3, 4, 5])
def test_the_interval_holds_a_slab_that_was_left_out(width: int) -> None:
    points = plane(1)
    left = points[np.abs(points[:, 0] - 0.5) > 0.5 * width * SPACING]
    found = measured(left)
    truth = SIZE.prod() - width * SPACING * SIZE[1]
    assert found.area.value > 1.01 * truth  # it is bridged
    assert abs(found.area.value - truth) < 2.6 * found.area.standard_error
    assert any("gaps" in warning for warning in found.warnings)


def test_many_holes_leave_no_honest_number() -> None:
    points = plane(2)
    cell = points[:, :2] / (6.0 * SPACING) % 1.0 - 0.5
    found = measured(points[np.hypot(*cell.T) > 0.25])
    assert not found.area.reliable


@pytest.mark.parametrize("seed", range(3))
def test_chance_opens_no_gaps(seed: int) -> None:
    points = plane(seed)
    hood = Neighbourhoods.of(points, np.arange(len(points)))
    found = local_patches(hood, star=16)
    assert gap_area(found.hood, found.cells) == 0.0
    assert not any("gaps" in warning for warning in measured(points).warnings)


def test_the_wide_triangles_are_those_of_a_direct_search() -> None:
    points = plane(3)
    left = points[np.abs(points[:, 0] - 0.5) > 2.0 * SPACING]
    hood = Neighbourhoods.of(left, np.arange(len(left)))
    found = local_patches(hood, star=16)
    assert gap_area(hood, found.cells) == pytest.approx(max(_excesses(found)), rel=1e-9)


def _excesses(found) -> list[float]:
    points, cells, near = found.hood.points, found.cells, found.hood.near
    usual = np.sort(found.hood.spacing[near[:, ::2]], axis=1)[:, 3]
    limits, shares = np.array([1.4, 1.6, 1.8]), np.array([0.1, 0.04, 0.014])
    total = np.zeros(3)
    for i, star in enumerate(cells.star):
        ring = star[star >= 0]
        for c, j in enumerate(ring):
            k = ring[(c + 1) % len(ring)]
            if not cells.joined[i] >> c & 1 or cells.closed[[i, j, k]].sum() < 2:
                continue
            a, b = points[j] - points[i], points[k] - points[i]
            double = np.linalg.norm(np.cross(a, b))
            radius = np.linalg.norm(a) * np.linalg.norm(b) * np.linalg.norm(a - b) / (2.0 * double)
            total += double / 6.0 * (radius > limits * usual[[i, j, k]].max())
    return list(total - shares * cells.area.sum())
