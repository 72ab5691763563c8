"""Blocks of points: domain coordinates, weights and values for some hundred points at a time, by whole vectors.

A block is one flat array of ``ROWS * BLOCK`` numbers, so that the compiler sees that its rows do not overlap: weights
of u (0 to 3) and of v (4 to 7), height (8), local coordinates (9, 10), cells (11, 12), value (13). The formulas are
those of ``frame.project`` and ``evaluate.value_in``, rounded alike: the numbers are the same to the last bit.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import inner
from surfel.bounding.lanes import BLOCK, cell_columns

ROWS = 14
HEIGHT, LOCAL_U, LOCAL_V, CELL_U, CELL_V, VALUE = 8, 9, 10, 11, 12, 13


@inner
def place_block(p, f, sign, w):
    """Fill the coordinates (rows 8 to 12) for at most BLOCK points; each must lie in the domain."""
    f0, f1, f2, f3, f4, f5, f6, f7, f8 = f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8]
    low_u, low_v, scale_u, scale_v = f[9], f[10], f[11], f[12]
    last_u, last_v = f[13] - 1.0, f[14] - 1.0
    for i in range(p.shape[0]):
        x, y, z = p[i, 0], p[i, 1], p[i, 2]
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


@inner
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


@inner
def evaluate_block(count, b, w, columns):
    """Fill the values (row 13) from the weights; ``columns`` has room for 4 BLOCK numbers."""
    width = b.shape[1]
    flat = b.ravel()
    for i in range(count):
        place = np.int64(w[CELL_U * BLOCK + i]) * width + np.int64(w[CELL_V * BLOCK + i])
        cell_columns(flat, place, width, w, i, columns)
    for i in range(count):
        near = columns[4 * i] * w[4 * BLOCK + i] + columns[4 * i + 1] * w[5 * BLOCK + i]
        far = columns[4 * i + 2] * w[6 * BLOCK + i] + columns[4 * i + 3] * w[7 * BLOCK + i]
        w[VALUE * BLOCK + i] = (near + far) / 36.0
