"""Points by cells: each goes to the bucket of its cell, and what has gathered there is worked on together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner
from surfel.bounding.compare import NET
from surfel.bounding.evaluate import cell_of
from surfel.bounding.frame import project
from surfel.bounding.records import HEIGHT, LOCAL_U, LOCAL_V, RECORD, records_of_eight
from surfel.core.cast import Floats

HALVED = 100_000
"""Points from which on the two halves of a pass may run side by side."""

BLOCK = 120
"""Points whose records are made together: they stay in the first cache."""

EIGHT = 8
"""Points that come into buckets together: one may take them all after it is full."""

_BUCKETS = 10_000
"""Points for which all buckets have room: they stay in the second cache."""

_LARGEST_BUCKET = 104


@dataclass(frozen=True, eq=False)
class Buckets:
    """Where points are gathered by their cells, again and again in each look at them.

    Parameters
    ----------
    cells : NDArray, shape (points,)
        The cell of each point, counted in rows along v, as the last look found it.
    records : Floats, shape (parts, cells, room + 8, RECORD)
        The buckets of each part of the points; each has room for eight points more than it is emptied at.
    """

    cells: NDArray[np.int32]
    records: Floats

    @classmethod
    def of(cls, points: int, cells: int) -> Buckets:
        """Return empty buckets for some points over some cells."""
        shape = 2 if points >= HALVED else 1, cells, room_of(cells) + EIGHT, RECORD
        size = int(np.prod(shape))
        flat = np.empty(size + 8)
        first = -(flat.__array_interface__["data"][0] // 8) % 8  # no record lies across two lines of the cache
        return cls(np.empty(points, np.int32), flat[first : first + size].reshape(shape))

    @property
    def parts(self) -> int:
        """Into how many parts the points are cut."""
        return len(self.records)


def room_of(cells: int) -> int:
    """Return how many points a bucket has room for: a multiple of eight, and no power of two."""
    room = max(8, min(_LARGEST_BUCKET, _BUCKETS // cells // 8 * 8))
    return room - 8 if room in (16, 32, 64) else room


@inner
def fetch_records(p, first, count, f, cell, w):
    """Write the cells of some points and, to scratch, their records; ``p`` is flat."""
    whole = count - count % 8
    for i in range(0, whole, 8):
        records_of_eight(p, 3 * (first + i), f, cell, first + i, w, i)
    n, m = np.int64(f[13]), np.int64(f[14])
    for i in range(whole, count):
        at = 3 * (first + i)
        u, v, w[RECORD * i + HEIGHT] = project(f, p[at], p[at + 1], p[at + 2])
        h, k = cell_of(u, n), cell_of(v, m)
        w[RECORD * i + LOCAL_U], w[RECORD * i + LOCAL_V] = u - h, v - k
        cell[first + i] = np.int32(h * m + k)


@inlined
def insert_one(p, i, f, cells, bucket, stride, filled):
    """Put the record of point i into the bucket of its cell."""
    u, v, z = project(f, p[3 * i], p[3 * i + 1], p[3 * i + 2])
    n, m = np.int64(f[13]), np.int64(f[14])
    h, k = cell_of(u, n), cell_of(v, m)
    cell = h * m + k
    at = RECORD * (cell * stride + filled[cell])
    bucket[at + LOCAL_U], bucket[at + LOCAL_V], bucket[at + HEIGHT] = u - h, v - k, z
    cells[i] = np.int32(cell)
    filled[cell] += 1


@inlined
def set_cell(b, width, h, k, c):
    """Write the coefficients of a cell to the constants; ``b`` is flat, in rows of ``width``."""
    for i in range(4):
        for j in range(4):
            c[NET + 4 * i + j] = b[(h + i) * width + k + j]
