"""Repair: space that leaks through a hole is parted by the winding number of the cloud."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel, rows, threads_for
from surfel.core.cast import Booleans, Floats
from surfel.inside.components import Components
from surfel.inside.grid import ALL_IN, ALL_OUT, SIDE, Grid
from surfel.inside.operand import Operand

UNSURE = 0.1
"""Cells whose winding number is nearer to 1/2 than this are left to the judge."""

FREE = 50_000
"""So many cells, and as many again as there are surfels, are asked in their parts and once more in empty bricks."""

Words = NDArray[np.uint64]
Whole = NDArray[np.integer[Any]]
Ask = Callable[[Floats], Floats]

_SAMPLES = 4
_WIDTHS = (16, 4, 1)  # blocks of empty bricks are asked first, and those in which places disagree are divided
_SPREAD = np.array([[8, 8, 8], [1, 1, 1], [15, 15, 1], [15, 1, 15], [1, 15, 15]]) / 16.0
_FULL = np.uint64(0xFFFFFFFFFFFFFFFF)


def repair(grid: Grid, parts: Components, leaky: Booleans, operand: Operand) -> tuple[Grid, NDArray[np.uint64]]:
    """Colour the leaky components by the winding number.

    A few cells of each part of a brick are asked. Where they agree, and clearly, the part takes their colour whole;
    elsewhere each cell is asked. Cells near the level 1/2 become border; they are the doubt that is returned, as bits.
    """
    from surfel.inside.colour import clearance
    from surfel.inside.judges import named

    winding = named("winding")

    def ask(places: Floats) -> Floats:
        return winding(operand, places + operand.origin).value  # negative inside

    most = len(operand) + FREE
    table = grid.table.copy()
    border, inside = grid.border.copy(), grid.inside.copy()
    doubt = np.zeros_like(border)
    where = _positions(table, len(border))
    of_brick = np.repeat(np.arange(len(parts.start) - 1), np.diff(parts.start)).astype(np.int32)

    chosen = np.flatnonzero(leaky[parts.of_part]).astype(np.int32)
    value = ask(_sample_places(grid, parts, chosen, of_brick, where)).reshape(-1, _SAMPLES)
    clear_in, clear_out = (value < -UNSURE).all(axis=1), (value > UNSURE).all(axis=1)
    for part in chosen[clear_in]:
        inside[of_brick[part]] |= parts.parts[part]
    mixed = chosen[~(clear_in | clear_out)]
    masks, numbers = parts.parts[mixed], of_brick[mixed]
    _ask_cells(grid, ask, masks, numbers, where[numbers], border, inside, doubt, most)

    table, border, inside, doubt = _ask_bricks(grid, ask, parts, leaky, table, border, inside, doubt, most)
    return Grid(grid.low, grid.step, table, border, inside, clearance(table)), doubt


def in_doubt(grid: Grid, doubt: NDArray[np.uint64], places: Floats) -> Booleans:
    """Tell which places, in the operand's coordinates, lie in cells of the doubt."""
    cell = np.floor((places - grid.low) / grid.step).astype(np.int64)
    held: Booleans = np.asarray(((cell >= 0) & (cell < 8 * np.array(grid.table.shape))).all(axis=1))
    cell = np.where(held[:, None], cell, 0)
    brick = grid.table[tuple((cell >> 3).T)]
    word = doubt[np.maximum(brick, 0), cell[:, 0] & 7]
    bit = np.uint64(1) << (8 * (cell[:, 1] & 7) + (cell[:, 2] & 7)).astype(np.uint64)
    return np.asarray(held & (brick >= 0) & ((word & bit) != 0))


def _positions(table: NDArray[np.int32], count: int) -> NDArray[np.int32]:
    """Return where in the table each brick stands."""
    where = np.zeros((count, 3), np.int32)
    held = np.argwhere(table >= 0)
    where[table[tuple(held.T)]] = held
    return where


def _sample_places(
    grid: Grid, parts: Components, chosen: NDArray[np.int32], of_brick: NDArray[np.int32], where: NDArray[np.int32]
) -> Floats:
    places = np.empty((len(chosen), _SAMPLES, 3))
    with threads_for(64 * len(chosen)):
        _spread(len(chosen), parts.parts, chosen, where[of_brick[chosen]], grid.low, grid.step, places)
    return places.reshape(-1, 3)


@rows
def _spread(first, last, parts, chosen, where, low, step, places):
    """Write the middles of cells of each part, evenly by their rank."""
    for row in range(first, last):
        total = 0
        for cell in range(512):
            total += 1 if parts[chosen[row], cell >> 6] >> np.uint64(cell & 63) & np.uint64(1) else 0
        rank = taken = 0
        for cell in range(512):
            if parts[chosen[row], cell >> 6] >> np.uint64(cell & 63) & np.uint64(1):
                while taken < 4 and rank == taken * (total - 1) // 3:
                    places[row, taken, 0] = low[0] + (8 * where[row, 0] + (cell >> 6) + 0.5) * step
                    places[row, taken, 1] = low[1] + (8 * where[row, 1] + ((cell >> 3) & 7) + 0.5) * step
                    places[row, taken, 2] = low[2] + (8 * where[row, 2] + (cell & 7) + 0.5) * step
                    taken += 1
                rank += 1


