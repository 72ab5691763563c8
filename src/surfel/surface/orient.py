"""Orientation: signs for normals that have none, spread from neighbour to neighbour, most certain pairs first."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel
from surfel.core.cast import Floats

NEIGHBOURS = 8
"""How many neighbours a sign is passed on to."""

UNSURE = 0.02
"""Share of contradicting neighbour pairs above which the signs are called ambiguous."""


class Orientation(NamedTuple):
    """Oriented normals (n, 3), the ``piece`` that each point belongs to (n,), and how sure the signs are.

    ``conflict`` is the share of neighbour pairs whose signs contradict each other.
    """

    normals: Floats
    piece: NDArray[np.int32]
    conflict: float

    @property
    def ambiguous(self) -> bool:
        """Whether too many pairs contradict each other for the signs to be believed."""
        return self.conflict > UNSURE


def orient(points: Floats, normals: Floats, neighbours: NDArray[np.int32]) -> Orientation:
    """Choose the sign of every normal so that neighbours agree and each piece points outward.

    Pairs of neighbours are joined in the order of how nearly their planes coincide (Kruskal's algorithm on the weights
    of Hoppe et al., *Surface reconstruction from unorganized points*, 1992, with the relative sign kept in the
    union-find tree). The point of a piece that is farthest from its centroid then points away from it.

    Parameters
    ----------
    points, normals : Floats, shape (n, 3)
        Coordinates and unit normals of either sign.
    neighbours : NDArray[np.int32], shape (n, k)
        Nearest neighbours, ascending by distance.

    Returns
    -------
    Orientation
        Signs are consistent inside a piece; a hollow inside a piece of its own points away from itself too.
    """
    n = len(points)
    k = min(NEIGHBOURS, neighbours.shape[1])
    first = np.repeat(np.arange(n, dtype=np.int32), k)
    second = np.ascontiguousarray(neighbours[:, :k]).ravel()
    cosine, apart = np.empty(len(first)), np.empty(len(first))
    _compare(points, normals, first, second, cosine, apart)
    parent, sign = np.arange(n, dtype=np.int32), np.ones(n, np.int8)
    _join(first, second, cosine, np.argsort(apart, kind="stable"), parent, sign)
    conflict = _contradictions(first, second, cosine, parent, sign) / max(len(first), 1)
    oriented = normals * sign[:, None]
    _, piece = np.unique(parent, return_inverse=True)
    count = np.bincount(piece)
    centre = np.stack([np.bincount(piece, points[:, x]) / count for x in range(3)], axis=1)
    offset = points - centre[piece]
    reach = np.einsum("ij,ij->i", offset, offset)
    farthest = np.zeros(len(count), np.int64)
    farthest[piece[np.argsort(reach, kind="stable")]] = np.argsort(reach, kind="stable")
    outward = np.einsum("ij,ij->i", offset[farthest], oriented[farthest]) >= 0.0
    oriented *= np.where(outward, 1.0, -1.0)[piece][:, None]
    return Orientation(oriented, piece.astype(np.int32), float(conflict))


@kernel
def _compare(points, normals, first, second, cosine, apart):
    """Write the cosine between the normals of each pair, past the step between them, and how far apart they are."""
    for e in range(len(first)):
        i, j = first[e], second[e]
        dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        square = dx * dx + dy * dy + dz * dz
        ai = dx * normals[i, 0] + dy * normals[i, 1] + dz * normals[i, 2]
        aj = dx * normals[j, 0] + dy * normals[j, 1] + dz * normals[j, 2]
        c = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
        # On a circle through both points the normal of j is that of i mirrored in the middle plane of the step.
        mirrored = c - 2.0 * ai * aj / square if square > 0.0 else c
        cosine[e] = mirrored
        apart[e] = 1.0 - abs(mirrored)


@kernel
def _root(parent, sign, i):
    """Return the root of i and the sign of i relative to it; shorten the way for the next time."""
    root, s = i, np.int8(1)
    while parent[root] != root:
        s *= sign[root]
        root = parent[root]
    total = s
    while parent[i] != root and i != root:
        up, step = parent[i], sign[i]
        parent[i], sign[i] = root, total
        total *= step
        i = up
    return root, s


@kernel
def _join(first, second, cosine, order, parent, sign):
    for e in order:
        a, sa = _root(parent, sign, first[e])
        b, sb = _root(parent, sign, second[e])
        if a != b:
            parent[b] = a
            sign[b] = sa * sb * (1 if cosine[e] >= 0.0 else -1)
    for i in range(len(parent)):
        a, s = _root(parent, sign, np.int32(i))
        parent[i], sign[i] = a, s if a != i else 1


@kernel
def _contradictions(first, second, cosine, parent, sign):
    count = 0
    for e in range(len(first)):
        if sign[first[e]] * sign[second[e]] * cosine[e] < 0.0:
            count += 1
    return count
