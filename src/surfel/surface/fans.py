"""Fans: the triangles round each point that a line can cross, with their votes and their shares of the area.

Every cell comes with the triangles of its star. Neighbours mostly agree on them; where they do not, triangles overlap.
Nothing is stitched: a triangle counts by how many of its three corners voted for it, and its weight is what the cells
of its voters give to it, so that over many lines the weighted count has the sum of the cells as its limit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, kernel, rows, threads_for
from surfel._vec import tangent_frame
from surfel.core.cast import Floats

STAR = 16
"""Most triangles that a star keeps."""


class Fans(NamedTuple):
    """Triangles that overlap where the points disagree.

    ``vertices`` (v, 3); ``triangles`` (f, 3), rows of vertices; ``weights`` (f,): what a hit counts for the area;
    ``votes`` (f,): corners that agree on the triangle, 0 where it only carries the share of a lone point;
    ``owner`` (v,): the point of each vertex.
    """

    vertices: Floats
    triangles: NDArray[np.int32]
    weights: Floats
    votes: NDArray[np.int8]
    owner: NDArray[np.int32]


def build_fans(
    points: Floats, normals: Floats, areas: Floats, star: NDArray[np.int32], joined: NDArray[np.int32]
) -> Fans:
    """Collect the triangles of all stars, each once.

    Parameters
    ----------
    points, normals : Floats, shape (n, 3)
        Of the cloud.
    areas : Floats, shape (n,)
        What each point stands for.
    star : NDArray[np.int32], shape (n, s)
        Neighbours round each cell, in order, padded with -1.
    joined : NDArray[np.int32], shape (n,)
        Bit c: neighbours c and c + 1 make a triangle with the point.

    Returns
    -------
    Fans
        With ``sum(weights * area of triangles) == sum(areas)``.
    """
    n = len(points)
    share, mine = np.empty(n), np.empty(n, np.int32)
    with threads_for(n):
        _survey(n, points, areas, star, joined, share, mine)
        start = np.concatenate([[0], np.cumsum(mine, dtype=np.int64)])
        triangles, weights = np.empty((start[-1], 3), np.int32), np.empty(start[-1])
        votes = np.empty(start[-1], np.int8)
        _collect(n, star, joined, share, start, triangles, weights, votes)
    lone = np.flatnonzero((share == 0.0) & (areas > 0.0)).astype(np.int32)
    if not len(lone):
        return Fans(points, triangles, weights, votes, np.arange(n, dtype=np.int32))
    corners = np.empty((3 * len(lone), 3))
    _stand_alone(points, normals, areas, lone, corners)
    return Fans(
        np.concatenate([points, corners]),
        np.concatenate([triangles, n + np.arange(3 * len(lone), dtype=np.int32).reshape(-1, 3)]),
        np.concatenate([weights, np.ones(len(lone))]),
        np.concatenate([votes, np.zeros(len(lone), np.int8)]),
        np.concatenate([np.arange(n, dtype=np.int32), np.repeat(lone, 3)]),
    )


@inner
def _next(star, i, c):
    """Return the neighbour after the c-th round cell i."""
    if c + 1 < star.shape[1] and star[i, c + 1] >= 0:
        return star[i, c + 1]
    return star[i, 0]


@inner
def _votes_for(star, joined, i, j, k):
    """Tell whether the star of point i has the triangle (i, j, k), in either sense of rotation."""
    for c in range(star.shape[1]):
        first = star[i, c]
        if first < 0:
            return False
        if (first == j or first == k) and (joined[i] >> c) & 1:  # noqa: SIM109
            second = _next(star, np.int64(i), c)
            if (first == j and second == k) or (first == k and second == j):
                return True
    return False


@rows
def _survey(first, last, points, areas, star, joined, share, mine):
    """Find each point's ratio of its area to a third of its triangles', and how many triangles it is to list."""
    for i in range(first, last):
        total, count = 0.0, 0
        for c in range(star.shape[1]):
            j = star[i, c]
            if j < 0:
                break
            if not (joined[i] >> c) & 1:
                continue
            k = _next(star, i, c)
            ax, ay, az = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            bx, by, bz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
            x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            total += 0.5 * np.sqrt(x * x + y * y + z * z)
            first_voter = not (j < i and _votes_for(star, joined, j, i, k))
            if first_voter and not (k < i and _votes_for(star, joined, k, i, j)):
                count += 1
        mine[i] = count
        share[i] = areas[i] / (total / 3.0) if total > 0.0 else 0.0


@rows
def _collect(first, last, star, joined, share, start, triangles, weights, votes):
    for i in range(first, last):
        at = start[i]
        for c in range(star.shape[1]):
            j = star[i, c]
            if j < 0:
                break
            if not (joined[i] >> c) & 1:
                continue
            k = _next(star, i, c)
            by_j = _votes_for(star, joined, j, i, k)
            by_k = _votes_for(star, joined, k, i, j)
            if (by_j and j < i) or (by_k and k < i):
                continue
            triangles[at, 0], triangles[at, 1], triangles[at, 2] = i, j, k
            weight, count = share[i], 1
            if by_j:
                weight += share[j]
                count += 1
            if by_k:
                weight += share[k]
                count += 1
            weights[at] = weight / 3.0
            votes[at] = count
            at += 1


@kernel
def _stand_alone(points, normals, areas, lone, corners):
    """Give each lone point an equilateral triangle of its own area in its tangent plane."""
    for a in range(len(lone)):
        i = lone[a]
        e = tangent_frame(normals[i, 0], normals[i, 1], normals[i, 2])
        radius = np.sqrt(areas[i] * 4.0 / (3.0 * np.sqrt(3.0)))
        for b in range(3):
            s, t = radius * np.cos(2.0943951023931953 * b), radius * np.sin(2.0943951023931953 * b)
            for x in range(3):
                corners[3 * a + b, x] = points[i, x] + s * e[x] + t * e[3 + x]
