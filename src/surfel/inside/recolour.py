"""Recolour: where surfels are edited, only the bricks round them are marked, connected and coloured anew."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.inside.border import mark_border, touched_bricks
from surfel.inside.colour import Coloured, clearance
from surfel.inside.components import Components, connect
from surfel.inside.grid import ALL_IN, ALL_OUT, IN, MOST_BRICKS, OUT, SIDE, Frame, Grid
from surfel.inside.operand import Operand
from surfel.inside.owners import Owners, cells_of, mean_normals, number_cells
from surfel.inside.space import border_radii

_FULL = np.uint64(0xFFFFFFFFFFFFFFFF)


class Patch(NamedTuple):
    """What was coloured anew.

    Parameters
    ----------
    coloured : Coloured
        The whole space.
    place : NDArray[np.int32], shape (b, 3)
        Where in the table the new bricks stand.
    held : NDArray[np.int64], shape (m,)
        The sorted rows of the surfels whose centres they hold.
    """

    coloured: Coloured
    place: NDArray[np.int32]
    held: NDArray[np.int64]


def recolour(coloured: Coloured, operand: Operand, edited: NDArray[np.int64]) -> Patch | None:
    """Colour the neighbourhood of edited surfels (sorted rows of ``operand``) anew.

    The bricks that the old and the new disks meet, and those next to them, are marked anew. The free space in their box
    is connected, and each component takes the colour that its cells outside of these bricks had. Where there is none,
    or there are two, or space leaked before, the answer is None: then everything has to be coloured anew.
    """
    grid, before = _with_room(coloured.grid, operand.points[edited]), coloured.operand
    if coloured.leaky or grid is None:
        return None
    frame = Frame(grid.low, grid.step, grid.table.shape)
    radii = border_radii(operand, grid.step)
    region = np.zeros(frame.bricks, bool)
    for cloud in (before, operand):
        region |= touched_bricks(frame, cloud.points[edited], cloud.normals[edited], radii[edited]).astype(bool)
    region = _widened(region)
    near = _surfels_near(frame, operand, region, float(radii.max()))
    bricks = mark_border(frame, operand.points[near], operand.normals[near], radii[near])

    corner = np.maximum(np.argwhere(region).min(axis=0) - 1, 0)  # with the bricks next to them, whose colours are known
    end = np.minimum(np.argwhere(region).max(axis=0) + 2, frame.bricks)
    box = tuple(slice(a, b) for a, b in zip(corner, end, strict=True))
    table, border = _box_of(grid, box, region[box], bricks.table[box], bricks.border)
    parts = connect(table, border)
    colours = _known_colours(grid, box, region[box], table, parts)
    if colours is None:
        return None

    place = np.argwhere(region).astype(np.int32)
    inner = table[tuple((place - corner).T)]
    words, inside = _paint(parts, border, inner, place - corner, colours)
    first = len(grid.border)
    owned = np.zeros((len(place), 8), np.uint64)
    has = bricks.table[tuple(place.T)]
    owned[has >= 0] = bricks.owned[has[has >= 0]]
    new_table = grid.table.copy()
    new_table[tuple(place.T)] = np.arange(first, first + len(place))
    owners, held = _with_owners(coloured.owners, first, owned, new_table, frame, operand, near, region)
    whole_out = ((words == 0) & (inside == 0)).all(axis=1)
    whole_in = ((words == 0) & (inside == _FULL)).all(axis=1)
    new_table[tuple(place[whole_out].T)], new_table[tuple(place[whole_in].T)] = ALL_OUT, ALL_IN
    place = place[~(whole_out | whole_in)]
    all_border, all_inside = np.concatenate([grid.border, words]), np.concatenate([grid.inside, inside])
    new_grid = Grid(grid.low, grid.step, new_table, all_border, all_inside, clearance(new_table))
    return Patch(coloured._replace(grid=new_grid, owners=owners, operand=operand, radii=radii), place, held)


def _with_room(grid: Grid, places: Floats) -> Grid | None:
    """Return the grid with so many more bricks of outside that places stay clear of its outermost cells, if it can."""
    cell = (places - grid.low) / grid.step
    before = np.ceil(np.maximum(2.0 - cell.min(axis=0), 0.0) / SIDE)
    after = np.ceil(np.maximum(cell.max(axis=0) + 2.0 - SIDE * np.array(grid.table.shape), 0.0) / SIDE)
    if not (before.any() or after.any()):
        return grid
    if float(np.prod(grid.table.shape + before + after)) > MOST_BRICKS:
        return None
    room = np.stack([before, after], axis=1).astype(np.int64)
    table = np.pad(grid.table, room, constant_values=ALL_OUT)
    return grid._replace(low=grid.low - before * SIDE * grid.step, table=table, gap=clearance(table))


def _widened(region: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Add the bricks next to a region."""
    for axis in range(3):
        wide = region.copy()
        one, two = [slice(None)] * 3, [slice(None)] * 3
        one[axis], two[axis] = slice(1, None), slice(None, -1)
        wide[tuple(one)] |= region[tuple(two)]
        wide[tuple(two)] |= region[tuple(one)]
        region = wide
    return region


