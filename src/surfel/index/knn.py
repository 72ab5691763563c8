"""All k nearest neighbours: up to 16 places that lie together share one walk through the boxes.

The walk uses a radius learnt from the places before. Its candidates are taken relative to the group's middle in
float64, scaled by the radius and rounded to float32, then filtered and sorted. Whoever may be among the k nearest,
given what rounding can do, is compared again in float64: the result is exact, whatever the offset and the scale. Places
for which float32 is too coarse, or for which a few attempts find no fitting radius, are searched one by one
(:mod:`surfel.index.nearest`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, rows, threads_for
from surfel.core.cast import Floats
from surfel.index.blocks import BLOCK, WIDTH, Blocks, collect, gather_group
from surfel.index.candidates import (
    ATTEMPTS,
    CHUNK,
    COARSE,
    GROUP,
    GROW,
    ONE,
    ROOM,
    SHRINK,
    SIDE,
    load,
    mask_for,
    may_be_as_near,
)
from surfel.index.knn_one import search_one
from surfel.index.nearest import STACK, insert, nearest_of
from surfel.index.simd import LANES, RUN, bits_of, float_of, sort_keys, within

_SLACK = 1.06
_MOST_SLOTS = 2**16


def search_nearest(
    blocks: Blocks, places: Floats, order: NDArray[np.int32], own: bool, squares: Floats, neighbours: NDArray[np.int32]
) -> None:
    """Fill ``squares`` and ``neighbours`` (m, k) with the nearest points of ``places[order]``.

    With ``own`` the places are the indexed points: results stand in the order of ``order``, and no point is its own
    neighbour. Otherwise ``order`` is only the order of the search, and result i belongs to ``places[i]``.
    """
    if squares.shape[1] == 1:
        search_one(blocks, places, order, own, squares, neighbours)
        return
    with threads_for(30 * len(order)):  # a search is heavier than the items that the threshold is meant for
        _search_chunks(-(-len(order) // CHUNK), *blocks, places, order, own, squares, neighbours)


@rows
def _search_chunks(first, last, points, nodes, levels, places, order, own, squares, neighbours):
    m, k = squares.shape
    need = k + 1 if own else k  # a point finds itself, too
    room = ROOM + need  # blocks of candidates: more mean that the radius is far too large
    slots = (room + WIDTH) * BLOCK + RUN
    stack, bounds = np.empty(STACK, np.int64), np.empty(STACK)
    found, spare = np.empty(room + WIDTH, np.int32), np.empty(room + WIDTH, np.int32)
    xs, ys, zs = np.empty(slots, np.float32), np.empty(slots, np.float32), np.empty(slots, np.float32)
    keys, spare_keys, ordered = np.empty(slots, np.int32), np.empty(slots, np.int32), np.empty(slots, np.int32)
    exact, near = np.empty(slots), np.empty(slots, np.int32)
    for i in range(first * CHUNK, min(last * CHUNK, m)):
        if i % CHUNK == 0:
            reach = -1.0  # nothing learnt yet
            done = i
        if i < done:
            continue
        if not reach > 0.0:  # or a crowd of equal points
            square = nearest_of(points, nodes, levels, places, order, own, i, squares, neighbours, stack, bounds)
            reach = math.sqrt(square) if slots <= _MOST_SLOTS else 0.0
            if not reach > 0.0:
                continue
        stop = min(m, i + GROUP - i % GROUP)
        count, lx, ly, lz, hx, hy, hz = gather_group(places, order, i, stop, SIDE * reach)
        done = i + count
        mx, my, mz = 0.5 * (lx + hx), 0.5 * (ly + hy), 0.5 * (lz + hz)
        todo = (1 << count) - 1
        alone = 0
        largest = 0.0
        radius = reach * _SLACK
        for _ in range(ATTEMPTS):
            collected = collect(nodes, levels, lx, ly, lz, hx, hy, hz, radius * radius, found, spare)
            if collected < 0:
                radius *= SHRINK
                continue
            scale = 1.0 / radius
            load(points, found, collected, mx, my, mz, scale, xs, ys, zs)
            mask = mask_for(collected * BLOCK)
            for j in range(count):
                if (todo >> j) & 1 == 0:
                    continue
                row = order[i + j]
                px, py, pz = places[row, 0], places[row, 1], places[row, 2]
                x, y, z = np.float32((px - mx) * scale), np.float32((py - my) * scale), np.float32((pz - mz) * scale)
                kept = within(xs, ys, zs, collected * BLOCK, x, y, z, ONE, mask, keys)
                if kept < need:
                    continue
                limit = ONE
                if kept > 2 * need + LANES:
                    limit, kept = _tighten(keys, kept, need)
                sort_keys(keys, kept, spare_keys, ordered)
                certain = _certain(ordered, kept, need, mask, limit)
                if certain == 0:
                    continue
                todo &= ~(1 << j)
                if certain < 0:
                    alone |= 1 << j
                    continue
                target, skip = (i + j, row) if own else (row, -1)
                _finish(
                    points, found, ordered, certain, mask, px, py, pz, skip, exact, near, squares, neighbours, target
                )
                largest = max(largest, squares[target, k - 1])
            if todo == 0:
                break
            radius *= GROW
        alone |= todo
        for j in range(count if alone else 0):
            if (alone >> j) & 1:
                square = nearest_of(
                    points, nodes, levels, places, order, own, i + j, squares, neighbours, stack, bounds
                )
                largest = max(largest, square)
        reach = math.sqrt(largest)


@inlined
def _certain(ordered, kept, need, mask, limit):
    """Return how many of the sorted candidates may be among the nearest.

    0 where the radius is too short to say, and -1 where float32 is too coarse.
    """
    last = np.float64(float_of(ordered[need - 1] | mask))
    if last < COARSE:
        return -1
    bound = bits_of(may_be_as_near(last)) | mask
    if bound > limit:
        return 0 if limit == ONE else -1
    count = need
    while count < kept and ordered[count] <= bound:
        count += 1
    return count


@inlined
def _finish(points, found, ordered, count, mask, x, y, z, own, exact, near, squares, neighbours, target):
    """Sort the candidates by float64 distance and write them to a row of the result, without the place itself."""
    k = squares.shape[1]
    written = 0
    sorted_already = True
    before = -1.0
    for j in range(count):
        slot = np.uint32(ordered[j] & mask)
        row = found[slot >> np.uint32(4)] * BLOCK + (slot & np.uint32(15))
        here = np.uint64(row) * np.uint64(3)
        dx, dy, dz = points[here] - x, points[here + np.uint64(1)] - y, points[here + np.uint64(2)] - z
        square = (dx * dx + dy * dy) + dz * dz
        exact[written], near[written] = square, row
        if row != own:
            sorted_already &= square > before
            before = square
            written += 1
    if not sorted_already:
        for j in range(1, written):
            insert(exact, near, j, exact[j], near[j])
    for j in range(k):
        squares[target, j] = exact[j]
    for j in range(k):
        neighbours[target, j] = near[j]


@inner
def _tighten(keys, kept, need):
    """Keep only what may be among the nearest; on a surface the count grows like the squared radius."""
    limit = ONE
    trial = np.float32(1.0)
    while kept > 2 * need + LANES:
        trial = trial * np.float32(1.3) * np.float32(need) / np.float32(kept)
        below = 0
        while trial < np.float32(1.0):
            bound = bits_of(trial)
            below = 0
            for j in range(kept):
                below += 1 if keys[j] <= bound else 0
            if below >= need:
                break
            trial *= np.float32(1.4)
        if trial >= np.float32(1.0) or below == kept:
            break
        limit = bound
        last = kept
        kept = 0
        for j in range(last):
            key = keys[j]
            keys[kept] = key
            kept += 1 if key <= limit else 0
    return limit, kept
