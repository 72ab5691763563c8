"""Grid: the space round a cloud in cells of about two spacings, each border, inside or outside.

Cells are bits: a brick of 8 x 8 x 8 cells is eight words, one for each x, with bit 8 y + z. Only bricks that hold
border cells have words of their own; the rest of space costs one number a brick. So a million surfels take about two
megabytes, and whether a box of cells is free of border is a few masks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined
from surfel.core.cast import Floats

OUT, IN, BORDER = 0, 1, 2
"""What a cell can be."""

ALL_OUT, ALL_IN = -1, -2
"""Entries of the table for bricks that are one colour throughout."""

CELL = 2.2
"""Side of a cell, in spacings."""

SIDE = 8
"""Cells along a side of a brick."""

MOST_BRICKS = 1 << 21
"""The table has no more bricks than this; where the cloud would need more, cells are made larger."""

_LOOKED_AT = 20_000  # surfels whose spacings tell which ones are large


class Grid(NamedTuple):
    """Coloured space, as kernels read it.

    Parameters
    ----------
    low : Floats, shape (3,)
        The lowest corner, in the operand's coordinates.
    step : float
        Side of a cell.
    table : NDArray[np.int32], shape (x, y, z)
        The number of each brick, or :data:`ALL_OUT` or :data:`ALL_IN`.
    border, inside : NDArray[np.uint64], shape (bricks, 8)
        Bits of the cells that are border, and of those that are inside.
    gap : NDArray[np.uint8], shape (x, y, z)
        Clearance: Chebyshev distance to the nearest brick with border cells, in bricks, up to 255.
    """

    low: Floats
    step: float
    table: NDArray[np.int32]
    border: NDArray[np.uint64]
    inside: NDArray[np.uint64]
    gap: NDArray[np.uint8]


class Frame(NamedTuple):
    """Where the cells lie: the lowest corner, the side of a cell, and how many bricks there are along each axis."""

    low: Floats
    step: float
    bricks: tuple[int, int, int]


def frame_for(bounds: Floats, spacings: Floats) -> Frame:
    """Choose cells of :data:`CELL` spacings (their root mean square), with at least one free cell round the cloud.

    The mean square keeps the disks, all together, to some cells a surfel, however uneven the cloud is. The hundredth
    part with the largest spacings, strays among them, has no say.
    """
    extent = bounds[1] - bounds[0]
    largest = float(np.quantile(spacings[:: max(1, len(spacings) // _LOOKED_AT)], 0.99))
    spacing = math.sqrt(float(np.mean(np.minimum(spacings, largest) ** 2)))
    widest = float(extent.max())
    step = max(CELL * spacing, widest * 2.0**-20)
    if step == 0.0:
        step = max(1.0, float(np.abs(bounds).max()) * 2.0**-40)
    while True:
        cells = np.ceil(extent / step) + 4.0
        bricks = np.ceil(cells / SIDE)
        if float(np.prod(bricks)) <= MOST_BRICKS:
            break
        step *= 1.2
    low = bounds[0] - 0.5 * (bricks * SIDE * step - extent)
    return Frame(low, step, (int(bricks[0]), int(bricks[1]), int(bricks[2])))


@inlined
def bit_of(y, z):
    """Return the word with the bit of cell (y, z) of a layer."""
    return np.uint64(1) << np.uint64(8 * y + z)
