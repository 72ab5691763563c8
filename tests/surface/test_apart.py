"""Strays in pairs and small clusters: those apart from all else are found, and no part of a surface is."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel
from surfel._numba import threads_for
from surfel.surface.apart import strays_apart
from surfel.surface.near_strays import FEW
from surfel.surface.neighbourhoods import COLUMNS, Neighbourhoods

NONE = np.empty(0, np.int64)


def _apart(points):
    """Return the rows of the cloud that lie in groups far from a surface, and in groups off one."""
    hood = Neighbourhoods.of(points / np.abs(points).max(), np.arange(len(points)), COLUMNS)
    far, off = strays_apart(hood.points, hood.squared, hood.near, hood.spacing, NONE)
    return np.sort(hood.rows[far]), np.sort(hood.rows[off.rows])


def _clusters(cloud, count, size, height, seed):
    """Return groups of so many points, half a spacing wide, so many spacings above points of a cloud."""
    rng = np.random.default_rng(seed)
    chosen = rng.permutation(len(cloud.points))[:count]
    middle = cloud.points[chosen] + height * cloud.spacing * cloud.normals[chosen]
    return (middle[:, None] + rng.normal(0.0, 0.25 * cloud.spacing, (count, size, 3))).reshape(-1, 3)


@pytest.mark.parametrize("shape", [truth.sphere, truth.torus, truth.box, truth.square])
@pytest.mark.parametrize(("size", "height"), [(2, 5.0), (5, 4.0), (8, 4.0), (10, 8.0), (11, 12.0)])
def test_groups_of_few_points_are_found(shape, size, height):
    cloud = shape(6000, 5)
    strays = _clusters(cloud, 4, size, height, 6)
    far, off = _apart(np.concatenate([cloud.points, strays]))
    found = np.concatenate([far, off])
    assert (found >= 6000).all()
    assert len(np.unique(found)) == len(found) >= 0.9 * len(strays)


def test_a_group_that_may_be_a_surface_is_left():
    cloud = truth.sphere(6000, 5)
    far, off = _apart(np.concatenate([cloud.points, _clusters(cloud, 10, 2 * FEW, 8.0, 6)]))
    assert len(far) == len(off) == 0


def _strip_between(ratio):
    """Return a square with a strip in which so many times fewer points lie."""
    points = truth.square(12_000, 3).points
    strip = np.abs(points[:, 0] - points[:, 0].mean()) < 0.02 * np.ptp(points[:, 0])
    return points[~strip | (np.random.default_rng(4).random(len(points)) < 1.0 / ratio)]


CLEAN = {
    "sphere": truth.sphere(6000, 1).points,
    "box": truth.box(6000, 4).points,
    "sparse strip": _strip_between(8.0),
    "very sparse strip": _strip_between(30.0),
    "noise of 0.5": truth.torus(6000, 1).noisy(0.5, 2),
    "two plates": np.concatenate([truth.square(3000, 1).points, truth.square(300, 2).points + [0.0, 0.0, 0.3]]),
}


@pytest.mark.parametrize("name", CLEAN)
def test_no_part_of_a_surface_is_apart(name):
    far, off = _apart(CLEAN[name])
    assert len(far) == len(off) == 0


def test_the_rows_do_not_depend_on_order_place_or_threads():
    cloud = truth.torus(6000, 5)
    points = np.concatenate([cloud.points, *(_clusters(cloud, 8, m, 2.0 + m, m) for m in range(2, 12))])
    expected = [set(rows) for rows in _apart(points)]
    assert len(expected[0]) > 50 and len(expected[1]) > 50
    order = np.random.default_rng(1).permutation(len(points))
    turned = points[order] @ truth.rotation(1).T * 1e-3
    assert [set(order[rows]) for rows in _apart(turned)] == expected
    with threads_for(1 << 20, 1):
        assert [set(rows) for rows in _apart(points)] == expected


def test_clusters_change_the_area_little_and_are_counted():
    cloud = truth.torus(6000, 5)
    strays = _clusters(cloud, 12, 8, 10.0, 6)
    m = surfel.measure(surfel.Surfels(np.concatenate([cloud.points, strays])), lines=16)
    assert m.cleaning["strays"] == len(strays)
    assert m.area.value == pytest.approx(cloud.area, rel=0.005)
