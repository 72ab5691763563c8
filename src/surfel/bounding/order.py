"""Points in the order of their cells, block by block: what all looks at them share.

A block is some thousands of points that stay in the second cache. Within it they are sorted by cell, by counting, so
that the points of one cell are worked on together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner
from surfel.bounding.compare import CELL_U, CELL_V, CELLS_U, CELLS_V, NET, cells_of_eight
from surfel.bounding.evaluate import cell_of
from surfel.bounding.frame import Frame, project

HALVED = 100_000
"""Points from which on the two halves of a pass may run side by side."""

LEAST_BLOCK = 16_384
PER_CELL = 4
"""Points of a block, or so many a cell where that is more."""


@dataclass(eq=False)
class Order:
    """In which order points are to be taken; filled in by the first look at them.

    Parameters
    ----------
    block : int
        Points of a block.
    rank : NDArray, shape (n,)
        Numbers of the points within their block, sorted by cell.
    starts : NDArray, shape (parts, blocks, cells + 1)
        Where the points of each cell begin within the block.
    known : bool
        Whether it has been filled in.
    """

    block: int
    rank: NDArray[np.int32]
    starts: NDArray[np.int32]
    known: bool = False

    @classmethod
    def of(cls, points: int, frame: Frame) -> Order:
        """Return the order of some points, to be filled in; many are cut in two."""
        cells = int(frame.cells[0] * frame.cells[1])
        block = max(LEAST_BLOCK, PER_CELL * cells)
        parts = 2 if points >= HALVED else 1
        most = -(-points // (parts * block))
        return cls(block, np.empty(points, np.int32), np.empty((parts, most, cells + 1), np.int32))

    @property
    def parts(self) -> int:
        """Into how many parts the points are cut."""
        return len(self.starts)


@inner
def sort_block(p, first, count, f, places, rank, starts):
    """Sort ``count`` points from number ``first`` on by cell; ``p`` and all others are flat."""
    cells = starts.shape[0] - 1
    whole = count - count % 8
    for i in range(0, whole, 8):
        cells_of_eight(p, 3 * (first + i), f, places, i)
    n, m = np.int64(f[CELLS_U]), np.int64(f[CELLS_V])
    for i in range(whole, count):
        at = 3 * (first + i)
        u, v, _ = project(f, p[at], p[at + 1], p[at + 2])
        places[i] = np.int32(cell_of(u, n) * m + cell_of(v, m))
    starts[:] = 0
    for i in range(count):
        starts[np.int64(places[i]) + 1] += 1
    begin = np.int32(0)
    for cell in range(1, cells + 1):  # each is where the cell before it begins, and is moved to where that ends
        many = starts[cell]
        starts[cell] = begin
        begin += many
    for i in range(count):
        cell = np.int64(places[i]) + 1
        rank[first + starts[cell]] = i
        starts[cell] += 1


@inner
def fetch_block(p, first, count):
    """Read a block from end to end, which is fast, before its points are read in another order; returns a sum."""
    total = 0.0
    for at in range(3 * first, 3 * (first + count), 8):
        total += p[at]
    return total


@inlined
def set_cell(b, width, h, k, c):
    """Write the cell and its coefficients to the constants; ``b`` is flat, in rows of ``width``."""
    c[CELL_U], c[CELL_V] = h, k
    for i in range(4):
        for j in range(4):
            c[NET + 4 * i + j] = b[(h + i) * width + k + j]
