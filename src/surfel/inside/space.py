"""Space: the border of a cloud, the components of what is free, and the cells that hold surfels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel
from surfel.core.cast import Floats
from surfel.inside.border import Bricks, disk_radii, mark_border
from surfel.inside.components import Components, connect
from surfel.inside.grid import Frame, bit_of, frame_for
from surfel.inside.operand import Operand
from surfel.inside.owners import Owners, own_cells


class Space(NamedTuple):
    """The space round a cloud, before it has colours."""

    frame: Frame
    bricks: Bricks
    parts: Components
    owners: Owners
    radii: Floats


def space_round(operand: Operand) -> Space:
    """Mark the border of a cloud of at least one surfel, and connect what is free."""
    frame = frame_for(operand.bounds, operand.spacings)
    radii = border_radii(operand, frame.step)
    bricks = mark_border(frame, operand.points, operand.normals, radii)
    parts = connect(bricks.table, bricks.border)
    return Space(frame, bricks, parts, own_cells(frame, bricks, operand.points, operand.normals), radii)


def border_radii(operand: Operand, step: float) -> Floats:
    """Return the radii of the disks that make the border; strays have none beyond their own cells."""
    radii = disk_radii(operand.spacings, operand.areas, step)
    radii[operand.strays] = 0.0
    return radii


def with_border(space: Space, cells: NDArray[np.int32]) -> Space:
    """Return the space with some free cells, shape (m, 3), as border, connected anew; it may have more bricks."""
    table, added = with_numbers(space.bricks.table, cells)
    room = np.zeros((added, 8), np.uint64)
    border, owned = (np.concatenate([words, room]) for words in (space.bricks.border, space.bricks.owned))
    set_bits(cells, table, border)
    base = np.concatenate([space.owners.base, np.zeros((added, 8), np.int32)])
    owners = space.owners._replace(base=base, owned=owned)
    return Space(space.frame, Bricks(table, border, owned), connect(table, border), owners, space.radii)


def with_numbers(table: NDArray[np.int32], cells: NDArray[np.int32]) -> tuple[NDArray[np.int32], int]:
    """Return the table with numbers for the bricks of some cells that had none, and how many these are."""
    numbered = table.copy()
    return numbered, int(_number(numbered, cells, int(table.max(initial=-1)) + 1))


@kernel
def _number(table, cells, first):
    """Give numbers to the bricks of cells that have none, from ``first`` on; return how many these are."""
    count = first
    for n in range(len(cells)):
        i, j, k = cells[n, 0] >> 3, cells[n, 1] >> 3, cells[n, 2] >> 3
        if table[i, j, k] < 0:
            table[i, j, k] = count
            count += 1
    return count - first


@kernel
def set_bits(cells, table, words):
    """Set the bits of cells in the words of their bricks."""
    for n in range(len(cells)):
        i, j, k = cells[n, 0], cells[n, 1], cells[n, 2]
        words[table[i >> 3, j >> 3, k >> 3], i & 7] |= bit_of(j & 7, k & 7)


@kernel
def bits_at(cells, table, words):
    """Tell which cells have their bits set; those of bricks without words, or beyond the table, have none."""
    found = np.zeros(len(cells), np.bool_)
    for n in range(len(cells)):
        i, j, k = cells[n, 0], cells[n, 1], cells[n, 2]
        if min(min(i, j), k) < 0:
            continue
        p, q, s = i >> 3, j >> 3, k >> 3
        if p < table.shape[0] and q < table.shape[1] and s < table.shape[2] and table[p, q, s] >= 0:
            found[n] = words[table[p, q, s], i & 7] & bit_of(j & 7, k & 7) != np.uint64(0)
    return found


@kernel
def component_of(cells, table, start, parts, of_part, of_brick):
    """Return the component of each cell of the table, -1 for border."""
    found = np.full(len(cells), -1, np.int32)
    for n in range(len(cells)):
        i, j, k = cells[n, 0], cells[n, 1], cells[n, 2]
        brick = table[i >> 3, j >> 3, k >> 3]
        if brick < 0:
            found[n] = of_brick[i >> 3, j >> 3, k >> 3]
            continue
        bit = bit_of(j & 7, k & 7)
        for part in range(start[brick], start[brick + 1]):
            if parts[part, i & 7] & bit:
                found[n] = of_part[part]
    return found
