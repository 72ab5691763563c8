"""Orientation: signs for normals that have none, spread from neighbour to neighbour, most certain pairs first."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel, rows, threads_for
from surfel.core.cast import Floats

NEIGHBOURS = 8
"""How many neighbours a sign is passed on to."""

CERTAIN = 0.99
"""Cosine between the normals of a pair, past the step between them, from which on their order does not matter."""

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
    union-find tree); pairs that leave no doubt come first, unsorted. The point of a piece that is farthest from its
    centroid then points away from it.

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
    pairs = _pairs(np.ascontiguousarray(neighbours[:, :k]))
    cosine = np.empty(len(pairs))
    with threads_for(len(pairs)):
        _compare(len(pairs), points, normals, pairs, cosine)
    parent, sign = np.arange(n, dtype=np.int32), np.ones(n, np.int8)
    open_pairs = _join_certain(pairs, cosine, parent, sign)
    order = np.argsort(-np.abs(cosine[open_pairs]), kind="stable")
    _join(pairs, cosine, open_pairs[order], parent, sign)
    conflict = _contradictions(pairs, cosine, parent, sign) / max(len(pairs), 1)
    is_root = parent == np.arange(n)
    piece = (np.cumsum(is_root, dtype=np.int32) - 1)[parent]
    oriented = normals * sign[:, None]
    _turn_outward(points, piece, int(np.count_nonzero(is_root)), oriented)
    return Orientation(oriented, piece, float(conflict))


@kernel
def _pairs(neighbours):
    """List each pair of neighbours once: from its first point, or from the only one that counts the other in."""
    n, k = neighbours.shape
    pairs = np.empty((n * k, 2), np.int32)
    count = 0
    for i in range(n):
        for a in range(k):
            j = neighbours[i, a]
            told = False
            if j < i:
                for b in range(k):
                    told |= neighbours[j, b] == i
            if not told:
                pairs[count, 0], pairs[count, 1] = i, j
                count += 1
    return pairs[:count].copy()


@rows
def _compare(start, stop, points, normals, pairs, cosine):
    """Write the cosine between the normals of each pair, past the step between them."""
    for e in range(start, stop):
        i, j = pairs[e, 0], pairs[e, 1]
        dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        square = dx * dx + dy * dy + dz * dz
        ai = dx * normals[i, 0] + dy * normals[i, 1] + dz * normals[i, 2]
        aj = dx * normals[j, 0] + dy * normals[j, 1] + dz * normals[j, 2]
        c = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
        # On a circle through both points the normal of j is that of i mirrored in the middle plane of the step.
        cosine[e] = c - 2.0 * ai * aj / square if square > 0.0 else c


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
def _unite(parent, sign, i, j, cosine):
    """Join the trees of two points; tell whether they were two."""
    a, sa = _root(parent, sign, i)
    b, sb = _root(parent, sign, j)
    if a != b:
        parent[b] = a
        sign[b] = sa * sb * (1 if cosine >= 0.0 else -1)
    return a != b


@kernel
def _join_certain(pairs, cosine, parent, sign):
    """Join the pairs that leave no doubt, as they come; return those that are still apart."""
    for e in range(len(pairs)):
        if abs(cosine[e]) >= CERTAIN:
            _unite(parent, sign, pairs[e, 0], pairs[e, 1], cosine[e])
    apart = np.empty(len(pairs), np.int64)
    count = 0
    for e in range(len(pairs)):
        if abs(cosine[e]) < CERTAIN and _root(parent, sign, pairs[e, 0])[0] != _root(parent, sign, pairs[e, 1])[0]:
            apart[count] = e
            count += 1
    return apart[:count].copy()


@kernel
def _join(pairs, cosine, order, parent, sign):
    for e in order:
        _unite(parent, sign, pairs[e, 0], pairs[e, 1], cosine[e])
    for i in range(len(parent)):
        a, s = _root(parent, sign, np.int32(i))
        parent[i], sign[i] = a, s if a != i else 1


@kernel
def _contradictions(pairs, cosine, parent, sign):
    count = 0
    for e in range(len(pairs)):
        if sign[pairs[e, 0]] * sign[pairs[e, 1]] * cosine[e] < 0.0:
            count += 1
    return count


@kernel
def _turn_outward(points, piece, pieces, oriented):
    """Turn each piece so that the normal of the point farthest from its centroid points away from there."""
    centre, count = np.zeros((pieces, 3)), np.zeros(pieces)
    for i in range(len(points)):
        p = piece[i]
        count[p] += 1.0
        for x in range(3):
            centre[p, x] += (points[i, x] - centre[p, x]) / count[p]
    reach, outward = np.full(pieces, -1.0), np.ones(pieces)
    for i in range(len(points)):
        p = piece[i]
        dx, dy, dz = points[i, 0] - centre[p, 0], points[i, 1] - centre[p, 1], points[i, 2] - centre[p, 2]
        square = dx * dx + dy * dy + dz * dz
        if square >= reach[p]:
            reach[p] = square
            away = dx * oriented[i, 0] + dy * oriented[i, 1] + dz * oriented[i, 2]
            outward[p] = 1.0 if away >= 0.0 else -1.0
    for i in range(len(points)):
        for x in range(3):
            oriented[i, x] *= outward[piece[i]]
