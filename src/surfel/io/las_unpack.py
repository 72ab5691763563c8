"""Coordinates out of point records: whole numbers of 32 bits times a scale, plus an offset."""

from __future__ import annotations

import numpy as np

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats
from surfel.io.las_header import LasHeader
from surfel.io.source import Bytes

_BLOCK = 4096


def coordinates(data: Bytes, header: LasHeader, points: Floats) -> tuple[Floats, Floats]:
    """Write stored * scale + offset into ``points``; return the lowest and the highest corner.

    Parameters
    ----------
    data : ndarray of uint8
        Records that begin with X, Y and Z in 32 bits.
    header : LasHeader
        Tells the length of a record, scale and offset.
    points : ndarray of float64, shape (n, 3)
        Filled here.
    """
    count = len(points)
    blocks = -(-count // _BLOCK)
    low, high = np.empty((blocks, 3)), np.empty((blocks, 3))
    with threads_for(count):
        _unpack(
            blocks, data, np.int64(header.record), np.array(header.scale), np.array(header.offset), points, low, high
        )
    if count == 0:
        return np.zeros(3), np.zeros(3)
    return low.min(axis=0), high.max(axis=0)


@rows
def _unpack(first, last, data, record, scale, offset, points, low, high):
    count = len(points)
    for block in range(first, last):
        for axis in range(3):
            low[block, axis] = np.inf
            high[block, axis] = -np.inf
        for i in range(block * _BLOCK, min(count, (block + 1) * _BLOCK)):
            p = i * record
            for axis in range(3):
                whole = np.int32(
                    np.uint32(data[p]) | np.uint32(data[p + 1]) << np.uint32(8)
                    | np.uint32(data[p + 2]) << np.uint32(16) | np.uint32(data[p + 3]) << np.uint32(24)
                )  # fmt: skip
                value = whole * scale[axis] + offset[axis]
                points[i, axis] = value
                low[block, axis] = min(low[block, axis], value)
                high[block, axis] = max(high[block, axis], value)
                p += 4
