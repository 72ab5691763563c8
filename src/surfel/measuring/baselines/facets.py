"""Faceting one small box: tetrahedra, points on their edges by bisection, polygons cut by each other's functions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner
from surfel._vec import cross, norm
from surfel.core.cast import Floats
from surfel.measuring.baselines.functions import PLANE, value_at
from surfel.measuring.baselines.implicit import AND

MOST_FUNCTIONS = 12
_PIECES = 64
_CORNERS = 4 + MOST_FUNCTIONS
_HALVINGS = 40

TETRAHEDRA = np.array(
    [[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]], np.int64
)  # fmt: skip
"""Six tetrahedra that fill a box; corner k has its high side along x, y, z where bit 0, 1, 2 of k is set."""


class Scratch(NamedTuple):
    """What faceting writes to: pieces of polygons, their corners, and what is known of each."""

    corners: Floats  # (pieces, corners, 3)
    sizes: NDArray[np.int64]  # (pieces,)
    inside: NDArray[np.bool_]  # (pieces, functions)
    bits: NDArray[np.bool_]  # (functions,): of all functions of the tree
    stack: NDArray[np.bool_]
    values: Floats  # (functions here, 8)
    box: Floats  # (8, 3)
    cut: Floats  # (corners,)
    spare: Floats  # (corners, 3)

    @classmethod
    def of(cls, functions: int, tokens: int) -> Scratch:
        """Allocate for a tree with so many functions and tokens."""
        return cls(
            corners=np.empty((_PIECES, _CORNERS, 3)),
            sizes=np.empty(_PIECES, np.int64),
            inside=np.empty((_PIECES, MOST_FUNCTIONS), np.bool_),
            bits=np.zeros(functions, np.bool_),
            stack=np.empty(tokens + 1, np.bool_),
            values=np.empty((MOST_FUNCTIONS, 8)),
            box=np.empty((8, 3)),
            cut=np.empty(_CORNERS),
            spare=np.empty((_CORNERS, 3)),
        )


@inner
def facet_box(functions, tokens, size, here, count, x, y, z, hx, hy, hz, tetrahedra, s):
    """Return the area of the surface in a box and how many facets it took.

    ``here[:count]`` are the functions that matter, ``tokens[:size]`` the expression over them.
    """
    for k in range(8):
        s.box[k, 0] = x + hx if k & 1 else x - hx
        s.box[k, 1] = y + hy if k & 2 else y - hy
        s.box[k, 2] = z + hz if k & 4 else z - hz
    for i in range(count):
        for k in range(8):
            s.values[i, k] = value_at(functions[here[i]], s.box[k, 0], s.box[k, 1], s.box[k, 2])
    area, facets = 0.0, 0
    for t in range(len(tetrahedra)):
        for i in range(count):
            pieces = _polygon(functions[here[i]], i, tetrahedra[t], s)
            if pieces == 0:
                continue
            for j in range(count):
                if j != i:
                    pieces = _split_all(functions[here[j]], j, pieces, s)
            for p in range(pieces):
                if _survives(tokens, size, here, count, i, p, s):
                    area += _area(s.corners[p], s.sizes[p])
                    facets += 1
    return area, facets


@inner
def _polygon(row, i, tetrahedron, s):
    """Write where a function's zero cuts a tetrahedron, as piece 0; tell how many pieces there are: 0 or 1."""
    inside = 0
    for k in range(4):
        if s.values[i, tetrahedron[k]] < 0.0:
            inside += 1
    if inside == 0 or inside == 4:
        return 0
    lone = inside != 3  # whether the smaller side is the inner one
    corner = 0
    if inside == 2:
        a = b = c = d = -1
        for k in range(4):
            if s.values[i, tetrahedron[k]] < 0.0:
                a, b = tetrahedron[k], a
            else:
                c, d = tetrahedron[k], c
        _edge_point(row, i, a, c, 0, s)
        _edge_point(row, i, a, d, 1, s)
        _edge_point(row, i, b, d, 2, s)
        _edge_point(row, i, b, c, 3, s)
        corner = 4
    else:
        tip = -1
        for k in range(4):
            if (s.values[i, tetrahedron[k]] < 0.0) == lone:
                tip = tetrahedron[k]
        for k in range(4):
            if tetrahedron[k] != tip:
                _edge_point(row, i, tip, tetrahedron[k], corner, s)
                corner += 1
    s.sizes[0] = corner
    return 1