def _ask_cells(
    grid: Grid, ask: Ask, masks: Words, numbers: Whole, where: Whole, border: Words,
    inside: Words, doubt: Words, most: int,
) -> None:  # fmt: skip
    """Ask every cell of some parts, and write their bits; where there are too many, all are left to the judge."""
    row, cell = _cells_of(masks)
    if len(cell) > most:
        np.bitwise_or.at(border, numbers, masks)  # a brick may have several parts
        np.bitwise_or.at(doubt, numbers, masks)
        return
    offset = np.stack([cell >> 6, (cell >> 3) & 7, cell & 7], axis=1)
    value = ask(grid.low + (8 * where[row] + offset + 0.5) * grid.step)
    _set_cells(numbers[row], cell, value, UNSURE, border, inside, doubt)


@kernel
def _cells_of(masks):
    """Return the row and the cell of every bit."""
    count = 0
    for row in range(len(masks)):
        for cell in range(512):
            count += 1 if masks[row, cell >> 6] >> np.uint64(cell & 63) & np.uint64(1) else 0
    rows_, cells = np.empty(count, np.int64), np.empty(count, np.int64)
    count = 0
    for row in range(len(masks)):
        for cell in range(512):
            if masks[row, cell >> 6] >> np.uint64(cell & 63) & np.uint64(1):
                rows_[count], cells[count] = row, cell
                count += 1
    return rows_, cells


@kernel
def _set_cells(numbers, cells, value, unsure, border, inside, doubt):
    for n in range(len(cells)):
        bit = np.uint64(1) << np.uint64(cells[n] & 63)
        if abs(value[n]) <= unsure:
            border[numbers[n], cells[n] >> 6] |= bit
            doubt[numbers[n], cells[n] >> 6] |= bit
        elif value[n] < 0.0:
            inside[numbers[n], cells[n] >> 6] |= bit


def _ask_bricks(
    grid: Grid, ask: Ask, parts: Components, leaky: Booleans, table: NDArray[np.int32], border: Words, inside: Words,
    doubt: Words, most: int,
) -> tuple[NDArray[np.int32], Words, Words, Words]:  # fmt: skip
    """Colour the bricks that no disk comes near: whole where five places agree, else cell by cell."""
    todo = (parts.of_brick >= 0) & leaky[np.maximum(parts.of_brick, 0)]
    empty = todo.copy()
    for width in _WIDTHS:
        place = np.argwhere(_whole_blocks(todo, width)) * width
        asked = grid.low + SIDE * grid.step * (place[:, None] + width * _SPREAD)
        value = ask(asked.reshape(-1, 3)).reshape(-1, len(_SPREAD))
        for clear, colour in (((value < -UNSURE).all(axis=1), ALL_IN), ((value > UNSURE).all(axis=1), ALL_OUT)):
            settled = _blocks_at(place[clear], width, todo.shape)
            table[settled] = colour
            todo &= ~settled
    mixed = todo
    for axis in range(3):  # two colours must not meet without border between them
        one, two = [slice(None)] * 3, [slice(None)] * 3
        one[axis], two[axis] = slice(1, None), slice(None, -1)
        a, b = table[tuple(one)], table[tuple(two)]
        differ = (a < 0) & (b < 0) & (a != b)
        mixed[tuple(one)] |= differ
        mixed[tuple(two)] |= differ
    where = np.argwhere(mixed & (empty | (table < 0)))
    if not len(where):
        return table, border, inside, doubt
    numbers = np.arange(len(border), len(border) + len(where))
    room = np.zeros((len(where), 8), np.uint64)
    border, inside, doubt = (np.concatenate([words, room]) for words in (border, inside, doubt))
    table[tuple(where.T)] = numbers
    _ask_cells(grid, ask, np.full((len(where), 8), _FULL), numbers, where, border, inside, doubt, most)
    return table, border, inside, doubt


def _whole_blocks(held: Booleans, width: int) -> Booleans:
    """Return which blocks of bricks, so many wide, are held in all of their bricks; those beyond the table are none."""
    counts = [-(-size // width) for size in held.shape]
    room = np.zeros([count * width for count in counts], bool)
    room[tuple(slice(0, size) for size in held.shape)] = held
    blocks = room.reshape(counts[0], width, counts[1], width, counts[2], width)
    return np.asarray(blocks.all(axis=(1, 3, 5)))


def _blocks_at(place: NDArray[np.int64], width: int, shape: tuple[int, ...]) -> Booleans:
    """Return which bricks belong to the blocks that start at some bricks."""
    counts = [-(-size // width) for size in shape]
    blocks = np.zeros(counts, bool)
    blocks[tuple((place // width).T)] = True
    for axis in range(3):
        blocks = np.repeat(blocks, width, axis=axis)
    return blocks[tuple(slice(0, size) for size in shape)]
