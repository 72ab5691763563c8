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

from surfel._numba import inlined, inner
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

_TESTED = 32  # a box longer than this in cells is not looked at cell by cell

_FULL = np.uint64(0xFFFFFFFFFFFFFFFF)
_BYTES = np.uint64(0x0101010101010101)


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


@inner
def colour_of_ball(low, step, table, border, inside, gaps, x, y, z, radius):
    """Return the one colour of all cells round a ball, or BORDER where they are not all free.

    The first six arguments are those of :class:`Grid`. First by the clearance of the brick that holds the centre.
    Then by the border cells of the box round the ball: free cells that fill a box are connected, so they have one
    colour.
    """
    inverse = 1.0 / step
    a, b, c = (x - low[0]) * inverse, (y - low[1]) * inverse, (z - low[2]) * inverse
    nx, ny, nz = 8.0 * table.shape[0], 8.0 * table.shape[1], 8.0 * table.shape[2]
    r = radius * inverse + 1e-9
    colour = -1  # one way out: with several, numba counts references to all arrays at each call
    if a + r < 0.0 or b + r < 0.0 or c + r < 0.0 or a - r >= nx or b - r >= ny or c - r >= nz:
        colour = OUT
    elif a >= 0.0 and b >= 0.0 and c >= 0.0 and a < nx and b < ny and c < nz:
        i, j, k = int(a) >> 3, int(b) >> 3, int(c) >> 3
        gap = gaps[i, j, k]
        if gap > 0:
            u, v, w = a - 8.0 * i, b - 8.0 * j, c - 8.0 * k
            wall = min(min(min(u, 8.0 - u), min(v, 8.0 - v)), min(w, 8.0 - w))
            if 8.0 * (gap - 1) + wall > r:
                colour = -1 - table[i, j, k]
    if colour < 0 and 2.0 * r > _TESTED:
        colour = BORDER
    elif colour < 0:
        i0, i1 = int(max(a - r, 0.0)), int(min(a + r, nx - 1.0))
        j0, j1 = int(max(b - r, 0.0)), int(min(b + r, ny - 1.0))
        k0, k1 = int(max(c - r, 0.0)), int(min(c + r, nz - 1.0))
        for p in range(i0 >> 3, (i1 >> 3) + 1):
            for q in range(j0 >> 3, (j1 >> 3) + 1):
                for s in range(k0 >> 3, (k1 >> 3) + 1):
                    brick = table[p, q, s]
                    if colour == BORDER:
                        break
                    if brick < 0:
                        colour = -1 - brick
                        continue
                    y0, y1 = max(j0 - 8 * q, 0), min(j1 - 8 * q, 7)
                    z0, z1 = max(k0 - 8 * s, 0), min(k1 - 8 * s, 7)
                    mask = _box_mask(y0, y1, z0, z1)
                    some_border, some_inside = np.uint64(0), np.uint64(0)
                    for layer in range(max(i0 - 8 * p, 0), min(i1 - 8 * p, 7) + 1):
                        some_border |= border[brick, layer]
                        some_inside |= inside[brick, layer]
                    free = IN if some_inside & mask else OUT
                    colour = BORDER if some_border & mask else free
    return colour


@inlined
def _box_mask(y0, y1, z0, z1):
    """Return the word with the bits of y0..y1 and z0..z1 of a layer."""
    row = ((np.uint64(1) << np.uint64(z1 - z0 + 1)) - np.uint64(1)) << np.uint64(z0)
    bytes_ = ((_FULL >> np.uint64(56 - 8 * (y1 - y0))) << np.uint64(8 * y0)) & _BYTES
    return row * bytes_
