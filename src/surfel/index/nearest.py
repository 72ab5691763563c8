"""The k nearest points of one place, exactly: the careful search behind the fast one."""

from __future__ import annotations

import numpy as np

from surfel._numba import inlined, inner
from surfel.index.blocks import BLOCK, WIDTH

STACK = 256  # eight entries a level; 2**31 points have ten levels


@inner
def nearest(points, nodes, levels, x, y, z, own, squares, rows, stack, bounds):
    """Fill ``squares`` and ``rows`` with the nearest rows other than ``own``, ascending; return the largest square.

    A branch is left when it cannot hold a nearer point than the k-th so far, so that crowds of equal points end at
    once. No step depends on a guess: it ends for every input. ``stack`` and ``bounds`` are scratch, ``STACK`` long.
    """
    last = len(squares) - 1
    for j in range(len(squares)):
        squares[j] = np.inf
        rows[j] = -1
    stack[0] = (len(levels) - 1) << 32  # the level above the children, then the place in that level; level 0 are blocks
    bounds[0] = -1.0
    height = 1
    while height > 0:
        height -= 1
        if bounds[height] >= squares[last]:
            continue
        level, place = stack[height] >> 32, stack[height] & 0xFFFFFFFF
        if level == 0:
            _visit(points, place * BLOCK, x, y, z, own, squares, rows)
            continue
        node = (levels[level - 1] + place) * 48
        base = height
        for child in range(WIDTH):
            gap = _gap(nodes, node + child, x, y, z)
            if gap >= squares[last]:
                continue
            spot = height
            while spot > base and bounds[spot - 1] < gap:  # the nearest ends on top
                stack[spot], bounds[spot] = stack[spot - 1], bounds[spot - 1]
                spot -= 1
            stack[spot], bounds[spot] = ((level - 1) << 32) | (place * WIDTH + child), gap
            height += 1
    return squares[last]


@inner
def nearest_of(points, nodes, levels, places, order, own, i, squares, neighbours, stack, bounds):
    """Search for place ``order[i]`` and write its row of a result as :func:`surfel.index.knn.search_nearest` does."""
    row = order[i]
    x, y, z = places[row, 0], places[row, 1], places[row, 2]
    target, skip = (i, row) if own else (row, -1)
    return nearest(points, nodes, levels, x, y, z, skip, squares[target], neighbours[target], stack, bounds)


@inlined
def _gap(nodes, here, x, y, z):
    """Return the squared distance from a place to the box of one child."""
    dx = max(max(nodes[here] - x, x - nodes[here + 24]), 0.0)
    dy = max(max(nodes[here + 8] - y, y - nodes[here + 32]), 0.0)
    dz = max(max(nodes[here + 16] - z, z - nodes[here + 40]), 0.0)
    return (dx * dx + dy * dy) + dz * dz


@inlined
def _visit(points, first, x, y, z, own, squares, rows):
    """Insert the points of one block that are nearer than the k-th so far."""
    last = len(squares) - 1
    for row in range(first, first + BLOCK):
        dx, dy, dz = points[3 * row] - x, points[3 * row + 1] - y, points[3 * row + 2] - z
        square = (dx * dx + dy * dy) + dz * dz
        if square < squares[last] and row != own:
            insert(squares, rows, last, square, np.int32(row))


@inlined
def insert(squares, rows, spot, square, row):
    """Move an entry down from ``spot`` to where it belongs, by square and then by row."""
    while spot > 0 and (squares[spot - 1] > square or (squares[spot - 1] == square and rows[spot - 1] > row)):
        squares[spot], rows[spot] = squares[spot - 1], rows[spot - 1]
        spot -= 1
    squares[spot], rows[spot] = square, row