@inner
def _edge_point(row, i, a, b, corner, s):
    share = _zero_between(
        row, s.box[a, 0], s.box[a, 1], s.box[a, 2], s.values[i, a],
        s.box[b, 0], s.box[b, 1], s.box[b, 2], s.values[i, b],
    )  # fmt: skip
    for k in range(3):
        s.corners[0, corner, k] = s.box[a, k] + share * (s.box[b, k] - s.box[a, k])


@inner
def _zero_between(row, ax, ay, az, at_a, bx, by, bz, at_b):
    """Return where between a (0) and b (1) a function changes its sign: linear for a plane, else by bisection."""
    if row[0] == PLANE:
        return at_a / (at_a - at_b)
    low, high, inside = 0.0, 1.0, at_a < 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        value = value_at(row, ax + middle * (bx - ax), ay + middle * (by - ay), az + middle * (bz - az))
        if (value < 0.0) == inside:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@inner
def _split_all(row, j, pieces, s):
    """Cut every piece by another function and note on which side each part lies; return how many parts there are."""
    before = pieces
    for p in range(before):
        size, inside = s.sizes[p], 0
        for k in range(size):
            s.cut[k] = value_at(row, s.corners[p, k, 0], s.corners[p, k, 1], s.corners[p, k, 2])
            if s.cut[k] < 0.0:
                inside += 1
        if 0 < inside < size and pieces < _PIECES:
            _split(row, p, pieces, s)
            for k in range(MOST_FUNCTIONS):
                s.inside[pieces, k] = s.inside[p, k]
            s.inside[p, j], s.inside[pieces, j] = True, False
            pieces += 1
        else:
            s.inside[p, j] = 2 * inside > size
    return pieces


@inner
def _split(row, p, new, s):
    """Cut piece p: its inner part stays, its outer part becomes piece ``new``."""
    size, kept, cut_off = s.sizes[p], 0, 0
    for k in range(size):
        after = k + 1 if k + 1 < size else 0
        inside = s.cut[k] < 0.0
        for axis in range(3):
            if inside:
                s.spare[kept, axis] = s.corners[p, k, axis]
            else:
                s.corners[new, cut_off, axis] = s.corners[p, k, axis]
        kept += inside
        cut_off += not inside
        if inside != (s.cut[after] < 0.0):
            share = _zero_between(
                row, s.corners[p, k, 0], s.corners[p, k, 1], s.corners[p, k, 2], s.cut[k],
                s.corners[p, after, 0], s.corners[p, after, 1], s.corners[p, after, 2], s.cut[after],
            )  # fmt: skip
            for axis in range(3):
                start = s.corners[p, k, axis]
                s.spare[kept, axis] = start + share * (s.corners[p, after, axis] - start)
                s.corners[new, cut_off, axis] = s.spare[kept, axis]
            kept += 1
            cut_off += 1
    for k in range(kept):
        for axis in range(3):
            s.corners[p, k, axis] = s.spare[k, axis]
    s.sizes[p], s.sizes[new] = kept, cut_off


@inner
def _survives(tokens, size, here, count, i, p, s):
    """Tell whether the tree differs between the two sides of function i at a piece."""
    for j in range(count):
        s.bits[here[j]] = s.inside[p, j]
    s.bits[here[i]] = False
    outside = _holds(tokens, size, s)
    s.bits[here[i]] = True
    return _holds(tokens, size, s) != outside


@inner
def _holds(tokens, size, s):
    """Evaluate the expression for the bits of the functions."""
    top = -1
    for k in range(size):
        token = tokens[k]
        if token >= 0:
            top += 1
            s.stack[top] = s.bits[token >> 1] != ((token & 1) == 1)
        else:
            top -= 1
            if token == AND:
                s.stack[top] = s.stack[top] and s.stack[top + 1]
            else:
                s.stack[top] = s.stack[top] or s.stack[top + 1]
    return s.stack[0]


@inlined
def _area(corners, size):
    """Return the area of a polygon that is nearly flat: half the length of the sum of its cross products."""
    ax, ay, az = 0.0, 0.0, 0.0
    for k in range(1, size - 1):
        u, v, w = cross(
            corners[k, 0] - corners[0, 0], corners[k, 1] - corners[0, 1], corners[k, 2] - corners[0, 2],
            corners[k + 1, 0] - corners[0, 0], corners[k + 1, 1] - corners[0, 1], corners[k + 1, 2] - corners[0, 2],
        )  # fmt: skip
        ax, ay, az = ax + u, ay + v, az + w
    return 0.5 * norm(ax, ay, az)
