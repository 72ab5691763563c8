"""The coloured grid: its border is tight, its components are those of a plain flood fill, its balls tell the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from surfel.inside.border import disk_radii, mark_border
from surfel.inside.colour import clearance, colour_space
from surfel.inside.components import connect
from surfel.inside.grid import BORDER, IN, OUT, Grid, frame_for
from surfel.inside.operand import Operand
from surfel.inside.owners import own_cells


def ball(n: int, seed: int = 0) -> Operand:
    p = np.random.default_rng(seed).standard_normal((n, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    return Operand.of(p, p)


def unpacked(table: np.ndarray, words: np.ndarray) -> np.ndarray:
    """Return the bits of all cells as one dense array."""
    cells = np.zeros((*table.shape, 8, 8, 8), bool)
    for place in np.argwhere(table >= 0):
        bits = words[table[tuple(place)]][:, None] >> np.arange(64, dtype=np.uint64) & np.uint64(1)
        cells[tuple(place)] = bits.reshape(8, 8, 8).astype(bool)
    return cells.transpose(0, 3, 1, 4, 2, 5).reshape(tuple(8 * s for s in table.shape))


def dense_colours(grid: Grid) -> np.ndarray:
    """Return the colour of every cell."""
    colours = np.where(unpacked(grid.table, grid.inside), IN, OUT)
    whole = np.kron(np.where(grid.table < 0, -1 - grid.table, 0), np.ones((8, 8, 8), int))
    return np.where(unpacked(grid.table, grid.border), BORDER, np.maximum(colours, whole))


def test_border_is_what_the_planes_of_the_disks_meet() -> None:
    cloud = ball(300)
    frame = frame_for(cloud.bounds, cloud.spacings)
    radii = disk_radii(cloud.spacings, cloud.areas, frame.step)
    marked = unpacked(*mark_border(frame, cloud.points, cloud.normals, radii)[:2])
    middles = (np.indices(marked.shape) + 0.5) * frame.step + frame.low[:, None, None, None]
    expected = np.zeros(marked.shape, bool)
    for point, normal, radius in zip(cloud.points, cloud.normals, radii, strict=True):
        off = middles - point[:, None, None, None]
        reach = radius * np.sqrt(1.0 - normal**2) + 0.5 * frame.step
        in_box = (np.abs(off) <= reach[:, None, None, None]).all(axis=0)
        expected |= in_box & (np.abs(np.tensordot(normal, off, 1)) <= 0.5 * frame.step * np.abs(normal).sum())
    assert (marked == expected).all()


def test_components_are_those_of_a_plain_flood_fill() -> None:
    rng = np.random.default_rng(3)
    table = np.full((3, 2, 3), -1, np.int32)
    table.ravel()[rng.permutation(18)[:12]] = np.arange(12)
    words = rng.integers(0, 2**64, (2, 12, 8), dtype=np.uint64)
    border = words[0] | words[1]
    found = connect(table, border)
    labels, count = ndimage.label(~unpacked(table, border))
    mine = np.full(labels.shape, -1)
    for place in np.ndindex(*table.shape):
        box = tuple(slice(8 * p, 8 * p + 8) for p in place)
        brick = table[place]
        if brick < 0:
            mine[box] = found.of_brick[place]
            continue
        for part in range(found.start[brick], found.start[brick + 1]):
            cells = unpacked(np.zeros((1, 1, 1), np.int32), found.parts[part : part + 1])
            mine[box][cells] = found.of_part[part]
    assert ((mine < 0) == (labels == 0)).all()
    free = labels > 0
    pairs = np.unique(np.stack([mine[free], labels[free]]), axis=1)
    assert count == found.number == pairs.shape[1] and count > 10


def test_clearance_is_the_chebyshev_distance() -> None:
    table = np.where(np.random.default_rng(0).random((9, 7, 8)) < 0.02, 0, -1).astype(np.int32)
    assert (clearance(table) == ndimage.distance_transform_cdt(table < 0, "chessboard")).all()
    assert (clearance(np.full((2, 2, 2), -1, np.int32)) == 255).all()


def test_a_ball_takes_a_colour_only_where_all_its_cells_have_it() -> None:
    grid = colour_space(ball(3000)).grid
    colours = np.pad(dense_colours(grid), 60, constant_values=OUT)
    rng = np.random.default_rng(1)
    settled = 0
    for middle, radius in zip(rng.uniform(-1.6, 1.6, (800, 3)), rng.uniform(0.0, 0.5, 800), strict=True):
        found = _colour_of_ball(grid, middle, radius)
        low = np.floor((middle - radius - grid.low) / grid.step).astype(int) + 60
        high = np.floor((middle + radius - grid.low) / grid.step).astype(int) + 61
        met = np.unique(colours[low[0] : high[0], low[1] : high[1], low[2] : high[2]]).tolist()
        settled += found != BORDER
        assert met == [found] if found != BORDER else BORDER in met
    assert 200 < settled < 800


def _colour_of_ball(grid: Grid, middle: np.ndarray, radius: float) -> int:
    """Ask the kernel about one place and what is within reach of it."""
    from surfel.inside.looks import Looks
    from surfel.inside.owners import Owners
    from surfel.inside.sift import sift
    from surfel.inside.slabs import Slabs

    none = np.empty(0, np.int32)
    nothing = Owners(np.zeros((0, 8), np.int32), np.zeros((0, 8), np.uint64), none, np.empty((0, 3)))
    still = np.eye(4)[:3].copy()
    kind, near = sift(Looks.of(grid, nothing, None), Slabs.none(), None, middle[None], still, radius)
    return BORDER if near[0] else int(kind[0])


def test_no_free_cell_of_a_ball_is_coloured_wrongly() -> None:
    found = colour_space(ball(20_000))
    colours = dense_colours(found.grid)
    middles = (np.indices(colours.shape) + 0.5) * found.grid.step + found.grid.low[:, None, None, None]
    inside = np.linalg.norm(middles, axis=0) < 1.0
    assert not found.leaky and found.conflict == 0.0
    assert (colours[inside] != OUT).all() and (colours[~inside] != IN).all()
    assert (colours == IN).sum() > 0.5 * inside.sum()


def test_owners_count_the_surfels_of_each_cell() -> None:
    cloud = ball(2000)
    frame = frame_for(cloud.bounds, cloud.spacings)
    bricks = mark_border(frame, cloud.points, cloud.normals, disk_radii(cloud.spacings, cloud.areas, frame.step))
    owners = own_cells(frame, bricks, cloud.points, cloud.normals)
    cell = np.floor((cloud.points - frame.low) / frame.step).astype(int)
    _, expected = np.unique(cell, axis=0, return_inverse=True)
    pairs = np.unique(np.stack([owners.of_surfel, expected.ravel()]), axis=1)
    assert len(owners.normals) == expected.max() + 1 == pairs.shape[1]
    together = owners.of_surfel == owners.of_surfel[0]
    assert owners.normals[owners.of_surfel[0]] == pytest.approx(cloud.normals[together].mean(axis=0))


def test_the_grid_stays_small_for_a_cloud_with_a_far_stray() -> None:
    cloud = ball(3000)
    points = np.concatenate([cloud.points, [[1e7, 0.0, 0.0]]])
    normals = np.concatenate([cloud.normals, [[1.0, 0.0, 0.0]]])
    assert colour_space(Operand.of(points, normals)).grid.table.size <= 2**21
