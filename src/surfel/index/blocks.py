"""Blocks of 16 sorted points under an implicit tree of boxes, eight children to a node."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, kernel, rows, threads_for
from surfel.core.cast import Floats
from surfel.index.simd import children_within

BLOCK = 16
WIDTH = 8


class Blocks(NamedTuple):
    """The points and boxes that searching kernels read, flat: a block and a node are 48 floats each.

    Parameters
    ----------
    points : Floats, shape (48 * blocks,)
        x, y, z of the sorted points; the rest of the last block is infinitely far away.
    nodes : Floats, shape (48 * nodes,)
        Low x of the eight children, low y, low z, high x, high y, high z; a missing child is infinitely far.
    levels : NDArray[np.int64], shape (levels + 1,)
        Where the nodes of each level start; the children of level 0 are blocks, the last level is the root.
    """

    points: Floats
    nodes: Floats
    levels: NDArray[np.int64]


def build_blocks(points: Floats, order: NDArray[np.int32], origin: Floats) -> Blocks:
    """Gather ``points[order] - origin`` into blocks and build the boxes above them."""
    count = -(-len(order) // BLOCK)
    starts = [0]
    width = count
    while width > 1 or len(starts) == 1:
        width = -(-width // WIDTH)
        starts.append(starts[-1] + width)
    levels = np.array(starts, dtype=np.int64)
    blocks = Blocks(np.empty(count * BLOCK * 3), np.empty(starts[-1] * 6 * WIDTH), levels)
    with threads_for(len(order)):
        _gather(starts[1], points, order, origin, blocks.points, blocks.nodes)
    _join_levels(blocks.nodes, levels)
    return blocks


@rows
def _gather(first, last, points, order, origin, target, nodes):
    n = len(order)
    padded = len(target) // 3
    x0, y0, z0 = origin[0], origin[1], origin[2]
    for node in range(first, last):
        for child in range(WIDTH):
            lx = ly = lz = np.inf
            hx = hy = hz = -np.inf
            start = (node * WIDTH + child) * BLOCK
            for i in range(start, min(start + BLOCK, n)):
                row = order[i]
                x, y, z = points[row, 0] - x0, points[row, 1] - y0, points[row, 2] - z0
                target[3 * i], target[3 * i + 1], target[3 * i + 2] = x, y, z
                lx, ly, lz = min(lx, x), min(ly, y), min(lz, z)
                hx, hy, hz = max(hx, x), max(hy, y), max(hz, z)
            for i in range(3 * max(start, n), 3 * min(start + BLOCK, padded)):
                target[i] = np.inf
            here = node * 48 + child
            nodes[here], nodes[here + 8], nodes[here + 16] = lx, ly, lz
            nodes[here + 24], nodes[here + 32], nodes[here + 40] = hx, hy, hz


@kernel
def _join_levels(nodes, levels):
    for level in range(1, len(levels) - 1):
        below = levels[level] - levels[level - 1]
        for node in range(levels[level + 1] - levels[level]):
            for child in range(WIDTH):
                there = node * WIDTH + child
                for side in range(3):
                    low, high = np.inf, -np.inf
                    if there < below:
                        source = (levels[level - 1] + there) * 48 + side * 8
                        for k in range(source, source + 8):
                            low, high = min(low, nodes[k]), max(high, nodes[k + 24])
                    here = (levels[level] + node) * 48 + side * 8 + child
                    nodes[here], nodes[here + 24] = low, high


@inlined
def collect(nodes, levels, lx, ly, lz, hx, hy, hz, square, found, spare):
    """Write the blocks within sqrt(square) of a box to ``found``, ascending; return how many, or -1 if they do not fit.

    Level by level: the nodes in reach of one level give those of the next. ``spare`` is as long as ``found``.
    """
    room = len(found) - WIDTH
    count = 1
    now, then = found, spare
    if (len(levels) & 1) == 0:  # one swap a level: the blocks shall end in found
        now, then = spare, found
    now[0] = 0
    for level in range(len(levels) - 2, -1, -1):
        kept = 0
        start = levels[level]
        for k in range(count):
            if kept > room:
                return -1
            node = now[k]
            kept = children_within(nodes, start + node, node * WIDTH, lx, ly, lz, hx, hy, hz, square, then, kept)
        now, then = then, now
        count = kept
    return count


@inner
def gather_group(places, order, first, stop, side):
    """Return how many of the next places fit a box of the given side, at least one, and that box."""
    row = order[first]
    lx = hx = places[row, 0]
    ly = hy = places[row, 1]
    lz = hz = places[row, 2]
    count = 1
    for i in range(first + 1, stop):
        row = order[i]
        x, y, z = places[row, 0], places[row, 1], places[row, 2]
        nlx, nly, nlz, nhx, nhy, nhz = min(lx, x), min(ly, y), min(lz, z), max(hx, x), max(hy, y), max(hz, z)
        if max(nhx - nlx, nhy - nly, nhz - nlz) > side:
            break
        lx, ly, lz, hx, hy, hz = nlx, nly, nlz, nhx, nhy, nhz
        count += 1
    return count, lx, ly, lz, hx, hy, hz
