"""Looks: what sifting asks about space, laid out so that one look at memory tells it.

A layer of a brick has one row of words: its border, its inside, its owners, and its border widened by two and by four
cells. Bricks into which the border reaches when it is widened have rows, too. So most small balls are one look: where
the border lies farther from the cell of the centre than the ball is large, all of the ball has the cell's colour.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, kernel, rows, threads_for
from surfel.core.cast import Floats
from surfel.inside.grid import ALL_IN, Grid
from surfel.inside.owners import Owners

BORDERS, INSIDE, OWNED, FIRST, DOUBT, NEAR, WIDER = range(7)
"""Columns of the words: border, inside, cells that hold surfels, the number of the first of these, border cells that no
slab may settle, and the cells with border within :data:`NEAR_REACH` and :data:`REACH` cells, themselves included."""

NEAR_REACH, REACH = 2, 4

_LAYERS = 8 + 2 * REACH
_COLUMNS = 8  # a row is as long as what the processor fetches
_ONE, _NONE, _FULL = np.uint64(1), np.uint64(0), np.uint64(0xFFFFFFFFFFFFFFFF)
_BYTES, _LOWER = np.uint64(0x0101010101010101), np.uint64(0x0F0F0F0F0F0F0F0F)


class Looks(NamedTuple):
    """Coloured space, as sifting reads it.

    Parameters
    ----------
    low : Floats, shape (3,)
        The lowest corner, in the operand's coordinates.
    step : float
        Side of a cell.
    table : NDArray[np.int32], shape (x, y, z)
        The number of each brick, or a colour as in :class:`surfel.inside.grid.Grid` where no border is within reach.
    words : NDArray[np.uint64], shape (8 * bricks, 8)
        A row for each layer of each brick; the last column is spare.
    gap : NDArray[np.uint8], shape (x, y, z)
        That of the grid.
    """

    low: Floats
    step: float
    table: NDArray[np.int32]
    words: NDArray[np.uint64]
    gap: NDArray[np.uint8]

    @classmethod
    def of(cls, grid: Grid, owners: Owners, doubt: NDArray[np.uint64] | None) -> Looks:
        """Lay out the space of a grid; bricks that owners know nothing of are all doubt."""
        table = np.empty_like(grid.table)
        place = np.full((len(grid.border) + grid.table.size, 3), -1, np.int32)
        count = int(_number(grid.table, grid.border, table, place))
        words = np.zeros((8 * count, _COLUMNS), np.uint64)
        doubted = np.empty((0, 8), np.uint64) if doubt is None else doubt
        with threads_for(512 * count):
            _lay_out(count, place, grid.table, grid.border, grid.inside, owners.owned, owners.base, doubted, words)
        return cls(grid.low, grid.step, table, words, grid.gap)


@kernel
def _number(table, border, numbered, place):
    """Copy the table, and give numbers to bricks into which border reaches; return how many numbers there are.

    Border reaches into a brick if it lies in the halves of another that are turned towards it. Numbers that no brick
    has any more, after edits, have no place.
    """
    nx, ny, nz = table.shape
    count = known = len(border)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                brick = table[i, j, k]
                numbered[i, j, k] = brick
                if brick >= 0:
                    place[brick, 0], place[brick, 1], place[brick, 2] = i, j, k
    for brick in range(known):
        if place[brick, 0] < 0:
            continue
        halves = np.int64(0)  # bit 4 x + 2 y + z for the eight parts of a brick
        for x in range(2):
            word = _NONE
            for layer in range(4 * x, 4 * x + 4):
                word |= border[brick, layer]
            for y in range(2):
                rows_ = word >> np.uint64(32 * y) & np.uint64(0xFFFFFFFF)
                halves |= (1 if rows_ & _LOWER else 0) << (4 * x + 2 * y)
                halves |= (1 if rows_ & ~_LOWER else 0) << (4 * x + 2 * y + 1)
        for side in range(27):
            u, v, w = side // 9 - 1, side // 3 % 3 - 1, side % 3 - 1
            i, j, k = place[brick, 0] + u, place[brick, 1] + v, place[brick, 2] + w
            if not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz) or numbered[i, j, k] >= 0:
                continue
            turned = 0xFF if u == 0 else (0xF0 if u > 0 else 0x0F)
            turned &= 0xFF if v == 0 else (0xCC if v > 0 else 0x33)
            turned &= 0xFF if w == 0 else (0xAA if w > 0 else 0x55)
            if halves & turned:
                numbered[i, j, k] = count
                place[count, 0], place[count, 1], place[count, 2] = i, j, k
                count += 1
    return count


@rows
def _lay_out(first, last, place, table, border, inside, owned, base, doubt, words):
    before, here, after = (
        np.empty((3, _LAYERS), np.uint64),
        np.empty((3, _LAYERS), np.uint64),
        np.empty((3, _LAYERS), np.uint64),
    )
    near, wider = np.empty((3, _LAYERS), np.uint64), np.empty((3, _LAYERS), np.uint64)
    for n in range(first, last):
        i, j, k = place[n, 0], place[n, 1], place[n, 2]
        if i < 0:
            continue
        for v in range(3):
            _gather(table, border, i, j + v - 1, k - 1, before[v])
            _gather(table, border, i, j + v - 1, k, here[v])
            _gather(table, border, i, j + v - 1, k + 1, after[v])
        for v in range(3):
            for x in range(_LAYERS):
                p, q, s = before[v, x], here[v, x], after[v, x]
                near[v, x] = q | _shifted_along_z(p, q, s, 1) | _shifted_along_z(p, q, s, 2)
                wider[v, x] = near[v, x] | _shifted_along_z(p, q, s, 3) | _shifted_along_z(p, q, s, 4)
        for x in range(_LAYERS):
            near[1, x] = _along_y(near[0, x], near[1, x], near[2, x], 2)
            wider[1, x] = _along_y(wider[0, x], wider[1, x], wider[2, x], 4)
        for layer in range(8):
            row = 8 * n + layer
            in_two = in_four = _NONE
            for step in range(layer, layer + 2 * REACH + 1):
                in_four |= wider[1, step]
            for step in range(layer + REACH - NEAR_REACH, layer + REACH + NEAR_REACH + 1):
                in_two |= near[1, step]
            words[row, NEAR], words[row, WIDER] = in_two, in_four
            if n >= len(border):
                words[row, INSIDE] = _FULL if table[i, j, k] == ALL_IN else _NONE
                continue
            words[row, BORDERS], words[row, INSIDE] = border[n, layer], inside[n, layer]
            if n >= len(base):
                words[row, DOUBT] = _FULL
                continue
            words[row, OWNED], words[row, FIRST] = owned[n, layer], np.uint64(base[n, layer])
            words[row, DOUBT] = doubt[n, layer] if n < len(doubt) else _NONE


@inner
def _gather(table, border, i, j, k, layers):
    """Write the border of a brick with four layers of those before and behind it; there is none beyond the table."""
    layers[:] = _NONE
    if 0 <= j < table.shape[1] and 0 <= k < table.shape[2]:
        for u in range(max(i - 1, 0), min(i + 2, table.shape[0])):
            brick = table[u, j, k]
            if brick >= 0:
                for x in range(max(8 * u, 8 * i - REACH), min(8 * u + 8, 8 * i + 8 + REACH)):
                    layers[x - 8 * i + REACH] = border[brick, x & 7]


@inlined
def _along_y(before, here, after, reach):
    """Widen a word by some bytes; those of its neighbours spill over."""
    word = here
    for shift in range(1, reach + 1):
        up, down = np.uint64(8 * shift), np.uint64(64 - 8 * shift)
        word |= (here << up) | (here >> up) | (before >> down) | (after << down)
    return word


@inlined
def _shifted_along_z(before, here, after, shift):
    """Shift a word up and down within its bytes; the bytes of its neighbours spill over."""
    by, back = np.uint64(shift), np.uint64(8 - shift)
    upper = ((_FULL << by) & np.uint64(0xFF)) * _BYTES  # the bits of each byte from the shift on
    lower = (np.uint64(0xFF) >> by) * _BYTES
    return ((here << by) & upper) | ((here >> by) & lower) | ((before >> back) & ~upper) | ((after << back) & ~lower)
