"""The one nearest point of many places: places that lie together share one walk, and nothing is sorted.

The search for k of them (:mod:`surfel.index.knn`) lists whoever may be among the k and sorts the list. For the nearest
alone the two smallest keys will do: where rounding may have swapped them, the place is searched for alone.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, rows, threads_for
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
from surfel.index.least import two_least
from surfel.index.nearest import STACK, nearest_of
from surfel.index.simd import bits_of, float_of

_SLACK, _FORGET = 1.2, 0.9  # the distance to the nearest differs much from place to place: a radius shrinks slowly
_AWAY = np.float32(1e18)  # its square is a float32


def search_one(
    blocks: Blocks, places: Floats, order: NDArray[np.int32], own: bool, squares: Floats, neighbours: NDArray[np.int32]
) -> None:
    """Do what :func:`surfel.index.knn.search_nearest` does, for k = 1."""
    with threads_for(15 * len(order)):  # a search is heavier than the items that the threshold is meant for
        _search_chunks(-(-len(order) // CHUNK), *blocks, places, order, own, squares, neighbours)


@rows
def _search_chunks(first, last, points, nodes, levels, places, order, own, squares, neighbours):
    m = len(order)
    slots = (ROOM + WIDTH) * BLOCK
    stack, bounds = np.empty(STACK, np.int64), np.empty(STACK)
    found, spare = np.empty(ROOM + WIDTH, np.int32), np.empty(ROOM + WIDTH, np.int32)
    xs, ys, zs = np.empty(slots, np.float32), np.empty(slots, np.float32), np.empty(slots, np.float32)
    for i in range(first * CHUNK, min(last * CHUNK, m)):
        if i % CHUNK == 0:
            reach = -1.0  # nothing learnt yet
            done = i
        if i < done:
            continue
        if not reach > 0.0:  # or a place where a point lies
            reach = math.sqrt(
                nearest_of(points, nodes, levels, places, order, own, i, squares, neighbours, stack, bounds)
            )
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
                if own:
                    slot = _slot_of(found, collected, row)
                    mine, xs[slot] = xs[slot], _AWAY
                    least, second = two_least(xs, ys, zs, collected * BLOCK, x, y, z, mask)
                    xs[slot] = mine
                else:
                    least, second = two_least(xs, ys, zs, collected * BLOCK, x, y, z, mask)
                if least > ONE:
                    continue
                square = np.float64(float_of(least | mask))
                bound = bits_of(may_be_as_near(square)) | mask
                if square >= COARSE and bound > ONE:
                    continue
                todo &= ~(1 << j)
                if square < COARSE or second <= bound:
                    alone |= 1 << j
                    continue
                slot = np.int64(least & mask)
                near = np.int64(found[slot // BLOCK]) * BLOCK + slot % BLOCK
                dx, dy, dz = points[3 * near] - px, points[3 * near + 1] - py, points[3 * near + 2] - pz
                square = (dx * dx + dy * dy) + dz * dz
                target = i + j if own else row
                squares[target, 0], neighbours[target, 0] = square, near
                largest = max(largest, square)
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
        reach = max(math.sqrt(largest), _FORGET * reach)


@inlined
def _slot_of(found, collected, row):
    """Return the slot of a row whose block is among those found."""
    slot = 0
    for k in range(collected):
        if found[k] == row // BLOCK:
            slot = k * BLOCK + row % BLOCK
    return slot
