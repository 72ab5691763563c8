"""Hilbert order of points: rows that follow each other lie near each other, at every scale that the points have."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import inlined, kernel, rows, threads_for
from surfel.core.cast import Floats, as_count, as_points
from surfel.core.errors import InputError
from surfel.index.radix import index_bits, sort_packed

_CROWDED = 16  # a cell with more points than this is divided again
_TILE = 256


def hilbert_order(points: ArrayLike, bits: int | None = None) -> NDArray[np.int32]:
    """Return the permutation that sorts points along a Hilbert curve.

    The curve runs through a grid of ``2**bits`` cells an axis. A cell with more than 16 points is divided by a grid of
    its own, and so on until its points are few or equal: a stray point far away does not coarsen the order of the rest.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Finite coordinates of any scale, fewer than 2**31 points.
    bits : int, optional
        Between 1 and 21; lowered where key and row do not fit 63 bits. By default what suits ``n`` points of a surface.

    Returns
    -------
    NDArray[np.int32], shape (n,)
        ``points[order]`` is sorted. Points that no grid separates keep their order. The same on any number of threads.

    Raises
    ------
    InputError
        If the points are not finite rows of three, or ``bits`` is out of range.

    Notes
    -----
    The curve is found by the transposition of J. Skilling, *Programming the Hilbert curve*, AIP Conf. Proc. 707 (2004).

    Examples
    --------
    >>> from surfel.index.hilbert import hilbert_order
    >>> hilbert_order([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]], bits=1).tolist()
    [0, 3, 1, 2]
    """
    given = as_points(points)
    if len(given) >= 2**31:
        raise InputError(f"points must be fewer than 2**31 rows; got {len(given)}")
    wanted = _bits_for(len(given)) if bits is None else as_count(bits, "bits", 1, 21)
    return _order(given, wanted)


def _bits_for(n: int) -> int:
    """Return the bits at which a surface of n even points has few points a cell: 4**bits is 1 to 4 times n."""
    return max(4, (index_bits(n) + 2) // 2)


def _order(points: Floats, bits: int) -> NDArray[np.int32]:
    order = np.arange(len(points), dtype=np.int32)
    place = order.copy()  # which rows of the order are (still) being sorted
    group = np.zeros(len(points), np.int32)  # and the crowded cell that each belongs to
    groups = 1 if len(points) else 0
    while groups:
        taken = order[place]
        low, extent = _group_boxes(points, taken, group, groups)
        free = 63 - index_bits(len(taken)) - index_bits(groups)
        bits = max(1, min(bits, free // 3))
        packed = _packed_keys(points, taken, group, low, extent, bits)
        packed = sort_packed(packed, index_bits(len(taken)), 3 * bits + index_bits(groups))
        order, place, group, groups = _place(packed, index_bits(len(taken)), taken, place, order, extent, 3 * bits)
    return order


def _packed_keys(
    points: Floats, taken: NDArray[np.int32], group: NDArray[np.int32], low: Floats, extent: Floats, bits: int
) -> NDArray[np.int64]:
    packed = np.empty(len(taken), np.int64)
    with threads_for(len(taken)):
        _key_tiles(-(-len(taken) // _TILE), points, taken, group, low, extent, bits, index_bits(len(taken)), packed)
    return packed


@rows
def _key_tiles(first, last, points, order, group, low, extent, bits, shift, packed):
    """Pack group, Hilbert key and place into one integer; tiles, so that every step runs over whole vectors."""
    n = len(order)
    xs, ys, zs = np.zeros(_TILE, np.int64), np.zeros(_TILE, np.int64), np.zeros(_TILE, np.int64)
    for start in range(first * _TILE, min(n, last * _TILE), _TILE):
        count = min(_TILE, n - start)
        for j in range(count):
            row, g = order[start + j], group[start + j]
            xs[j] = _cell(points[row, 0], low[g, 0], extent[g], bits)
            ys[j] = _cell(points[row, 1], low[g, 1], extent[g], bits)
            zs[j] = _cell(points[row, 2], low[g, 2], extent[g], bits)
        _transpose(xs, ys, zs, bits)
        for j in range(count):
            key = (_spread(xs[j]) << 2) | (_spread(ys[j]) << 1) | _spread(zs[j])
            packed[start + j] = ((((group[start + j]) << (3 * bits)) | key) << shift) | (start + j)


@inlined
def _cell(x, low, extent, bits):
    """Return floor(2^bits (x - low) / extent), halved first so that no difference overflows."""
    share = (x * 0.5 - low) / extent if extent > 0.0 else 0.0
    last = (1 << bits) - 1
    return min(int(share * (last + 1)), last)


@inlined
def _transpose(x, y, z, bits):
    """Turn cell coordinates into the transposed Hilbert key (Skilling 2004, AxestoTranspose), without branches."""
    for shift in range(bits - 1, 0, -1):
        below = (1 << shift) - 1
        for j in range(_TILE):
            u, v, w = x[j], y[j], z[j]
            u ^= below & -((u >> shift) & 1)
            flip = -((v >> shift) & 1)
            swap = (u ^ v) & below & ~flip
            u ^= swap | (below & flip)
            v ^= swap
            flip = -((w >> shift) & 1)
            swap = (u ^ w) & below & ~flip
            u ^= swap | (below & flip)
            w ^= swap
            x[j], y[j], z[j] = u, v, w
    for j in range(_TILE):
        u, v, w = x[j], y[j], z[j]
        v ^= u
        w ^= v
        gray = w >> 1
        gray ^= gray >> 1
        gray ^= gray >> 2
        gray ^= gray >> 4
        gray ^= gray >> 8
        gray ^= gray >> 16
        x[j], y[j], z[j] = u ^ gray, v ^ gray, w ^ gray


@inlined
def _spread(x):
    """Put two zeros between the 21 low bits of x."""
    x &= 0x1FFFFF
    x = (x | (x << 32)) & 0x1F00000000FFFF
    x = (x | (x << 16)) & 0x1F0000FF0000FF
    x = (x | (x << 8)) & 0x100F00F00F00F00F
    x = (x | (x << 4)) & 0x10C30C30C30C30C3
    return (x | (x << 2)) & 0x1249249249249249


@kernel
def _group_boxes(points, taken, group, groups):
    """Return half the low corner and half the longest side of the box of each group."""
    low, high = np.empty((groups, 3)), np.empty((groups, 3))
    for g in range(groups):
        for axis in range(3):
            low[g, axis], high[g, axis] = np.inf, -np.inf
    for i in range(len(taken)):
        row, g = taken[i], group[i]
        for axis in range(3):
            half = points[row, axis] * 0.5
            low[g, axis] = min(low[g, axis], half)
            high[g, axis] = max(high[g, axis], half)
    extent = np.empty(groups)
    for g in range(groups):
        extent[g] = max(high[g, 0] - low[g, 0], high[g, 1] - low[g, 1], high[g, 2] - low[g, 2])
    return low, extent


@kernel
def _place(packed, shift, taken, place, order, extent, key_bits):
    """Write the sorted rows into the order; return it with the places and groups of the cells still crowded."""
    n = len(packed)
    mask = (1 << shift) - 1
    for i in range(n):
        order[place[i]] = taken[packed[i] & mask]
    found = 0
    groups = 0
    for write in range(2):
        if write == 1:
            next_place = np.empty(found, np.int32)
            next_group = np.empty(found, np.int32)
        found = 0
        groups = 0
        i = 0
        while i + _CROWDED < n:
            key = packed[i] >> shift
            if packed[i + _CROWDED] >> shift != key or extent[key >> key_bits] == 0.0:
                i += 1
                continue
            while i < n and packed[i] >> shift == key:
                if write == 1:
                    next_place[found] = place[i]
                    next_group[found] = groups
                found += 1
                i += 1
            groups += 1
    return order, next_place, next_group, groups
