"""Owners: the cells that hold surfels, numbered by counting bits, and the mean normal of what each holds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel, rows, threads_for
from surfel.core.cast import Floats
from surfel.inside.border import Bricks
from surfel.inside.grid import Frame, bit_of


class Owners(NamedTuple):
    """The cells that hold centres of surfels.

    Parameters
    ----------
    base : NDArray[np.int32], shape (bricks, 8)
        The number of the first such cell of each layer of each brick; the others follow in the order of their bits.
    owned : NDArray[np.uint64], shape (bricks, 8)
        Their bits.
    of_surfel : NDArray[np.int32], shape (n,)
        The number of the cell that holds each surfel.
    normals : Floats, shape (cells, 3)
        The mean of the normals in each; shorter than 1 where they disagree.
    """

    base: NDArray[np.int32]
    owned: NDArray[np.uint64]
    of_surfel: NDArray[np.int32]
    normals: Floats


def own_cells(frame: Frame, bricks: Bricks, points: Floats, normals: Floats) -> Owners:
    """Return the cells that hold surfels, numbered, with the mean normal of each."""
    base = np.empty((len(bricks.owned), 8), np.int32)
    count = number_cells(bricks.owned, base, 0)
    of_surfel = cells_of(points, frame.low, frame.step, bricks.table, bricks.owned, base)
    return Owners(base, bricks.owned, of_surfel, mean_normals(of_surfel, normals, count))


def cells_of(
    points: Floats,
    low: Floats,
    step: float,
    table: NDArray[np.int32],
    owned: NDArray[np.uint64],
    base: NDArray[np.int32],
) -> NDArray[np.int32]:
    """Return the number of the owning cell of each surfel."""
    of_surfel = np.empty(len(points), np.int32)
    with threads_for(len(points)):
        _find(len(points), points, low, step, table, owned, base, of_surfel)
    return of_surfel


@inlined
def bit_count(word):
    """Return how many bits of a word are set."""
    word = word - ((word >> np.uint64(1)) & np.uint64(0x5555555555555555))
    word = (word & np.uint64(0x3333333333333333)) + ((word >> np.uint64(2)) & np.uint64(0x3333333333333333))
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((word * np.uint64(0x0101010101010101)) >> np.uint64(56))


@inlined
def owner_of(word, first, bit):
    """Return the number of the owning cell at a bit of a layer's word, or -1 where no centre lies there.

    ``first`` is the number of the layer's first one. Arrays are not passed: each would cost a count of references.
    """
    if word & bit == np.uint64(0):
        return -1
    return first + bit_count(word & (bit - np.uint64(1)))


@kernel
def number_cells(owned, base, first):
    """Write the number of the first cell of each word; return the number after the last cell."""
    for brick in range(len(owned)):
        for layer in range(8):
            base[brick, layer] = first
            first += bit_count(owned[brick, layer])
    return first


@rows
def _find(first, last, points, low, step, table, owned, base, of_surfel):
    for n in range(first, last):
        i, j, k = (
            int((points[n, 0] - low[0]) / step),
            int((points[n, 1] - low[1]) / step),
            int((points[n, 2] - low[2]) / step),
        )
        brick = table[i >> 3, j >> 3, k >> 3]
        of_surfel[n] = owner_of(owned[brick, i & 7], base[brick, i & 7], bit_of(j & 7, k & 7))


@kernel
def mean_normals(of_surfel, normals, count):
    """Return the mean normal of the surfels of each cell."""
    total = np.zeros((count, 3))
    number = np.zeros(count)
    for n in range(len(of_surfel)):
        cell = of_surfel[n]
        for axis in range(3):
            total[cell, axis] += normals[n, axis]
        number[cell] += 1.0
    for cell in range(count):
        for axis in range(3):
            total[cell, axis] /= max(number[cell], 1.0)
    return total
