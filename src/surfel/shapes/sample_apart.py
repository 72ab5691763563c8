"""Points that keep apart: the elimination of crowded ones, darts, and the proof that all of a surface is covered.

Two points matter to each other only if their normals do not face away from each other, so that the two sides of a
thin plate are sampled each on its own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel
from surfel.core.cast import Floats
from surfel.index.hilbert import hilbert_order

_OPPOSED = -0.5  # the cosine below which two normals belong to different sides
_SMALLEST = 1e-3  # pieces of triangles are not divided below this share of the radius


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
    grid = _grid(points, reach)
    offsets, neighbours, weights = _neighbours(points, normals, reach, *grid)
    order: NDArray[np.int32] = near[_eliminate(offsets, neighbours, weights, n)]
    return order


def keep_apart(points: Floats, normals: Floats, order: NDArray[np.int32], n: int, distance: float) -> NDArray[np.int32]:
    """Return up to ``n`` rows in ``order``, each at least ``distance`` from those before it."""
    kept: NDArray[np.int32] = _throw(points, normals, order, n, distance, *_empty_grid(len(points)))
    return kept


def cover(
    corners: Floats, face_normals: Floats, points: Floats, normals: Floats, triangles: NDArray[np.int32], radius: float
) -> tuple[Floats, Floats, NDArray[np.int32]]:
    """Add points until all of each triangle lies within ``radius`` of a point that faces its way.

    A triangle within the ball of one point is covered. Another is halved until its pieces are, and where the middle
    of a piece lies in no ball, that middle becomes a point.

    Parameters
    ----------
    corners : Floats, shape (f, 3, 3)
        The triangles; those whose normal is zero are left out.
    face_normals : Floats, shape (f, 3)
        Their unit normals.
    points, normals, triangles : arrays of m rows
        What is there so far.
    radius : float
        Positive.
    """
    start = 0
    while True:
        room = len(points) + len(points) // 4 + 1024
        points, normals, triangles, count = (*(_with_room(a, room) for a in (points, normals, triangles)), len(points))
        start, count = _cover(
            corners, face_normals, radius, start, points, normals, triangles, count, *_empty_grid(room)
        )
        points, normals, triangles = points[:count], normals[:count], triangles[:count]
        if start == len(corners):
            return points, normals, triangles


def _with_room(array: NDArray[Any], rows: int) -> NDArray[Any]:
    wider = np.empty((rows, *array.shape[1:]), array.dtype)
    wider[: len(array)] = array
    return wider


def _empty_grid(room: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    return np.full(1 << max(4, (2 * room).bit_length()), np.int32(-1)), np.empty(room, np.int32)


def _grid(points: Floats, cell: float) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    head, after = _empty_grid(len(points))
    _insert_all(points, cell, head, after)
    return head, after


@inlined
def _cell_of(points, i, cell):
    return (
        np.int64(np.floor(points[i, 0] / cell)),
        np.int64(np.floor(points[i, 1] / cell)),
        np.int64(np.floor(points[i, 2] / cell)),
    )


@inlined
def _bucket(x, y, z, buckets):
    mixed = ((x * 0x1E3779B97F4A7C15 ^ y) * 0x3F58476D1CE4E5B9 ^ z) * 0x14D049BB133111EB
    return (mixed >> 32) & (buckets - 1)


@inlined
def _insert(points, i, cell, head, after):
    """Put a point in front of the list of its bucket."""
    x, y, z = _cell_of(points, i, cell)
    place = _bucket(x, y, z, len(head))
    after[i] = head[place]
    head[place] = i


@kernel
def _insert_all(points, cell, head, after):
    for i in range(len(points)):
        _insert(points, i, cell, head, after)


@inlined
def _square(points, i, x, y, z):
    dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
    return dx * dx + dy * dy + dz * dz


@inlined
def _cosine(normals, i, x, y, z):
    return normals[i, 0] * x + normals[i, 1] * y + normals[i, 2] * z


@kernel
def _neighbours(points, normals, reach, head, after):
    """Return the neighbours nearer than ``reach`` of each point as compressed rows, and how they crowd it."""
    n = len(points)
    offsets = np.zeros(n + 1, np.int64)
    neighbours = np.empty(24 * n + 64, np.int32)
    weights = np.empty(24 * n + 64, np.float32)
    count = 0
    for i in range(n):
        cx, cy, cz = _cell_of(points, i, reach)
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-1, 2):
                    x, y, z = cx + dx, cy + dy, cz + dz
                    j = head[_bucket(x, y, z, len(head))]
                    while j >= 0:
                        square = _square(points, j, points[i, 0], points[i, 1], points[i, 2])
                        facing = _cosine(normals, j, normals[i, 0], normals[i, 1], normals[i, 2]) > _OPPOSED
                        # the cell is compared as well: two cells may share a bucket, and would be counted twice
                        if j != i and square < reach * reach and facing and _cell_of(points, j, reach) == (x, y, z):
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
        if not _within_one(points, normals, distance, head, after, here, here, here, here, facing):
            kept[count] = i
            count += 1
            _insert(points, i, distance, head, after)
    return kept[:count]


@inlined
def _within_one(points, normals, radius, head, after, middle, a, b, c, facing):
    """Tell whether a, b and c, near ``middle``, lie in the open ball of one point that faces their way."""
    limit = radius * radius
    cx, cy, cz = np.floor(middle[0] / radius), np.floor(middle[1] / radius), np.floor(middle[2] / radius)
    for dx in range(-1, 2):
        for dy in range(-1, 2):
            for dz in range(-1, 2):
                j = head[_bucket(np.int64(cx) + dx, np.int64(cy) + dy, np.int64(cz) + dz, len(head))]
                while j >= 0:
                    far = max(_square(points, j, a[0], a[1], a[2]), _square(points, j, b[0], b[1], b[2]))
                    far = max(far, _square(points, j, c[0], c[1], c[2]))
                    if far < limit and _cosine(normals, j, facing[0], facing[1], facing[2]) > _OPPOSED:
                        return True
                    j = after[j]
    return False


@kernel
def _cover(corners, face_normals, radius, start, points, normals, triangles, count, head, after):
    """Cover triangles from ``start`` on; return the first that found no room, and the number of points."""
    for i in range(count):
        _insert(points, i, radius, head, after)
    pieces = np.empty((256, 3, 3))
    for face in range(start, len(corners)):
        facing = face_normals[face, 0], face_normals[face, 1], face_normals[face, 2]
        if facing == (0.0, 0.0, 0.0):
            continue
        pieces[0] = corners[face]
        left = 1
        while left > 0:
            left -= 1
            a = pieces[left, 0, 0], pieces[left, 0, 1], pieces[left, 0, 2]
            b = pieces[left, 1, 0], pieces[left, 1, 1], pieces[left, 1, 2]
            c = pieces[left, 2, 0], pieces[left, 2, 1], pieces[left, 2, 2]
            m = (a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0, (a[2] + b[2] + c[2]) / 3.0
            if _within_one(points, normals, radius, head, after, m, a, b, c, facing):
                continue
            ab, bc, ca = _gap(a, b), _gap(b, c), _gap(c, a)
            tiny = max(max(ab, bc), ca) < (_SMALLEST * radius) ** 2
            if tiny or not _within_one(points, normals, radius, head, after, m, m, m, m, facing):
                if count == len(points):
                    return face, count
                for axis in range(3):
                    points[count, axis] = m[axis]
                    normals[count, axis] = facing[axis]
                triangles[count] = face
                _insert(points, count, radius, head, after)
                count += 1
            if not tiny:
                _halve(pieces, left, ab, bc, ca)
                left += 2
    return len(corners), count


@inlined
def _gap(a, b):
    dx, dy, dz = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return dx * dx + dy * dy + dz * dz


@inlined
def _halve(pieces, left, ab, bc, ca):
    """Replace a piece by its halves, cut across its longest edge."""
    first = 0 if ab >= bc and ab >= ca else (1 if bc >= ca else 2)
    second, third = (first + 1) % 3, (first + 2) % 3
    for axis in range(3):
        p, q, r = pieces[left, first, axis], pieces[left, second, axis], pieces[left, third, axis]
        middle = 0.5 * (p + q)
        pieces[left, 0, axis], pieces[left, 1, axis], pieces[left, 2, axis] = p, middle, r
        pieces[left + 1, 0, axis], pieces[left + 1, 1, axis], pieces[left + 1, 2, axis] = middle, q, r
