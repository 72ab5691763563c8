"""Settling: places are told apart by their cells, and beside the surface by slabs; what is left is for a judge."""

from __future__ import annotations

import numpy as np

from surfel._numba import inlined, inner
from surfel.inside.grid import IN, OUT
from surfel.inside.looks import BORDERS, DOUBT, FIRST, INSIDE, OWNED
from surfel.inside.owners import bit_count
from surfel.inside.slabs import SAFE, guard

UNDECIDED = -1
"""The kind of places that only a judge can tell."""

_ENOUGH = 3  # slabs that have to agree about a cell that holds no surfel
_ONE, _NONE = np.uint64(1), np.uint64(0)
_U3, _U7, _U8 = np.uint64(3), np.uint64(7), np.uint64(8)


@inlined
def moved_to(motion, x, y, z):
    """Return a place under a motion: three rows of four numbers."""
    return (
        motion[0, 0] * x + motion[0, 1] * y + motion[0, 2] * z + motion[0, 3],
        motion[1, 0] * x + motion[1, 1] * y + motion[1, 2] * z + motion[1, 3],
        motion[2, 0] * x + motion[2, 1] * y + motion[2, 2] * z + motion[2, 3],
    )


# Several threads may write to one byte of ``safe``. They all write the same value, so the order does not matter.


@inner
def settle(todo, many, points, motion, cells, table, words, slabs, safe, kind, near, left, where):
    """Write the kind of the first ``many`` places of ``todo``, and which are near: by their cells, or by slabs.

    What is outside and far is not written. The cells are looked up without the branches that nobody could predict, and
    those of the border are kept in ``left`` and ``where``, scratch as long as ``todo``. A border cell that holds no
    surfel has no slab: there the slabs of all cells round it have to agree.
    """
    nx, ny, nz = 8.0 * table.shape[0], 8.0 * table.shape[1], 8.0 * table.shape[2]
    m00, m01, m02, m03 = cells[0, 0], cells[0, 1], cells[0, 2], cells[0, 3]
    m10, m11, m12, m13 = cells[1, 0], cells[1, 1], cells[1, 2], cells[1, 3]
    m20, m21, m22, m23 = cells[2, 0], cells[2, 1], cells[2, 2], cells[2, 3]
    count = np.uint64(0)
    for m in range(many):
        i = np.uint64(todo[m])
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        a = m00 * x + m01 * y + m02 * z + m03
        b = m10 * x + m11 * y + m12 * z + m13
        c = m20 * x + m21 * y + m22 * z + m23
        if not (a >= 0.0 and b >= 0.0 and c >= 0.0 and a < nx and b < ny and c < nz):
            continue
        u, v, w = np.uint64(np.int64(a)), np.uint64(np.int64(b)), np.uint64(np.int64(c))
        brick = table[u >> _U3, v >> _U3, w >> _U3]
        if brick < 0:
            kind[i] = -1 - brick
            continue
        row, place = _U8 * np.uint64(brick) + (u & _U7), _U8 * (v & _U7) + (w & _U7)
        within = (words[row, BORDERS] >> place) & _ONE
        kind[i] = np.int64((words[row, INSIDE] >> place) & _ONE)
        near[i] = within
        left[count], where[0, count], where[1, count], where[2, count] = i, u, v, w
        count += within
    for m in range(count):
        i = left[m]
        u, v, w = np.int64(where[0, m]), np.int64(where[1, m]), np.int64(where[2, m])
        row = np.uint64(8 * np.int64(table[u >> 3, v >> 3, w >> 3]) + (u & 7))
        bit = _ONE << np.uint64(8 * (v & 7) + (w & 7))
        colour = UNDECIDED
        if len(slabs) > 0:
            x, y, z = moved_to(motion, points[i, 0], points[i, 1], points[i, 2])
            word = words[row, OWNED]
            if word & bit:
                cell = np.uint64(words[row, FIRST] + np.uint64(bit_count(word & (bit - _ONE))))
                if safe[cell] == 0:
                    safe[cell] = guard(u, v, w, np.int64(cell), table, words, slabs)
                along = slabs[cell, 0] * x + slabs[cell, 1] * y + slabs[cell, 2] * z
                if along < slabs[cell, 3] and safe[cell] == SAFE:
                    colour = IN
                elif along > slabs[cell, 4] and safe[cell] == SAFE:
                    colour = OUT
            elif words[row, DOUBT] & bit == _NONE:
                below = above = 0
                for square in range(9):
                    if below > 0 and above > 0:
                        break  # nothing can be said
                    e, f = u - 1 + square // 3, v - 1 + square % 3
                    start = np.uint64(8 * (f & 7))
                    for k in range((w - 1) >> 3, ((w + 1) >> 3) + 1):
                        other = table[e >> 3, f >> 3, k]
                        if other < 0:
                            continue
                        row = np.uint64(8 * np.int64(other) + (e & 7))
                        word = words[row, OWNED]
                        held = (word >> start) & np.uint64(0xFF)
                        for g in range(max(w - 1, 8 * k), min(w + 1, 8 * k + 7) + 1):
                            if (held >> np.uint64(g & 7)) & _ONE == _NONE:
                                continue
                            there = _ONE << (start + np.uint64(g & 7))
                            cell = np.uint64(words[row, FIRST] + np.uint64(bit_count(word & (there - _ONE))))
                            if safe[cell] == 0:
                                safe[cell] = guard(e, f, g, np.int64(cell), table, words, slabs)
                            along = slabs[cell, 0] * x + slabs[cell, 1] * y + slabs[cell, 2] * z
                            if safe[cell] != SAFE or (along >= slabs[cell, 3] and along <= slabs[cell, 4]):
                                below, above = 1, 1
                                break
                            below += 1 if along < slabs[cell, 3] else 0
                            above += 1 if along > slabs[cell, 4] else 0
                if above == 0 and below >= _ENOUGH:
                    colour = IN
                elif below == 0 and above >= _ENOUGH:
                    colour = OUT
        kind[i] = colour
