"""Clouds whose density jumps, as where one scan begins to lie over another or is taken from nearer by."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.patches import local_patches


def parted(shape, n: int, ratio: float, seed: int) -> truth.Sampled:
    """Return n points of a shape, so many times as dense beyond a plane through its middle as on this side."""
    cloud = shape(2 * n, seed)
    beyond = cloud.points @ [0.36, 0.48, 0.8] > 0.0
    kept = np.flatnonzero(beyond | (np.random.default_rng(seed).random(2 * n) < 1.0 / ratio))[:n]
    return truth.Sampled(cloud.points[kept], cloud.normals[kept], cloud.area)


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("ratio", [4.0, 12.0, 30.0])
@pytest.mark.parametrize("shape", [truth.sphere, truth.torus])
def test_no_area_is_lost_where_the_density_jumps(shape, ratio, given):
    """A quarter of a percent was lost at 8, two at 30: triangles between the two sides that dense points dropped."""
    errors = []
    for seed in range(3):
        cloud = parted(shape, 12_000, ratio, seed)
        hood = Neighbourhoods.of(cloud.points, np.arange(len(cloud.points)))
        errors.append(local_patches(hood, cloud.normals if given else None).area / cloud.area - 1.0)
    assert abs(np.mean(errors)) < (0.0012 if ratio < 16.0 else 0.003)


def test_a_border_stays_one_beside_a_jump():
    cloud = parted(truth.square, 12_000, 8.0, 5)
    hood = Neighbourhoods.of(cloud.points, np.arange(len(cloud.points)))
    assert local_patches(hood, cloud.normals).area == pytest.approx(cloud.area, rel=0.006)
