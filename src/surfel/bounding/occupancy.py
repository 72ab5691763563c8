"""Which parts of the grid have data: four quarters a cell, cut by its two diagonals, one bit each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel, rows, threads_for
from surfel.bounding.evaluate import cell_of, value_at
from surfel.core.cast import Floats

LEFT, RIGHT, LOW, HIGH, WHOLE = 1, 2, 4, 8, 15
"""The quarter of a cell next to its side of least u, largest u, least v, largest v; and all four."""

Quarters = NDArray[np.uint8]


def trimmed_values(coefficients: Floats, trim: Quarters, uv: Floats) -> Floats:
    """Return the values of a spline, NaN outside the domain and outside the quarters set in ``trim``."""
    out = np.empty(len(uv))
    with threads_for(len(uv)):
        _trimmed_values(len(uv), np.array(coefficients), np.array(trim), np.ascontiguousarray(uv), out)
    return out


def outside(occupancy: Quarters) -> NDArray[np.bool_]:
    """Return the empty cells that can be reached from beyond the grid over the sides of empty cells."""
    found = np.zeros(occupancy.shape, np.bool_)
    _outside(np.array(occupancy), found)
    return found


@inlined
def quarter(s, t):
    """Return the bit of the quarter in which the local coordinates (s, t) of a cell lie."""
    if t <= s:
        return np.uint8(4) if t <= 1.0 - s else np.uint8(2)
    return np.uint8(1) if t <= 1.0 - s else np.uint8(8)


@inlined
def inside_trim(trim, u, v):
    """Tell whether a place of the domain lies in a quarter that is set."""
    h, k = cell_of(u, trim.shape[0]), cell_of(v, trim.shape[1])
    return (trim[h, k] & quarter(u - h, v - k)) != 0


@rows
def _trimmed_values(first, last, b, trim, uv, out):
    for i in range(first, last):
        u, v = uv[i, 0], uv[i, 1]
        z = value_at(b, u, v)
        if z == z and not inside_trim(trim, u, v):
            z = np.nan
        out[i] = z


@kernel
def _outside(occupancy, found):
    n, m = occupancy.shape
    todo, count = np.empty(4 * n * m + 2 * (n + m), np.int64), 0
    for h in range(n):
        for k in range(m):
            if h == 0 or h == n - 1 or k == 0 or k == m - 1:
                todo[count] = h * m + k
                count += 1
    while count > 0:
        count -= 1
        h, k = todo[count] // m, todo[count] % m
        if found[h, k] or occupancy[h, k] != 0:
            continue
        found[h, k] = True
        for dh, dk in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            if 0 <= h + dh < n and 0 <= k + dk < m:
                todo[count] = (h + dh) * m + k + dk
                count += 1


@inlined
def _at_corner(i, j):
    """Return the quarters at a corner of a cell: what the diagonal past the corner cuts off."""
    return (RIGHT if i else LEFT) | (HIGH if j else LOW)


@inlined
def _is_bound(outer, i, j):
    # a grid point that is not free: some cell round it is kept
    for h in range(max(i - 1, 0), min(i + 1, outer.shape[0])):
        for k in range(max(j - 1, 0), min(j + 1, outer.shape[1])):
            if not outer[h, k]:
                return True
    return False


@inlined
def _is_empty(hull, h, k):
    return h < 0 or k < 0 or h >= hull.shape[0] or k >= hull.shape[1] or hull[h, k] == 0


@kernel
def trim_into(occupancy, outer, out):
    """Write the quarters that are kept: the hulls of the bound corners of each cell, without bare corners.

    A corner is bare that juts out: without data, and with nothing beside it over either of its two edges.
    """
    n, m = occupancy.shape
    hull = np.empty((n, m), np.int64)
    for h in range(n):
        for k in range(m):
            free, missing = 0, 0
            for i in range(2):
                for j in range(2):
                    if outer[h, k] and not _is_bound(outer, h + i, k + j):
                        free, missing = free + 1, _at_corner(i, j)
            hull[h, k] = 0 if free > 1 else WHOLE & ~missing
    for h in range(n):
        for k in range(m):
            kept, held = hull[h, k], np.int64(occupancy[h, k])
            if kept == WHOLE and held > 0:
                for i in range(2):
                    for j in range(2):
                        quarters = _at_corner(i, j)
                        beside = _is_empty(hull, h + 2 * i - 1, k) and _is_empty(hull, h, k + 2 * j - 1)
                        if held & quarters == 0 and beside:
                            kept &= ~quarters
            out[h, k] = np.uint8(kept)
