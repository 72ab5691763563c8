"""Scans laid over each other are told from clouds of one kind."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.overlay import is_overlay


def raster(shift: float, turn: float) -> np.ndarray:
    """Return a scan of a flat piece, 60 by 60 points in rows, shaken by a tenth of their distance."""
    rng = np.random.default_rng(int(10 * turn))
    u, v = np.meshgrid(np.arange(60.0), np.arange(60.0))
    flat = np.c_[u.ravel(), v.ravel()] + 0.1 * rng.standard_normal((3600, 2))
    c, s = np.cos(turn), np.sin(turn)
    return np.c_[flat @ np.array([[c, s], [-s, c]]) + [shift, 0.0], 0.05 * rng.standard_normal(3600)]


def overlaid(points: np.ndarray) -> bool:
    return is_overlay(Neighbourhoods.of(points, np.arange(len(points))))


@pytest.mark.parametrize("shift", [25.0, 40.0])
def test_scans_that_overlap_in_part_are_an_overlay(shift):
    assert overlaid(np.concatenate([raster(0.0, 0.1), raster(shift, 0.3)]))


@pytest.mark.parametrize(
    "points",
    [
        raster(0.0, 0.2),
        np.concatenate([raster(0.0, 0.0), raster(80.0, 0.0)]),
        truth.sphere(4000, 1).points,
        truth.even_sphere(4000, 1).points,
        truth.uneven_sphere(4000, 1).points,
        truth.torus(4000, 1).noisy(0.2, 2),
        truth.box(4000, 1).points,
    ],
    ids=["one scan", "two apart", "random", "even", "uneven", "noisy", "box"],
)
def test_clouds_of_one_kind_are_none(points):
    assert not overlaid(points)
