"""Kernels that walk over binary PLY records of unequal length."""

from __future__ import annotations

import numpy as np

from surfel._numba import kernel


@kernel
def step_over(data, rows, counts, signed, sizes, chosen, little, starts, lengths, places):
    """Walk over the records; return how many were whole and where the walk stopped."""
    stop = len(data)
    p = 0
    keep = len(places) > 0
    for row in range(rows):
        begin = p
        scalar = 0
        for i in range(len(counts)):
            if counts[i] == 0:
                if keep:
                    places[row, scalar] = p
                scalar += 1
                p += sizes[i]
            else:
                if p + counts[i] > stop:
                    return row, begin
                n = _integer(data, p, counts[i], signed[i], little)
                p += counts[i]
                if n < 0 or n > (stop - p) // sizes[i]:
                    return row, begin
                if i == chosen:
                    starts[row] = p
                    lengths[row] = n
                p += n * sizes[i]
            if p > stop:
                return row, begin
    return rows, p


@kernel
def gather(data, starts, lengths, size, signed, little, items):
    """Read the items of all lists."""
    k = 0
    for row in range(len(starts)):
        p = starts[row]
        for _ in range(lengths[row]):
            items[k] = _integer(data, p, size, signed, little)
            k += 1
            p += size


@kernel
def _integer(data, p, size, signed, little):
    """Read a whole number of ``size`` bytes."""
    value = np.int64(0)
    for i in range(size):
        value = (value << 8) | np.int64(data[p + (size - 1 - i if little else i)])
    if signed and value >> (8 * size - 1):
        value -= np.int64(1) << (8 * size)
    return value
