"""Points in a hashed grid of cells: who is near, and faces the same way.

Two points matter to each other only if their normals do not face away from each other, so that the two sides of a
thin plate are sampled each on its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel
from surfel.core.cast import Floats

OPPOSED = -0.5
"""The cosine below which two normals belong to different sides."""


def empty_grid(room: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the first row of each bucket and the row after each row, for up to ``room`` points: none yet."""
    return np.full(1 << max(4, (2 * room).bit_length()), np.int32(-1)), np.empty(room, np.int32)


def grid_of(points: Floats, cell: float) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the same with all points in it."""
    head, after = empty_grid(len(points))
    _insert_all(points, cell, head, after)
    return head, after


@inlined
def cell_of(points, i, cell):
    """Return the three whole numbers of the cell that a point lies in."""
    return (
        np.int64(np.floor(points[i, 0] / cell)),
        np.int64(np.floor(points[i, 1] / cell)),
        np.int64(np.floor(points[i, 2] / cell)),
    )


@inlined
def bucket_of(x, y, z, buckets):
    """Return the bucket of a cell; several cells may share it."""
    mixed = ((x * 0x1E3779B97F4A7C15 ^ y) * 0x3F58476D1CE4E5B9 ^ z) * 0x14D049BB133111EB
    return (mixed >> 32) & (buckets - 1)


@inlined
def insert(points, i, cell, head, after):
    """Put a point in front of the list of its bucket."""
    x, y, z = cell_of(points, i, cell)
    place = bucket_of(x, y, z, len(head))
    after[i] = head[place]
    head[place] = i


@kernel
def _insert_all(points, cell, head, after):
    for i in range(len(points)):
        insert(points, i, cell, head, after)


@inlined
def square_to(points, i, x, y, z):
    """Return the squared distance of a point from a place."""
    dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
    return dx * dx + dy * dy + dz * dz


@inlined
def cosine_with(normals, i, x, y, z):
    """Return the cosine between a normal and a direction."""
    return normals[i, 0] * x + normals[i, 1] * y + normals[i, 2] * z


@inlined
def within_one(points, normals, radius, head, after, middle, a, b, c, facing):
    """Tell whether a, b and c, near ``middle``, lie in the open ball of one point that faces their way."""
    limit = radius * radius
    cx, cy, cz = np.floor(middle[0] / radius), np.floor(middle[1] / radius), np.floor(middle[2] / radius)
    for dx in range(-1, 2):
        for dy in range(-1, 2):
            for dz in range(-1, 2):
                j = head[bucket_of(np.int64(cx) + dx, np.int64(cy) + dy, np.int64(cz) + dz, len(head))]
                while j >= 0:
                    far = max(square_to(points, j, a[0], a[1], a[2]), square_to(points, j, b[0], b[1], b[2]))
                    far = max(far, square_to(points, j, c[0], c[1], c[2]))
                    if far < limit and cosine_with(normals, j, facing[0], facing[1], facing[2]) > OPPOSED:
                        return True
                    j = after[j]
    return False
