"""Points that keep apart: the elimination of crowded ones, and darts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel
from surfel.core.cast import Floats
from surfel.index.hilbert import hilbert_order
from surfel.shapes.hash_grid import (
    OPPOSED,
    bucket_of,
    cell_of,
    cosine_with,
    empty_grid,
    grid_of,
    insert,
    square_to,
    within_one,
)


def eliminate(points: Floats, normals: Floats, n: int, reach: float) -> NDArray[np.int32]:
    """Return the rows in the order in which they should be kept: the first ``n`` are those that elimination leaves.

    The most crowded point is taken away again and again (C. Yuksel, *Sample elimination for generating Poisson disk
    sample sets*, Computer Graphics Forum 34(2), 2015), crowded by its eq. (3): the sum of ``(1 - d / reach)^8`` over
    the points nearer than ``reach``.

    Parameters
    ----------
    points, normals : Floats, shape (m, 3)
        More points than are wanted, at random.
    n : int
        How many will be kept.
    reach : float
        The distance of ``n`` points that are as even as can be.
    """
    near = hilbert_order(points)  # neighbours lie near each other in memory: three times as fast
    points, normals = points[near], normals[near]
    grid = grid_of(points, reach)
    offsets, neighbours, weights = _neighbours(points, normals, reach, *grid)
    order: NDArray[np.int32] = near[_eliminate(offsets, neighbours, weights, n)]
    return order


def keep_apart(points: Floats, normals: Floats, order: NDArray[np.int32], n: int, distance: float) -> NDArray[np.int32]:
    """Return up to ``n`` rows in ``order``, each at least ``distance`` from those before it."""
    kept: NDArray[np.int32] = _throw(points, normals, order, n, distance, *empty_grid(len(points)))
    return kept


@kernel
def _neighbours(points, normals, reach, head, after):
    """Return the neighbours nearer than ``reach`` of each point as compressed rows, and how they crowd it."""
    n = len(points)
    offsets = np.zeros(n + 1, np.int64)
    neighbours = np.empty(24 * n + 64, np.int32)
    weights = np.empty(24 * n + 64, np.float32)
    count = 0
    for i in range(n):
        cx, cy, cz = cell_of(points, i, reach)
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-1, 2):
                    x, y, z = cx + dx, cy + dy, cz + dz
                    j = head[bucket_of(x, y, z, len(head))]
                    while j >= 0:
                        square = square_to(points, j, points[i, 0], points[i, 1], points[i, 2])
                        facing = cosine_with(normals, j, normals[i, 0], normals[i, 1], normals[i, 2]) > OPPOSED
                        # the cell is compared as well: two cells may share a bucket, and would be counted twice
                        if j != i and square < reach * reach and facing and cell_of(points, j, reach) == (x, y, z):
                            if count == len(neighbours):
                                neighbours = np.concatenate((neighbours, np.empty_like(neighbours)))
                                weights = np.concatenate((weights, np.empty_like(weights)))
                            neighbours[count] = j
                            weight = (1.0 - np.sqrt(square) / reach) ** 2
                            weights[count] = (weight * weight) * (weight * weight)
                            count += 1
                        j = after[j]
        offsets[i + 1] = count
    return offsets, neighbours[:count], weights[:count]


@kernel
def _eliminate(offsets, neighbours, weights, n):
    """Take the most crowded point off a heap until ``n`` are left; return those, then the others, last taken first."""
    total = len(offsets) - 1
    crowd = np.zeros(total)
    for i in range(total):
        for k in range(offsets[i], offsets[i + 1]):
            crowd[i] += weights[k]
    heap = np.arange(total).astype(np.int32)
    place = heap.copy()
    for start in range(total // 2 - 1, -1, -1):
        _sink(heap, place, crowd, start, total)
    order = np.empty(total, np.int32)
    for left in range(total, min(n, total), -1):
        worst = heap[0]
        order[left - 1] = worst
        heap[0] = heap[left - 1]
        place[heap[0]] = 0
        place[worst] = -1
        _sink(heap, place, crowd, 0, left - 1)
        for k in range(offsets[worst], offsets[worst + 1]):
            j = neighbours[k]
            if place[j] >= 0:
                crowd[j] -= weights[k]
                _sink(heap, place, crowd, place[j], left - 1)
    for i in range(min(n, total)):
        order[i] = heap[i]
    return order


@inlined
def _sink(heap, place, crowd, start, size):
    """Move an entry down until neither child is more crowded."""
    item = heap[start]
    at = start
    while 2 * at + 1 < size:
        child = 2 * at + 1
        if child + 1 < size and crowd[heap[child + 1]] > crowd[heap[child]]:
            child += 1
        if crowd[heap[child]] <= crowd[item]:
            break
        heap[at] = heap[child]
        place[heap[at]] = at
        at = child
    heap[at] = item
    place[item] = at


@kernel
def _throw(points, normals, order, n, distance, head, after):
    kept = np.empty(min(n, len(order)), np.int32)
    count = 0
    for k in range(len(order)):
        if count == len(kept):
            break
        i = order[k]
        here = points[i, 0], points[i, 1], points[i, 2]
        facing = normals[i, 0], normals[i, 1], normals[i, 2]
        if not within_one(points, normals, distance, head, after, here, here, here, here, facing):
            kept[count] = i
            count += 1
            insert(points, i, distance, head, after)
    return kept[:count]
