"""Widened border: a bit for each cell tells whether border lies within two cells of it: a small ball is one look."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, rows, threads_for
from surfel.inside.grid import Grid

REACH = 2
"""So many cells, in any direction, is the border widened."""

_NONE = np.uint64(0)


def widened(grid: Grid) -> NDArray[np.uint64]:
    """Return the bits, shape (bricks, 8), of the cells with border within :data:`REACH` cells, themselves included.

    A ball whose radius is no more than that, round a place in a cell without the bit, meets no border: all cells of the
    box round it have the cell's colour. Only bricks with words have widened ones; what reaches into others is left out.
    """
    words = np.zeros_like(grid.border)
    place = np.stack(np.nonzero(grid.table >= 0), axis=1)
    with threads_for(256 * len(place)):
        _widen(len(place), place, grid.table, grid.border, words)
    return words


@rows
def _widen(first, last, place, table, border, words):
    nx, ny, nz = table.shape
    bricks = np.empty((3, 3, 3), np.int64)
    layers = np.empty(8 + 2 * REACH, np.uint64)
    across = np.empty(3, np.uint64)
    for n in range(first, last):
        i, j, k = place[n, 0], place[n, 1], place[n, 2]
        for u in range(3):
            for v in range(3):
                for w in range(3):
                    p, q, s = i + u - 1, j + v - 1, k + w - 1
                    there = 0 <= p < nx and 0 <= q < ny and 0 <= s < nz
                    bricks[u, v, w] = table[p, q, s] if there else -1
        for step in range(8 + 2 * REACH):
            x = step - REACH
            u, layer = (x >> 3) + 1, x & 7
            for v in range(3):
                before = border[bricks[u, v, 0], layer] if bricks[u, v, 0] >= 0 else _NONE
                here = border[bricks[u, v, 1], layer] if bricks[u, v, 1] >= 0 else _NONE
                after = border[bricks[u, v, 2], layer] if bricks[u, v, 2] >= 0 else _NONE
                across[v] = _along_z(before, here, after)
            layers[step] = _along_y(across[0], across[1], across[2])
        for layer in range(8):
            word = layers[layer]
            for step in range(1, 2 * REACH + 1):
                word |= layers[layer + step]
            words[bricks[1, 1, 1], layer] = word


@inlined
def _along_z(before, here, after):
    """Widen a word by two bits within its bytes; the bytes of its neighbours spill over."""
    word = here
    word |= ((here << np.uint64(1)) & np.uint64(0xFEFEFEFEFEFEFEFE)) | (
        (here << np.uint64(2)) & np.uint64(0xFCFCFCFCFCFCFCFC)
    )
    word |= ((here >> np.uint64(1)) & np.uint64(0x7F7F7F7F7F7F7F7F)) | (
        (here >> np.uint64(2)) & np.uint64(0x3F3F3F3F3F3F3F3F)
    )
    word |= ((before >> np.uint64(7)) & np.uint64(0x0101010101010101)) | (
        (before >> np.uint64(6)) & np.uint64(0x0303030303030303)
    )
    word |= ((after << np.uint64(7)) & np.uint64(0x8080808080808080)) | (
        (after << np.uint64(6)) & np.uint64(0xC0C0C0C0C0C0C0C0)
    )
    return word


@inlined
def _along_y(before, here, after):
    """Widen a word by two bytes; those of its neighbours spill over."""
    word = here | (here << np.uint64(8)) | (here << np.uint64(16)) | (here >> np.uint64(8)) | (here >> np.uint64(16))
    return (
        word
        | (before >> np.uint64(56))
        | (before >> np.uint64(48))
        | (after << np.uint64(56))
        | (after << np.uint64(48))
    )
