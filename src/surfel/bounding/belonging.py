"""Which micro-cell a point belongs to, for good, and what points that come or go are to a memory.

A point is found again only if the same bits lead to the same micro-cell, however often the grid has grown since it
came. So a micro-cell is found in the coordinates of the first grid, which growth does not touch, by a rule that does
not know how large the grid is by now; growth adds whole numbers to its place, which is exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel
from surfel.bounding.evaluate import value_at
from surfel.bounding.frame import Frame
from surfel.bounding.memory import Memory
from surfel.bounding.normal import fill_row
from surfel.bounding.occupancy import Quarters, quarter
from surfel.bounding.passes import micro_cell
from surfel.core.cast import Floats, Integers


@dataclass(frozen=True, eq=False)
class Places:
    """Where points lie over a grid that has perhaps grown.

    Cells below the end of the first grid hold their lower border, those beyond their upper one: so the point at the
    very end stays in the last cell of the first grid, and at the end of the grown grid one stays within it.

    Parameters
    ----------
    first : Floats, shape (k, 2)
        Domain coordinates on the first grid.
    uv : Floats, shape (k, 2)
        Domain coordinates: those on the first grid and the whole number of cells before it. Rounding keeps them
        within the closed cell that the point belongs to.
    cell : Floats, shape (k, 2)
        The cell that each belongs to: whole numbers, outside the grid where the point is.
    heights : Floats, shape (k,)
        Along the direction.
    """

    first: Floats
    uv: Floats
    cell: Floats
    heights: Floats

    @classmethod
    def of(cls, points: Floats, frame: Frame, cells: Integers) -> Places:
        """Return the places of points; the first grid had so many cells."""
        first, heights = replace(frame, origin=np.zeros(2, np.int64)).to_domain(points)
        cell = np.where(first < cells, np.floor(first), np.ceil(first) - 1.0)
        return cls(first, first + frame.origin, cell + frame.origin, heights)

    def within(self, frame: Frame) -> bool:
        """Tell whether all lie over the grid."""
        return bool(((self.cell >= 0.0) & (self.cell < frame.cells)).all())


@dataclass(frozen=True, eq=False)
class Tally:
    """What points are to the micro-cells of a memory. Heights and residuals carry the sign of the side.

    Parameters
    ----------
    largest : Floats, shape (a, b)
        Largest residual beside the memory's reference; -inf where no point lies.
    which : Integers, shape (a, b)
        The point that has it.
    count : Integers, shape (a, b)
        Points in the micro-cell.
    known : NDArray[np.bool_], shape (a, b)
        Whether the point that the memory keeps of the micro-cell is among them.
    occupancy : Quarters, shape (n - 1, m - 1)
        Which quarters of the cells they lie in.
    weight : Floats, shape (n + 2, m + 2)
        Sums of their weights on each coefficient.
    """

    largest: Floats
    which: Integers
    count: Integers
    known: NDArray[np.bool_]
    occupancy: Quarters
    weight: Floats

    @classmethod
    def of(cls, places: Places, frame: Frame, memory: Memory, sign: float) -> Tally:
        """Sort points that lie over the grid into the micro-cells."""
        shape = memory.count.shape
        tally = cls(
            np.full(shape, -np.inf),
            np.zeros(shape, np.int64),
            np.zeros(shape, np.int64),
            np.zeros(shape, np.bool_),
            np.zeros(tuple(frame.cells), np.uint8),
            np.zeros(memory.reference.shape),
        )
        _take(
            places.first, places.uv, places.cell.astype(np.int64), frame.origin.copy(), sign * places.heights,
            sign * memory.reference, np.int64(memory.split), memory.uv.copy(), sign * memory.height,
            tally.largest, tally.which, tally.count, tally.known, tally.occupancy, tally.weight,
        )  # fmt: skip
        return tally


@kernel
def _take(first, uv, cell, origin, z, b, split, kept_uv, kept_z, largest, which, count, known, occupancy, weight):
    row = np.empty(16)
    for i in range(len(z)):
        h, k = cell[i, 0], cell[i, 1]
        s, t = first[i, 0] - (h - origin[0]), first[i, 1] - (k - origin[1])
        a, c = micro_cell(h, s, split), micro_cell(k, t, split)
        count[a, c] += 1
        residual = z[i] - value_at(b, uv[i, 0], uv[i, 1])
        if residual > largest[a, c]:
            largest[a, c], which[a, c] = residual, i
        if z[i] == kept_z[a, c] and first[i, 0] == kept_uv[a, c, 0] and first[i, 1] == kept_uv[a, c, 1]:
            known[a, c] = True
        occupancy[h, k] |= quarter(s, t)
        fill_row(s, t, row)
        for j in range(16):
            weight[h + j // 4, k + j % 4] += row[j]
