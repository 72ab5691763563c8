"""Places in a picture, and how a tile of it lists them: the centres of all its pixels, or a few places in some pixels.

What falls on a tile is drawn to such a list, row after row, so that eight neighbours of a row lie side by side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined
from surfel.core.cast import Floats
from surfel.rendering.eights import LANES
from surfel.rendering.memory import room
from surfel.rendering.placing import TILE, View

CENTRE = np.zeros((1, 2), np.float32)

STRIDE = np.uint64(TILE + 1)
"""Of the tables of a tile: one more than its columns, for where the last of them ends."""


class Places(NamedTuple):
    """Places in a picture: the same offsets in each of some pixels; pixel by pixel."""

    pixels: NDArray[np.int64]
    offsets: NDArray[np.float32]

    def columns_and_rows(self, width: int, rows: NDArray[np.int64] | None = None) -> tuple[Floats, Floats]:
        """Return the places, or some of them by their rows, as floats, pixel centres being whole numbers."""
        number = len(self.offsets)
        if rows is None:
            rows = np.arange(len(self.pixels) * number)
        pixels, offsets = self.pixels[rows // number], self.offsets[rows % number]
        x, y = np.asarray(pixels % width, np.float64), np.asarray(pixels // width, np.float64)
        return x + offsets[:, 0], y + offsets[:, 1]

    def holding(self, rows: NDArray[np.int64]) -> tuple[Places, NDArray[np.int64]]:
        """Return the places of those pixels that hold some of them, given by their rows, and the rows of all these."""
        number = len(self.offsets)
        among = np.unique(rows // number)
        return Places(self.pixels[among], self.offsets), (among[:, None] * number + np.arange(number)).ravel()


class Chosen(NamedTuple):
    """Chosen places as kernels take them: which tiles hold any, and where each pixel's are found."""

    tiles: NDArray[np.int64]
    slot: NDArray[np.int32]  # (h w,): which of the chosen pixels it is; -1 for none
    offsets: NDArray[np.float32]
    whole: bool  # all pixels are meant, at their centres; then ``slot`` is empty
    reach: int  # pixels that places may lie off the boxes of splats, which are rounded to centres
    number: int

    @property
    def most(self) -> int:
        """How many there may be in a tile, and room for an eight that begins at the last."""
        return TILE * TILE * len(self.offsets) + LANES


def chosen(view: View, places: Places | None = None) -> Chosen:
    """Make places ready for kernels; without any, the centres of all pixels."""
    across, down = -(-view.width // TILE), -(-view.height // TILE)
    if places is None:
        return Chosen(np.arange(across * down), np.empty(0, np.int32), CENTRE, True, 0, view.width * view.height)
    slot = room(view.width * view.height, np.int32)
    slot.fill(-1)
    slot[places.pixels] = np.arange(len(places.pixels), dtype=np.int32)
    held = np.zeros(across * down, np.bool_)
    held[(places.pixels // view.width // TILE) * across + places.pixels % view.width // TILE] = True
    return Chosen(np.flatnonzero(held), slot, places.offsets, False, 1, len(places.pixels) * len(places.offsets))


@inlined
def listed(slot, left, right, top, bottom, width, offsets, begins, sums, lines, xs, ys):
    """List the places of a tile, and return how many there are.

    ``begins[33 y + x]`` is how many come before a pixel, ``sums[33 y + x]`` how many chosen pixels lie above and to the
    left of it.
    """
    count, places, columns = 0, len(offsets), np.uint64(right + 1 - left)
    for y in range(np.uint64(bottom + 1 - top)):
        at, total, row = STRIDE * y, 0, np.int64(y) + top
        for x in range(columns):
            begins[at + x] = count
            sums[at + STRIDE + x] = sums[at + x] + total
            p = row * width + left + np.int64(x)
            if slot[p] >= 0:
                total += 1
                for s in range(places):
                    lines[count] = slot[p] * places + s
                    xs[count] = np.float32(np.int64(x) + left) + offsets[s, 0]
                    ys[count] = np.float32(row) + offsets[s, 1]
                    count += 1
        begins[at + columns] = count
        sums[at + STRIDE + columns] = sums[at + columns] + total
    return count


@inlined
def all_listed(left, right, top, bottom, width, begins, sums, lines, xs, ys):
    """List the centres of all pixels of a tile, as :func:`listed` does."""
    columns, one = np.uint64(right + 1 - left), np.uint64(1)
    for y in range(np.uint64(bottom + 1 - top)):
        at, row, place = STRIDE * y, np.int64(y) + top, y * columns
        for x in range(columns + one):
            begins[at + x] = np.int32(place) + np.int32(x)
            sums[at + STRIDE + x] = np.int32(x) * np.int32(y + one)
        for x in range(columns):
            lines[place + x] = row * width + left + np.int64(x)
            xs[place + x], ys[place + x] = np.float32(left + np.int64(x)), np.float32(row)
    return (right + 1 - left) * (bottom + 1 - top)


@inlined
def touched(i, box, reach, left, right, top, bottom, sums):
    """Return the part of a tile that a splat may fall on, as columns and rows of its tables, and how many pixels."""
    x0 = np.uint64(max(left, np.int64(box[i, 0]) - reach) - left)
    x1 = np.uint64(min(right, np.int64(box[i, 1]) + reach) - left + 1)
    y0 = np.uint64(max(top, np.int64(box[i, 2]) - reach) - top) * STRIDE
    y1 = np.uint64(min(bottom, np.int64(box[i, 3]) + reach) - top + 1) * STRIDE
    return x0, x1, y0, y1, sums[y1 + x1] - sums[y1 + x0] - sums[y0 + x1] + sums[y0 + x0]
