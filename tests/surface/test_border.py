"""Is a place covered? against Delaunay triangulations; and the cells near a border."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay, Voronoi, cKDTree

import naive
from surfel.surface.border import (
    along_border,
    border_cells,
    border_share,
    doubtful_share,
    is_covered,
    nearby_cells,
    unevenness,
    unstirred,
)


@pytest.mark.parametrize("cap2", [1e9, 0.08, 0.02])
@pytest.mark.parametrize("seed", range(8))
def test_a_place_is_covered_if_its_delaunay_triangle_is_small(seed, cap2):
    rng = np.random.default_rng(seed)
    flat = rng.random((rng.integers(3, 40), 2))
    u, v = flat.T.copy()
    diagram = Delaunay(flat)
    answers = []
    for place in rng.random((40, 2)) * 1.2 - 0.1:
        expected = naive.covered(flat, diagram, place, cap2)
        assert bool(is_covered(u, v, len(flat), place[0], place[1], cap2)) == expected
        answers.append(expected)
    if cap2 > 1 and len(flat) > 8:
        assert 0 < sum(answers) < len(answers)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_points_cover_nothing(count):
    assert not is_covered(np.array([0.0, 1.0]), np.array([0.0, 1.0]), count, 0.5, 0.5, 1e9)


def test_points_on_a_line_cover_nothing():
    u = np.linspace(-1.0, 1.0, 9)
    assert not is_covered(u, 0.5 * u, 9, 0.1, 0.05, 1e9)
    assert not is_covered(u, 0.5 * u, 9, 0.1, 0.2, 1e9)


def test_the_share_of_a_border_point_grows_with_the_unevenness():
    assert border_share(0.33) == border_share(0.5) == 0.685
    assert border_share(0.11) == 0.325
    assert border_share(0.0) == border_share(0.02) == 0.0  # the points of a grid lie on the border
    assert 0.37 < border_share(0.14) < border_share(0.2) < 0.685


def test_only_what_may_be_a_grid_leaves_half_a_cell_open():
    assert doubtful_share(0.0) == doubtful_share(0.09) == 0.525
    assert 0.0 < doubtful_share(0.11) < 0.525
    assert doubtful_share(0.12) == doubtful_share(0.33) == 0.0


def test_noise_along_the_surface_is_taken_back_from_the_unevenness():
    rng = np.random.default_rng(0)
    x, y = (a.ravel() for a in np.meshgrid(np.arange(40.0), np.arange(40.0)))
    for noise in (0.1, 0.2, 0.3):
        flat = np.column_stack([x, y]) + noise * rng.standard_normal((1600, 2))
        inside = np.flatnonzero((np.abs(flat - 19.5) < 17.0).all(axis=1))
        areas = np.zeros(1600)
        regions = Voronoi(flat)
        for i in inside:
            areas[i] = ConvexHull(regions.vertices[regions.regions[regions.point_region[i]]]).volume
        closed = np.zeros(1600, np.uint8)
        closed[inside] = 1
        near = cKDTree(flat).query(flat, 13)[1][:, 1:].astype(np.int32)
        assert unstirred(unevenness(areas, closed, near), noise) < 0.05
    assert unstirred(0.2, 0.0) == pytest.approx(0.2, rel=1e-12)
    assert unstirred(0.34, 0.4) == 0.34  # random points stay as random as they were
    assert 0.0 < unstirred(0.2, 0.2) < unstirred(0.25, 0.2) < 0.25


def test_unevenness_compares_closed_cells_with_the_closed_ones_round_them():
    rng = np.random.default_rng(3)
    area, closed = rng.random(60), (rng.random(60) < 0.7).astype(np.uint8)
    near = np.stack([rng.permutation(np.delete(np.arange(60), i))[:24] for i in range(60)]).astype(np.int32)
    off = []
    for i in np.flatnonzero(closed):
        there = [j for j in near[i, :12] if closed[j]]
        if len(there) >= 6:
            off.append(abs(area[i] / area[there].mean() - 1.0))
    assert unevenness(area, closed, near) == pytest.approx(np.median(off), rel=1e-12)
    assert unevenness(area, np.zeros(60, np.uint8), near) == 0.0


def test_the_size_of_nearby_cells_is_the_mean_of_the_nearest_twelve_closed_ones():
    rng = np.random.default_rng(0)
    area, closed = rng.random(50), (rng.random(50) < 0.6).astype(np.uint8)
    neighbours = np.stack([rng.permutation(50)[:30] for _ in range(5)]).astype(np.int32)
    spacing = np.full(50, 0.1)
    sizes = nearby_cells(np.arange(5, dtype=np.int32), neighbours, area, closed, spacing)
    for row, size in enumerate(sizes):
        near = [area[j] for j in neighbours[row] if closed[j]][:12]
        assert size == pytest.approx(np.mean(near), rel=1e-12)
    closed[:] = 0
    closed[:3] = 1
    np.testing.assert_allclose(nearby_cells(np.arange(5, dtype=np.int32), neighbours, area, closed, spacing), 0.005)


def test_cells_at_the_border_follow_those_farther_inside():
    rng = np.random.default_rng(1)
    points, neighbours = rng.random((60, 3)), np.stack([rng.permutation(np.arange(4, 60))[:40] for _ in range(4)])
    closed = (rng.random(60) < 0.7).astype(np.uint8)
    area = np.ones(60)
    chosen, near = np.arange(4, dtype=np.int32), neighbours.astype(np.int32)
    np.testing.assert_allclose(border_cells(points, chosen, near, area, closed), 1.0, rtol=1e-12)
    area = 1.0 + 0.3 * points[:, 0] + 0.2 * rng.random(60)
    for row, size in enumerate(border_cells(points, chosen, near, area, closed)):
        there = [j for j in near[row] if closed[j]]
        middle = points[there].mean(axis=0)
        way = points[row] - middle
        slope, level = np.polyfit((points[there] - middle) @ way, area[there], 1)
        assert size == pytest.approx(level + slope * (way @ way), rel=1e-9)
    area = np.exp(9.0 * points[:, 0])
    means = [area[[j for j in near[row] if closed[j]]].mean() for row in range(4)]
    sizes = border_cells(points, chosen, near, area, closed) / means
    assert (sizes >= 0.5 - 1e-12).all()
    assert (sizes <= 2.0 + 1e-12).all()
    assert border_cells(points, chosen, near, area, np.zeros(60, np.uint8)).tolist() == [0.0] * 4


def test_a_border_is_where_enough_neighbours_are_open_and_uncovered():
    opened = np.array([1, 1, 1, 0, 0, 1], bool)
    uncovered = np.array([1, 0, 1, 0, 0, 0], bool)
    near = np.array([[1, 2, 3], [0, 3, 4], [1, 0, 3], [1, 2, 3]], np.int32)
    chosen = np.array([0, 1, 2, 5], np.int32)
    straight, told = along_border(chosen, near, opened, uncovered)
    assert straight.tolist() == [True, False, True, True]
    assert told.tolist() == [True, False, True, False]
