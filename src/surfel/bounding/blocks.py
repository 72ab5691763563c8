"""Blocks of points: domain coordinates, weights and values for some hundred points at a time, by whole vectors.

A block is one flat array of ``ROWS * BLOCK`` numbers, so that the compiler sees that its rows do not overlap: weights
of u (0 to 3) and of v (4 to 7), height (8), local coordinates (9, 10), cells (11, 12), value (13), and behind them room
for what is computed on the way. The formulas are those of ``frame.project`` and ``evaluate.value_in``, rounded alike:
the numbers are the same to the last bit.

All arrays come flat: to flatten one anew for each block would take longer than the work.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import inlined
from surfel.bounding.lanes import BLOCK, cell_columns, columns_of, join_columns

HALVED = 100_000
"""Points from which on the two halves of a pass may run side by side."""

ROWS = 18
HEIGHT, LOCAL_U, LOCAL_V, CELL_U, CELL_V, VALUE, ROOM = 8, 9, 10, 11, 12, 13, 14


@inlined
def place_block(p, first, count, f, sign, w):
    """Fill the coordinates (rows 8 to 12) for ``count`` points from number ``first`` on, all in the domain."""
    f0, f1, f2, f3, f4, f5, f6, f7, f8 = f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8]
    low_u, low_v, scale_u, scale_v = f[9], f[10], f[11], f[12]
    last_u, last_v = f[13] - 1.0, f[14] - 1.0
    whole = count - count % 8
    for i in range(0, whole, 8):
        columns_of(p, 3 * (first + i), w, i)
    for i in range(whole, count):
        at = 3 * (first + i)
        w[i], w[BLOCK + i], w[2 * BLOCK + i] = p[at], p[at + 1], p[at + 2]
    for i in range(count):
        x, y, z = w[i], w[BLOCK + i], w[2 * BLOCK + i]
        u = ((f0 * x + f1 * y + f2 * z) - low_u) * scale_u
        v = ((f3 * x + f4 * y + f5 * z) - low_v) * scale_v
        h, k = np.floor(u), np.floor(v)
        h = h if h < last_u else last_u
        k = k if k < last_v else last_v
        w[HEIGHT * BLOCK + i] = sign * (f6 * x + f7 * y + f8 * z)
        w[LOCAL_U * BLOCK + i] = u - h
        w[LOCAL_V * BLOCK + i] = v - k
        w[CELL_U * BLOCK + i] = h
        w[CELL_V * BLOCK + i] = k


@inlined
def weigh_block(count, w):
    """Fill the weights (rows 0 to 7) from the local coordinates."""
    for i in range(count):
        s = w[LOCAL_U * BLOCK + i]
        q = 1.0 - s
        w[i] = q * q * q
        w[BLOCK + i] = 4.0 + s * s * (3.0 * s - 6.0)
        w[2 * BLOCK + i] = 4.0 + q * q * (3.0 * q - 6.0)
        w[3 * BLOCK + i] = s * s * s
        t = w[LOCAL_V * BLOCK + i]
        q = 1.0 - t
        w[4 * BLOCK + i] = q * q * q
        w[5 * BLOCK + i] = 4.0 + t * t * (3.0 * t - 6.0)
        w[6 * BLOCK + i] = 4.0 + q * q * (3.0 * q - 6.0)
        w[7 * BLOCK + i] = t * t * t


@inlined
def number_block(count, width, split, w, place):
    """Write where the cell of each point begins among coefficients in rows of ``width``, its cell and its micro-cell.

    They are rows 0 to 2 of the flat ``place``, which holds integers of 32 bits. Cells are counted in rows of
    ``width - 3``, micro-cells in rows of ``split`` times as many.
    """
    wide, across, cells = float(width), float(width - 3), float(split)
    last = cells - 1.0
    for i in range(count):
        h, k = w[CELL_U * BLOCK + i], w[CELL_V * BLOCK + i]
        a, b = np.floor(w[LOCAL_U * BLOCK + i] * cells), np.floor(w[LOCAL_V * BLOCK + i] * cells)
        a = a if a < last else last
        b = b if b < last else last
        place[i] = np.int32(h * wide + k)
        place[BLOCK + i] = np.int32(h * across + k)
        place[2 * BLOCK + i] = np.int32((h * cells + a) * (across * cells) + (k * cells + b))


@inlined
def evaluate_block(count, b, width, place, w):
    """Fill the values (row 13) from the weights; ``b`` holds the coefficients in rows of ``width``, flat."""
    for i in range(count):
        cell_columns(b, np.int64(place[i]), width, w, i)
    for i in range(0, count, 8):
        join_columns(w, i)
