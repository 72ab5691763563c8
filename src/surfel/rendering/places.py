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
from surfel.rendering.placing import TILE, View

CENTRE = np.zeros((1, 2), np.float32)

STRIDE = np.uint64(TILE + 1)
"""Of the tables of a tile: one more than its columns, for where the last of them ends."""


class Places(NamedTuple):
    """Places in a picture: the same offsets in each of some pixels, which ascend; pixel by pixel."""

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


class Chosen(NamedTuple):
    """Chosen places as kernels take them, and which tiles hold any."""

    tiles: NDArray[np.int64]
    pixels: NDArray[np.int64]  # ascending
    offsets: NDArray[np.float32]
    rank: NDArray[np.int32]  # of each place, which of those wanted it is, -1 for none; empty where all are wanted
    whole: bool  # all pixels are meant, at their centres; then ``pixels`` is empty
    reach: int  # pixels that places may lie off the boxes of splats, which are rounded to centres
    number: int

    @property
    def most(self) -> int:
        """How many there may be in a tile, and room for an eight that begins at the last."""
        return TILE * TILE * len(self.offsets) + LANES


def chosen(view: View, places: Places | None = None, rows: NDArray[np.int64] | None = None) -> Chosen:
    """Make places ready for kernels, or some of them by their rows; without any, the centres of all pixels."""
    across, down = -(-view.width // TILE), -(-view.height // TILE)
    none, every = np.empty(0, np.int64), np.empty(0, np.int32)
    if places is None:
        return Chosen(np.arange(across * down), none, CENTRE, every, True, 0, view.width * view.height)
    pixels, offsets = places
    held = np.zeros(across * down, np.bool_)
    here = pixels if rows is None else pixels[rows // len(offsets)]
    held[(here // view.width // TILE) * across + here % view.width // TILE] = True
    if rows is not None:
        every = np.full(len(pixels) * len(offsets), -1, np.int32)
        every[rows] = np.arange(len(rows), dtype=np.int32)
    number = len(pixels) * len(offsets) if rows is None else len(rows)
    return Chosen(np.flatnonzero(held), pixels, offsets, every, False, 1, number)


@inlined
def listed(pixels, rank, left, right, top, bottom, width, offsets, begins, sums, lines, xs, ys):
    """List the places of a tile, and return how many there are.

    ``begins[33 y + x]`` is how many come before a pixel, ``sums[33 y + x]`` how many chosen pixels lie above and to the
    left of it.
    """
    count, k, places, columns = 0, 0, len(offsets), np.uint64(right + 1 - left)
    for y in range(np.uint64(bottom + 1 - top)):
        at, total, row = STRIDE * y, 0, np.int64(y) + top
        p, end = row * width + left, len(pixels)
        while k < end:  # the first pixel of this row, by halving
            half = (k + end) // 2
            k, end = (half + 1, end) if pixels[half] < p else (k, half)
        for x in range(columns):
            begins[at + x] = count
            sums[at + STRIDE + x] = sums[at + x] + total
            if k < len(pixels) and pixels[k] == p + np.int64(x):
                before = count
                for s in range(places):
                    line = k * places + s
                    line = np.int64(rank[line]) if len(rank) > 0 else line
                    if line >= 0:
                        lines[count] = line
                        xs[count] = np.float32(np.int64(x) + left) + offsets[s, 0]
                        ys[count] = np.float32(row) + offsets[s, 1]
                        count += 1
                total += count > before
                k += 1
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
