"""Is a place covered? against Delaunay triangulations; and the cells near a border."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import Delaunay

import naive
from surfel.surface.border import along_border, border_share, is_covered, nearby_cells, unevenness


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
    assert border_share(0.33) == border_share(0.5) == 0.715
    assert border_share(0.0) == border_share(0.11) == 0.34
    assert 0.39 < border_share(0.14) < border_share(0.2) < 0.715


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


def test_a_border_is_where_enough_neighbours_are_open_and_uncovered():
    opened = np.array([1, 1, 1, 0, 0, 1], bool)
    uncovered = np.array([1, 0, 1, 0, 0, 0], bool)
    near = np.array([[1, 2, 3], [0, 3, 4], [1, 0, 3], [1, 2, 3]], np.int32)
    chosen = np.array([0, 1, 2, 5], np.int32)
    assert along_border(chosen, near, opened, uncovered).tolist() == [True, False, True, False]
