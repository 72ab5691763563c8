"""Strays near a surface: those that stand out are found, no surface is, and what is left is judged."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel
from surfel._numba import threads_for
from surfel.surface.neighbourhoods import cleaned
from surfel.surface.patches import local_patches


def _cleaned(points):
    """Return the neighbourhoods, the rows that were dropped, and the scale."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    scale = np.abs(points - middle).max()
    hood, _ = cleaned((points - middle) / scale, None)
    return hood, np.setdiff1d(np.arange(len(points)), hood.rows), scale


def _above(cloud, count, low, high, seed):
    """Return places between two heights, in spacings, on either side of some points."""
    rng = np.random.default_rng(seed)
    chosen = rng.permutation(len(cloud.points))[:count]
    height = rng.uniform(low, high, count) * rng.choice([-1.0, 1.0], count) * cloud.spacing
    return cloud.points[chosen] + height[:, None] * cloud.normals[chosen]


def _in_a_box(points, share, seed):
    low, high = points.min(axis=0), points.max(axis=0)
    random = np.random.default_rng(seed).random((round(share * len(points)), 3))
    return 0.5 * (low + high) + 1.5 * (random - 0.5) * (high - low)


def _plates(gap, ratio):
    """Return a square and a sparser one over it, so many spacings of the first away."""
    dense, sparse = truth.square(6000, 1), truth.square(round(6000 / ratio), 2).points
    return np.concatenate([dense.points, sparse + [0.0, 0.0, gap * dense.spacing]])


def _cone(steep):
    """Return points of a cone."""
    rng = np.random.default_rng(3)
    out, turn = np.sqrt(rng.random(6000)), 2.0 * np.pi * rng.random(6000)
    return np.column_stack([out * np.cos(turn), out * np.sin(turn), -steep * out])


SURFACES = {
    "cone": _cone(1.0),
    "steep cone": _cone(4.0),
    "plates 1 apart": _plates(1.0, 1.0),
    "plates 3 apart": _plates(3.0, 1.0),
    "noise of 0.3": truth.torus(20_000, 1).noisy(0.3, 2),
    "noise of 0.5": truth.sphere(20_000, 1).noisy(0.5, 2),
    "noise of 0.5 on a square": truth.square(20_000, 1).noisy(0.5, 2),
    "box": truth.box(20_000, 4).points,
    "thin torus": truth.torus(8000, 1, 1.0, 0.02).points,
    "two crossing squares": truth.crossing_squares(20_000, 1).points,
}


@pytest.mark.parametrize("name", SURFACES)
def test_no_point_of_a_surface_is_taken_for_a_stray(name):
    hood, dropped, _ = _cleaned(SURFACES[name])
    assert len(dropped) == 0
    assert hood.left == (0.0, 0.0)


@pytest.mark.parametrize("height", [(0.7, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 4.0)])
@pytest.mark.parametrize("shape", [truth.sphere, truth.torus, truth.square])
def test_strays_near_a_surface_are_found(shape, height):
    cloud = shape(10_000, 5)
    dropped = _cleaned(np.concatenate([cloud.points, _above(cloud, 60, *height, 6)]))[1]
    assert (dropped >= 10_000).all()
    assert len(dropped) >= 51


@pytest.mark.parametrize(("gap", "ratio"), [(2.0, 5.0), (4.0, 10.0)])
def test_a_sparse_sheet_over_a_dense_one_loses_few_points(gap, ratio):
    """Single points of it may lie nearer to the dense sheet than to any of their own."""
    dropped = _cleaned(_plates(gap, ratio))[1]
    assert (dropped >= 6000).all()
    assert len(dropped) <= 0.06 * 6000 / ratio


def test_strays_that_hide_each_other_are_found():
    cloud = truth.sphere(10_000, 5)
    first = cloud.points[:20] * (1.0 + 4.0 * cloud.spacing)
    second = cloud.points[:20] * (1.0 + 6.0 * cloud.spacing)
    dropped = _cleaned(np.concatenate([cloud.points, first, second]))[1]
    assert (dropped >= 10_000).all()
    assert len(dropped) >= 36


def test_strays_do_not_depend_on_order_place_scale_or_threads():
    cloud = truth.torus(10_000, 5)
    points = np.concatenate([cloud.points, _above(cloud, 100, 0.0, 5.0, 6)])
    hood, dropped, scale = _cleaned(points)
    left = hood.left.half_width * scale**2
    for seed, size in enumerate((1e-6, 1.0, 1e9)):
        order = np.random.default_rng(seed).permutation(len(points))
        turned = (points[order] @ truth.rotation(seed).T + [3.0, -1.0, 2.0]) * size
        other, rows, scale = _cleaned(turned)
        assert set(order[rows]) == set(dropped)
        assert other.left.half_width * (scale / size) ** 2 == pytest.approx(left, rel=1e-6)
    with threads_for(1 << 20, 1):
        assert _cleaned(points)[0].left == hood.left


@pytest.mark.parametrize("share", [0.01, 0.03])
@pytest.mark.parametrize("shape", [truth.sphere, truth.torus, truth.box])
def test_what_strays_add_that_are_left_is_about_what_is_expected(shape, share):
    cloud = shape(10_000, 5)
    before = local_patches(cleaned(cloud.points, None)[0]).area
    added, expected = [], []
    for seed in range(3):
        hood, _, scale = _cleaned(np.concatenate([cloud.points, _in_a_box(cloud.points, share, seed)]))
        added.append(local_patches(hood).area * scale**2 - before)
        expected.append(hood.left.expected * scale**2)
        assert added[-1] <= 1.5 * hood.left.half_width * scale**2
        assert hood.left.half_width > hood.left.expected > 0.0
    assert 0.2 * np.mean(expected) <= np.mean(added) <= 2.0 * np.mean(expected)


def test_the_interval_holds_the_area_and_the_warning_says_why_it_is_wide():
    cloud = truth.box(10_000, 5)
    area = surfel.measure(surfel.Surfels(cloud.points), lines=16).area
    m = surfel.measure(surfel.Surfels(np.concatenate([cloud.points, _in_a_box(cloud.points, 0.03, 1)])), lines=16)
    assert m.area.reliable and m.area.standard_error > area.standard_error
    assert abs(m.area.value - cloud.area) < 2.0 * m.area.standard_error
    assert any("not all strays near the surface can be told" in text for text in m.warnings)
