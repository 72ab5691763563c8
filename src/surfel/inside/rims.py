"""Rims: where space before the surfels runs into space behind them, close to the surface, so that a hole must be."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel
from surfel.core.cast import Booleans
from surfel.inside.grid import bit_of
from surfel.inside.space import Space, set_bits, with_numbers

REACH = 4
"""So many cells far does it spread what surfels see; the path round the rim of a hole is shorter than twice that."""

Cells = NDArray[np.int32]
_FULL = np.uint64(0xFFFFFFFFFFFFFFFF)


class Leak(NamedTuple):
    """The free cells of leaky components, and those of them at rims.

    Parameters
    ----------
    table : NDArray[np.int32], shape (x, y, z)
        The number of each brick that has words here.
    free : NDArray[np.uint64], shape (bricks, 8)
        Bits of the free cells.
    whole : Booleans, shape (x, y, z)
        Whether a brick without words is free.
    rims : NDArray[np.int32], shape (m, 3)
        Cells close to what is seen before some surfels and behind others.
    """

    table: NDArray[np.int32]
    free: NDArray[np.uint64]
    whole: Booleans
    rims: Cells


def find_rims(space: Space, leaky: Booleans, before: Cells, behind: Cells, *, wide: bool) -> Leak:
    """Spread what surfels see before and behind them by :data:`REACH` cells; where both come together there is a rim.

    Parameters
    ----------
    space : Space
        With the components.
    leaky : Booleans, shape (components,)
        In which of them to look.
    before, behind : NDArray[np.int32], shape (m, 3)
        Free cells of these that surfels see.
    wide : bool
        Return all of the ways from the ones to the others, not only where they meet.
    """
    parts = space.parts
    table, added = with_numbers(space.bricks.table, np.concatenate([before, behind]))
    free = np.zeros((len(space.bricks.border) + added, 8), np.uint64)
    of_brick = np.repeat(np.arange(len(parts.start) - 1), np.diff(parts.start))
    chosen = leaky[parts.of_part]
    np.bitwise_or.at(free, of_brick[chosen], parts.parts[chosen])
    whole = (parts.of_brick >= 0) & leaky[np.maximum(parts.of_brick, 0)]
    free[table[whole & (table >= 0)]] = _FULL
    seen = []
    for cells in (before, behind):
        words = np.zeros_like(free)
        set_bits(cells, table, words)
        seen.append(_spread(table, free, words & free))
    rims = seen[0] & seen[1]
    if wide:
        rims = _spread(table, seen[0] | seen[1], rims)
    return Leak(table, free, whole, _cells_of(table, rims))


def _spread(table: NDArray[np.int32], free: NDArray[np.uint64], words: NDArray[np.uint64]) -> NDArray[np.uint64]:
    for _ in range(REACH):
        words = grown(table, free, words)
    return words


@kernel
def grown(table, free, words):
    """Return the cells with those free ones that touch them by a face."""
    nx, ny, nz = table.shape
    one, seven, eight, high = np.uint64(1), np.uint64(7), np.uint64(8), np.uint64(56)
    first, last = np.uint64(0x0101010101010101), np.uint64(0x8080808080808080)
    grown = np.empty_like(words)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                brick = table[i, j, k]
                if brick < 0:
                    continue
                under = table[i - 1, j, k] if i > 0 else -1
                over = table[i + 1, j, k] if i + 1 < nx else -1
                left = table[i, j - 1, k] if j > 0 else -1
                right = table[i, j + 1, k] if j + 1 < ny else -1
                back = table[i, j, k - 1] if k > 0 else -1
                front = table[i, j, k + 1] if k + 1 < nz else -1
                for x in range(8):
                    here = words[brick, x]
                    near = here | (here << eight) | (here >> eight) | ((here & ~last) << one) | ((here & ~first) >> one)
                    if x > 0:
                        near |= words[brick, x - 1]
                    elif under >= 0:
                        near |= words[under, 7]
                    if x < 7:
                        near |= words[brick, x + 1]
                    elif over >= 0:
                        near |= words[over, 0]
                    if left >= 0:
                        near |= words[left, x] >> high
                    if right >= 0:
                        near |= words[right, x] << high
                    if back >= 0:
                        near |= (words[back, x] & last) >> seven
                    if front >= 0:
                        near |= (words[front, x] & first) << seven
                    grown[brick, x] = near & free[brick, x]
    return grown


@kernel
def _cells_of(table, words):
    """Return where the set bits are, (m, 3)."""
    count = 0
    for brick in range(len(words)):
        for cell in range(512):
            count += 1 if words[brick, cell >> 6] >> np.uint64(cell & 63) & np.uint64(1) else 0
    cells = np.empty((count, 3), np.int32)
    count = 0
    for i in range(table.shape[0]):
        for j in range(table.shape[1]):
            for k in range(table.shape[2]):
                brick = table[i, j, k]
                for cell in range(512 if brick >= 0 else 0):
                    if words[brick, cell >> 6] & bit_of((cell >> 3) & 7, cell & 7):
                        cells[count, 0], cells[count, 1] = 8 * i + (cell >> 6), 8 * j + ((cell >> 3) & 7)
                        cells[count, 2] = 8 * k + (cell & 7)
                        count += 1
    return cells
