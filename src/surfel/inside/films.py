"""Films: the level 1/2 of the winding number over the holes of a cloud, followed from the rims, cell by cell.

Outside the surface the winding number is harmonic, so its level sets end nowhere but at the surface: whoever starts at
every rim finds all of them, and no other place has to be asked.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from surfel._numba import inlined, inner, kernel
from surfel.core.cast import Booleans
from surfel.index.blocks import BLOCK, WIDTH
from surfel.inside.grid import Frame
from surfel.inside.judges.winding import dipole_tree, sum_dipoles
from surfel.inside.operand import Operand
from surfel.inside.rims import Cells, Leak

OPENING = 1.0
"""A node of the tree is one dipole from farther away than so many of its radii: that will do to tell the side."""

FREE = 50_000
"""So many cells, and as many again as there are surfels, are asked at the most."""

_ROOM = 1024  # dipoles that are collected before they are added up
_STACK = 256
_SPARE = 16  # blocks that may come at once


class Film(NamedTuple):
    """Cells of a film, and what was found out beside it.

    Parameters
    ----------
    cells : NDArray[np.int32], shape (m, 3)
        Of two free cells that share a face and lie on different sides of the level, the one nearer to it.
    beside : NDArray[np.int32], shape (k, 3)
        Other free cells that were asked.
    inside : Booleans, shape (k,)
        On which side these are.
    """

    cells: Cells
    beside: Cells
    inside: Booleans


def find_film(frame: Frame, leak: Leak, operand: Operand) -> Film:
    """Follow the level 1/2 of the winding number of a cloud through free cells from the rims on."""
    tree = dipole_tree(operand)
    most = (len(operand) + FREE) // 8
    cells, inside, film = _follow(
        leak.rims, leak.table, leak.free, leak.whole, frame.low - tree.middle, frame.step, tree.scale, tree.surfels,
        tree.nodes, tree.levels, most,
    )  # fmt: skip
    return Film(cells[film], cells[~film], inside[~film])


@kernel
def _follow(rims, table, free, whole, low, step, scale, surfels, nodes, levels, most):
    """Ask blocks of 2 x 2 x 2 cells: those of the rims, then those round every pair of cells that the level parts.

    Returns where the free cells are that were asked, whether they are inside, and whether they belong to the film.
    """
    nx, ny, nz = 4 * table.shape[0], 4 * table.shape[1], 4 * table.shape[2]
    block, value = np.empty(most + _SPARE, np.int64), np.empty((most + _SPARE, 8))
    open_, film = np.zeros(most + _SPARE, np.uint8), np.zeros(most + _SPARE, np.uint8)
    size = 64
    while size < 2 * (most + _SPARE):
        size *= 2
    slots = np.full(size, -1, np.int32)
    batch, terms, stack = np.empty((7, _ROOM + BLOCK)), np.empty(_ROOM + BLOCK), np.empty(_STACK, np.int64)
    beside = np.empty(6, np.int64)
    count = 0
    for r in range(len(rims)):
        if count < most:
            key = ((rims[r, 0] >> 1) * ny + (rims[r, 1] >> 1)) * nz + (rims[r, 2] >> 1)
            count = _add(np.int64(key), block, slots, count)
    done = 0
    while done < count:
        p, q, s = block[done] // (ny * nz), block[done] // nz % ny, block[done] % nz
        open_[done] = _free_cells(p, q, s, table, free, whole)
        if open_[done]:
            _ask(p, q, s, open_[done], low, step, scale, surfels, nodes, levels, value[done], batch, terms, stack)
        for way in range(6):
            far = 2 * (way & 1) - 1
            u, v, w = p + (far if way < 2 else 0), q + (far if 2 <= way < 4 else 0), s + (far if way >= 4 else 0)
            beside[way] = -1
            if min(min(u, v), w) >= 0 and u < nx and v < ny and w < nz:
                there = _slot_of((u * ny + v) * nz + w, block, slots)
                beside[way] = there if there < done else -1
        for cell in range(8):
            if not (open_[done] >> cell) & 1:
                continue
            for way in range(6):
                axis_bit = 4 >> (way >> 1)
                within = ((cell & axis_bit) == 0) == (way & 1 == 1)
                if within and way & 1 == 0:
                    continue  # that pair has been seen from the other side
                there, other = done if within else beside[way], cell ^ axis_bit
                if there < 0 or not (open_[there] >> other) & 1:
                    continue
                a, b = value[done, cell], value[there, other]
                if (a < 0.0) == (b < 0.0):
                    continue
                if abs(a) <= abs(b):
                    film[done] |= np.uint8(1 << cell)
                else:
                    film[there] |= np.uint8(1 << other)
                x, y, z = 2 * p + (cell >> 2), 2 * q + ((cell >> 1) & 1), 2 * s + (cell & 1)
                far = 2 * (way & 1) - 1
                u, v, w = x + (far if way < 2 else 0), y + (far if 2 <= way < 4 else 0), z + (far if way >= 4 else 0)
                for e in range(max(min(x, u) - 1, 0) >> 1, min((max(x, u) + 1) >> 1, nx - 1) + 1):
                    for f in range(max(min(y, v) - 1, 0) >> 1, min((max(y, v) + 1) >> 1, ny - 1) + 1):
                        for g in range(max(min(z, w) - 1, 0) >> 1, min((max(z, w) + 1) >> 1, nz - 1) + 1):
                            if count < most:
                                count = _add((e * ny + f) * nz + g, block, slots, count)
        done += 1
    total = 0
    for d in range(done):
        for cell in range(8):
            total += (open_[d] >> cell) & 1
    cells, inside, in_film = np.empty((total, 3), np.int32), np.empty(total, np.bool_), np.empty(total, np.bool_)
    total = 0
    for d in range(done):
        for cell in range(8):
            if (open_[d] >> cell) & 1:
                cells[total, 0] = 2 * (block[d] // (ny * nz)) + (cell >> 2)
                cells[total, 1] = 2 * (block[d] // nz % ny) + ((cell >> 1) & 1)
                cells[total, 2] = 2 * (block[d] % nz) + (cell & 1)
                inside[total] = value[d, cell] < 0.0
                in_film[total] = (film[d] >> cell) & 1
                total += 1
    return cells, inside, in_film


@inlined
def _place_of(key, slots):
    """Return where the search for a key starts."""
    return np.int64((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(32)) & (len(slots) - 1)


@inner
def _slot_of(key, block, slots):
    """Return the number of a block, or -1 if it is not known."""
    place = _place_of(key, slots)
    while slots[place] >= 0 and block[slots[place]] != key:
        place = (place + 1) & (len(slots) - 1)
    return np.int64(slots[place])


@inner
def _add(key, block, slots, count):
    """Put a block in the queue unless it is there; return how many are."""
    place = _place_of(key, slots)
    while slots[place] >= 0:
        if block[slots[place]] == key:
            return count
        place = (place + 1) & (len(slots) - 1)
    slots[place] = count
    block[count] = key
    return count + 1


@inner
def _free_cells(p, q, s, table, free, whole):
    """Return which of the eight cells of a block are free, as bits."""
    brick = table[p >> 2, q >> 2, s >> 2]
    if brick < 0:
        return np.uint8(255) if whole[p >> 2, q >> 2, s >> 2] else np.uint8(0)
    layer, corner = 2 * (p & 3), np.uint64(16 * (q & 3) + 2 * (s & 3))
    bits = np.int64(0)
    for x in range(2):
        word = free[brick, layer + x] >> corner
        two, next_two = np.int64(word & np.uint64(3)), np.int64((word >> np.uint64(8)) & np.uint64(3))
        # bit z + 2 y of each layer, the lowest z first
        bits |= (two | next_two << 2) << (4 * x)
    return np.uint8(bits)


@inner
def _ask(p, q, s, open_, low, step, scale, surfels, nodes, levels, value, batch, terms, stack):
    """Write 1/2 less the winding number at the middles of the free cells of a block."""
    side = step * scale
    mx, my, mz = low[0] * scale, low[1] * scale, low[2] * scale
    mx, my, mz = mx + (2 * p + 1) * side, my + (2 * q + 1) * side, mz + (2 * s + 1) * side
    radius = 0.5 * math.sqrt(3.0) * side
    value[:] = 0.5
    held = 0
    stack[0], height = ((len(levels) - 2) << 40), 1  # the level, then the place in it
    while height > 0:
        height -= 1
        level, place = stack[height] >> 40, stack[height] & 0xFFFFFFFFFF
        node = levels[level] + place
        dx, dy, dz = nodes[0, node] - mx, nodes[1, node] - my, nodes[2, node] - mz
        gap = max(math.sqrt(dx * dx + dy * dy + dz * dz) - radius, 0.0)
        if gap * gap > OPENING * OPENING * nodes[6, node]:
            for x in range(6):
                batch[x, held] = nodes[x, node]
            batch[6, held] = 0.0
            held += 1
        elif level == 0:
            for i in range(place * BLOCK, min(surfels.shape[1], (place + 1) * BLOCK)):
                for x in range(7):
                    batch[x, held] = surfels[x, i]
                held += 1
        else:
            for c in range(place * WIDTH, min(levels[level] - levels[level - 1], (place + 1) * WIDTH)):
                stack[height] = ((level - 1) << 40) | c
                height += 1
        if held >= _ROOM or height == 0:
            for cell in range(8):
                if (open_ >> cell) & 1:
                    x = mx + ((cell >> 2) - 0.5) * side
                    y = my + (((cell >> 1) & 1) - 0.5) * side
                    z = mz + ((cell & 1) - 0.5) * side
                    value[cell] -= sum_dipoles(batch, held, x, y, z, terms)
            held = 0
