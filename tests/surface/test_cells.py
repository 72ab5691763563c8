"""Cells against Voronoi diagrams of the plane, what unfolds over an edge, and what stays apart."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import Delaunay

import naive
import shapes_with_truth as truth
from surfel.surface.cells import UNCOVERED, Cells
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.patches import local_patches

STAR = 16


def _cells(points, normals):
    """Return the cells and the spacing in the order of the points."""
    local = local_patches(Neighbourhoods.of(points, np.arange(len(points))), normals, noise=0.0, star=STAR)
    rows = np.argsort(local.hood.rows)
    star = np.where(local.cells.star >= 0, local.hood.rows[local.cells.star], -1)
    cells = local.cells._replace(star=star)
    return Cells(*(np.asarray(part)[rows] for part in cells)), local.hood.spacing[rows]


@pytest.fixture(scope="module", params=[(0, False), (1, True)], ids=["flat", "tilted, any sign"])
def planar(request):
    seed, tilted = request.param
    rng = np.random.default_rng(seed)
    flat = rng.random((700, 2))
    normal = np.array([0.36, 0.48, 0.8]) if tilted else np.array([0.0, 0.0, 1.0])
    signs = np.where(rng.random(700) < 0.5, -1.0, 1.0)[:, None] if tilted else np.ones((700, 1))
    points = flat @ np.stack(naive.frame(normal)) + (1.0 if tilted else 0.0)
    return flat, *_cells(points, signs * normal)


def test_closed_cells_are_those_of_the_voronoi_diagram(planar):
    flat, cells, _ = planar
    closed = cells.closed == 1
    assert closed.mean() > 0.85
    np.testing.assert_allclose(cells.area[closed], naive.voronoi_areas(flat)[closed], rtol=1e-9)


def test_a_cell_is_open_only_where_a_corner_is_far(planar):
    flat, cells, spacing = planar
    for i in np.concatenate([np.flatnonzero(cells.closed)[::60], np.flatnonzero(cells.closed == 0)[::12]]):
        others = np.delete(flat, i, axis=0) - flat[i]
        others = others[np.argsort((others**2).sum(axis=1))[:40]]
        corners = naive.clipped_cell(others, 8.0 * spacing[i])
        farthest = np.sqrt((corners**2).sum(axis=1).max()) / spacing[i]
        assert farthest < 3.0 if cells.closed[i] else farthest > 1.5


def test_stars_are_the_neighbours_of_the_delaunay_triangulation(planar):
    flat, cells, _ = planar
    start, neighbours = Delaunay(flat).vertex_neighbor_vertices
    for i in np.flatnonzero(cells.closed):
        star = cells.star[i][cells.star[i] >= 0]
        if len(star) < STAR:
            assert set(star) == set(neighbours[start[i] : start[i + 1]])
            assert cells.joined[i] == (1 << len(star)) - 1


def test_a_plane_is_smooth_and_only_open_cells_can_be_uncovered(planar):
    _, cells, _ = planar
    assert np.abs(cells.rough).max() < 1e-20
    assert np.abs(cells.curved).max() < 1e-20
    uncovered = (cells.uncovered & UNCOVERED) > 0
    assert not uncovered[cells.closed == 1].any()
    assert uncovered[cells.closed == 0].any()


def test_a_star_with_more_neighbours_than_are_kept_does_not_join_the_last_to_the_first():
    ring = np.arange(20) * 2.0 * np.pi / 20
    points = np.concatenate([[[0.0, 0.0, 0.0]], np.column_stack([np.cos(ring), np.sin(ring), 0 * ring])])
    cells, _ = _cells(points, np.tile([0.0, 0.0, 1.0], (21, 1)))
    assert (cells.star[0] >= 0).all()
    assert cells.joined[0] == (1 << (STAR - 1)) - 1
    assert cells.area[0] == pytest.approx(20 * np.tan(np.pi / 20) / 4, rel=1e-12)


def test_over_a_sharp_edge_cells_are_those_of_the_unfolded_plane():
    # rows of a shaken grid, so that every point has neighbours enough in its own plane
    rng = np.random.default_rng(7)
    x, y = np.meshgrid(np.arange(-15, 15) + 0.5, np.arange(30.0))
    unfolded = (np.column_stack([x.ravel(), y.ravel()]) + 0.2 * rng.random((900, 2))) / 30.0
    s, y = unfolded.T
    upright = s < 0.0
    points = np.where(upright[:, None], np.column_stack([0 * s, y, s]), np.column_stack([s, y, 0 * s]))
    normals = np.where(upright[:, None], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    cells, spacing = _cells(points, normals)
    at_edge = (np.abs(s) < spacing) & (cells.closed == 1)
    assert at_edge.sum() > 40
    np.testing.assert_allclose(cells.area[at_edge], naive.voronoi_areas(unfolded)[at_edge], rtol=1e-9)


@pytest.mark.parametrize("gap", [1.0, 2.0, 5.0])
def test_parallel_sheets_do_not_see_each_other(gap):
    rng = np.random.default_rng(8)
    low, high = rng.random((2, 600, 2))
    distance = 0 * low[:, 0] + gap / np.sqrt(600)
    points = np.concatenate([np.column_stack([low, 0 * distance]), np.column_stack([high, distance])])
    cells, _ = _cells(points, np.tile([0.0, 0.0, 1.0], (1200, 1)))
    closed = cells.closed == 1
    alone = np.concatenate([naive.voronoi_areas(low), naive.voronoi_areas(high)])
    assert closed.mean() > 0.8
    finite = closed & np.isfinite(alone)
    assert cells.area[finite].sum() == pytest.approx(alone[finite].sum(), rel=0.02)
    if gap >= 2.0:
        np.testing.assert_allclose(np.median(cells.area[finite] / alone[finite]), 1.0, rtol=1e-9)


def test_cells_of_a_smooth_surface_tile_it():
    ball = truth.even_sphere(700, 1)
    cells, _ = _cells(ball.points, ball.normals)
    assert (cells.closed == 1).all()
    assert cells.area.sum() == pytest.approx(4 * np.pi, rel=0.01)
    assert cells.rough.max() < 1e-12  # a sphere bends, but has no relief