def _surfels_near(frame: Frame, operand: Operand, region: NDArray[np.bool_], reach: float) -> NDArray[np.int64]:
    """Return the sorted rows of all surfels whose disks may meet the region."""
    side = SIDE * frame.step
    middles = frame.low + (np.argwhere(region) + 0.5) * side
    rows = operand.index.radius_of(middles + operand.origin, 0.5 * np.sqrt(3.0) * side + reach)[1]
    return np.unique(rows).astype(np.int64)


def _box_of(
    grid: Grid,
    box: tuple[slice, ...],
    region: NDArray[np.bool_],
    fresh: NDArray[np.int32],
    border: NDArray[np.uint64],
) -> tuple[NDArray[np.int32], NDArray[np.uint64]]:
    """Return a table of the box and its words: new ones in the region, the old ones elsewhere."""
    old = grid.table[box]
    kept = ~region & (old >= 0)
    taken = region & (fresh >= 0)
    table = np.full(region.shape, -1, np.int32)
    table[taken] = np.arange(int(taken.sum()))
    table[kept] = int(taken.sum()) + np.arange(int(kept.sum()))
    return table, np.concatenate([border[fresh[taken]], grid.border[old[kept]]])


def _known_colours(
    grid: Grid, box: tuple[slice, ...], region: NDArray[np.bool_], table: NDArray[np.int32], parts: Components
) -> NDArray[np.int8] | None:
    """Return the colour of each component from its cells outside the region; None where that is not one colour."""
    seen = np.zeros((parts.number, 2), bool)
    old = grid.table[box]
    empty = ~region & (table < 0)
    seen[parts.of_brick[empty], -1 - old[empty]] = True
    for number, brick in zip(table[~region & (table >= 0)], old[~region & (table >= 0)], strict=True):
        for part in range(parts.start[number], parts.start[number + 1]):
            within = bool((parts.parts[part] & grid.inside[brick]).any())
            seen[parts.of_part[part], IN if within else OUT] = True
    if seen.all(axis=1).any() or not seen.any(axis=1).all():
        return None
    return np.where(seen[:, IN], IN, OUT).astype(np.int8)


def _paint(
    parts: Components,
    border: NDArray[np.uint64],
    numbers: NDArray[np.int32],
    place: NDArray[np.int64],
    colours: NDArray[np.int8],
) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """Return the border and the inside bits of the bricks of the region."""
    words, inside = np.zeros((len(numbers), 8), np.uint64), np.zeros((len(numbers), 8), np.uint64)
    for row, number in enumerate(numbers):
        if number < 0:
            inside[row] = _FULL if colours[parts.of_brick[tuple(place[row])]] == IN else np.uint64(0)
            continue
        words[row] = border[number]
        for part in range(parts.start[number], parts.start[number + 1]):
            if colours[parts.of_part[part]] == IN:
                inside[row] |= parts.parts[part]
    return words, inside


def _with_owners(
    owners: Owners, first: int, owned: NDArray[np.uint64], table: NDArray[np.int32], frame: Frame, operand: Operand,
    near: NDArray[np.int64], region: NDArray[np.bool_],
) -> tuple[Owners, NDArray[np.int64]]:  # fmt: skip
    """Add the owning cells of the new bricks, numbered ``first`` and up; return them, and the surfels they hold."""
    room = first - len(owners.base)  # bricks that hold no centres
    base = np.concatenate([owners.base, np.zeros((room, 8), np.int32), np.zeros(owned.shape, np.int32)])
    words = np.concatenate([owners.owned, np.zeros((room, 8), np.uint64), owned])
    known = len(owners.normals)
    total = number_cells(owned, base[first:], known)
    cell = ((operand.points[near] - frame.low) / frame.step).astype(np.int64)
    held = near[region[tuple((cell >> 3).T)]]
    of_surfel = owners.of_surfel.copy()
    of_surfel[held] = cells_of(operand.points[held], frame.low, frame.step, table, words, base)
    fresh = mean_normals(of_surfel[held] - known, operand.normals[held], total - known)
    return Owners(base, words, of_surfel, np.concatenate([owners.normals, fresh])), held
