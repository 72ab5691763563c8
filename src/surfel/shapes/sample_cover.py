"""Points that cover: added until all of each triangle lies near one that faces its way."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel
from surfel.core.cast import Floats
from surfel.shapes.hash_grid import empty_grid, insert, within_one

_SMALLEST = 1e-3  # pieces of triangles are not divided below this share of the radius


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
            corners, face_normals, radius, start, points, normals, triangles, count, *empty_grid(room)
        )
        points, normals, triangles = points[:count], normals[:count], triangles[:count]
        if start == len(corners):
            return points, normals, triangles


def _with_room(array: NDArray[Any], rows: int) -> NDArray[Any]:
    wider = np.empty((rows, *array.shape[1:]), array.dtype)
    wider[: len(array)] = array
    return wider


@kernel
def _cover(corners, face_normals, radius, start, points, normals, triangles, count, head, after):
    """Cover triangles from ``start`` on; return the first that found no room, and the number of points."""
    for i in range(count):
        insert(points, i, radius, head, after)
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
            if within_one(points, normals, radius, head, after, m, a, b, c, facing):
                continue
            ab, bc, ca = _gap(a, b), _gap(b, c), _gap(c, a)
            tiny = max(max(ab, bc), ca) < (_SMALLEST * radius) ** 2
            if tiny or not within_one(points, normals, radius, head, after, m, m, m, m, facing):
                if count == len(points):
                    return face, count
                for axis in range(3):
                    points[count, axis] = m[axis]
                    normals[count, axis] = facing[axis]
                triangles[count] = face
                insert(points, count, radius, head, after)
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
