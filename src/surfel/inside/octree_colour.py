"""Colouring an octree as published: level by level (sec. 6.1 of Gaal) and by flood fill (sec. 6.2).

Both take the nodes that hold the *centres* of surfels for the border, and both leak for that. Once leaves are smaller
than one and a half spacings (two and a half where surfels lie at random), there are border cells without a centre. The
flood fill passes through them and gives whole components the colour of whichever seed came first: 25 to 40 % of the
places are wrong. Level by level an empty cell asks its neighbour alone, which errs less, but on thin plates and at
edges. :mod:`surfel.inside.grid` does neither; these are kept to compare with, and to teach.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, kernel
from surfel.inside.grid import BORDER, IN, OUT
from surfel.inside.octree import Octree
from surfel.inside.operand import Operand

UNKNOWN = 3
"""Colour of nodes that the method leaves without one; a judge decides there."""


def colour_per_level(tree: Octree, operand: Operand) -> NDArray[np.int8]:
    """Colour the nodes level by level, from the leaves to the root (Gaal, sec. 6.1, after Adams and Dutre).

    Nodes with surfels are border. An empty node takes the side that the nearest surfel of a neighbour with surfels
    shows to it, (c_n - c_c) . n_s > 0 meaning inside; one without such a neighbour takes a neighbour's colour.
    Neighbours are the three siblings face to face.

    Returns
    -------
    NDArray[np.int8], shape (m,)
        OUT, IN or BORDER for each node.
    """
    colours = _start(tree)
    _colour_levels(*tree, operand.points, operand.normals, colours)
    return colours


def colour_by_flood(tree: Octree, operand: Operand, every_face: bool = False) -> NDArray[np.int8]:
    """Colour the leaves by flood fill from seeds beside the border (Gaal, sec. 6.2).

    A seed is an empty leaf without a colour that has a border leaf for a neighbour; the nearest surfel of that
    colours it, and the colour spreads to all empty leaves that are reached through faces.

    Parameters
    ----------
    tree : Octree
        The nodes.
    operand : Operand
        The cloud that the tree was built for.
    every_face : bool
        Look for neighbours at every finest cell of each face, not at its middle alone, as the paper suggests; then no
        small leaf beside a large one is missed.

    Returns
    -------
    NDArray[np.int8], shape (m,)
        OUT, IN or BORDER for each leaf, UNKNOWN where no seed's flood came, and for nodes that are no leaves.
    """
    colours = _start(tree)
    _flood(*tree, operand.points, operand.normals, colours, bool(every_face))
    return colours


def _start(tree: Octree) -> NDArray[np.int8]:
    return np.where(tree.last > tree.first, BORDER, UNKNOWN).astype(np.int8)


@inner
def _nearest_normal(row, first, last, points, normals, x, y, z):
    """Return the surfel of a node that is nearest to a place."""
    best, least = row[first], np.inf
    for n in range(first, last):
        i = row[n]
        dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
        square = dx * dx + dy * dy + dz * dz
        if square < least:
            least, best = square, i
    return best


@kernel
def _colour_levels(low, size, depth, row, first, last, child, level, cell, points, normals, colours):
    for node in range(len(child) - 1, -1, -1):
        if child[node] < 0:
            continue
        base = child[node]
        side = size / 2.0 ** level[base]
        left = 0
        for octant in range(8):
            here = base + octant
            if colours[here] != UNKNOWN:
                continue
            beside = -1
            for axis in range(3):
                other = base + (octant ^ (1 << axis))
                if last[other] > first[other]:
                    beside = other
                    break
            if beside < 0:
                left += 1
                continue
            x, y, z = (
                low[0] + (cell[here, 0] + 0.5) * side,
                low[1] + (cell[here, 1] + 0.5) * side,
                low[2] + (cell[here, 2] + 0.5) * side,
            )
            s = _nearest_normal(row, first[beside], last[beside], points, normals, x, y, z)
            toward = 0.0
            for axis in range(3):
                toward += (cell[beside, axis] - cell[here, axis]) * normals[s, axis]
            colours[here] = IN if toward > 0.0 else OUT
        while left > 0:
            before = left
            for octant in range(8):
                here = base + octant
                if colours[here] != UNKNOWN:
                    continue
                for axis in range(3):
                    other = base + (octant ^ (1 << axis))
                    if colours[other] < BORDER:
                        colours[here] = colours[other]
                        left -= 1
                        break
            if left == before:
                break


@inlined
def leaf_at(child, level, depth, i, j, k):
    """Return the leaf that holds a cell of the deepest level."""
    node = 0
    while child[node] >= 0:
        shift = depth - 1 - level[node]
        node = child[node] + ((((i >> shift) & 1) << 2) | (((j >> shift) & 1) << 1) | ((k >> shift) & 1))
    return node


@inlined
def _beyond(face, i, j, k, width, u, v):
    """Return the deepest cell beyond a face of a node at its corner i, j, k, at offset u, v along the face."""
    axis, far = face >> 1, face & 1
    out = width if far else -1
    if axis == 0:
        return i + out, j + u, k + v
    if axis == 1:
        return i + u, j + out, k + v
    return i + u, j + v, k + out


@kernel
def _flood(low, size, depth, row, first, last, child, level, cell, points, normals, colours, every_face):
    count = 1 << depth
    step = size / count
    queue = np.empty(len(child), np.int64)
    for seed in range(len(child)):
        if child[seed] >= 0 or colours[seed] != UNKNOWN:
            continue
        width = 1 << (depth - level[seed])
        i, j, k = cell[seed, 0] * width, cell[seed, 1] * width, cell[seed, 2] * width
        beside = -1
        for face in range(6):
            a, b, c = _beyond(face, i, j, k, width, width >> 1, width >> 1)
            if min(min(a, b), c) < 0 or max(max(a, b), c) >= count:
                continue
            other = leaf_at(child, level, depth, a, b, c)
            if colours[other] == BORDER:
                beside = other
                break
        if beside < 0:
            continue
        x, y, z = (
            low[0] + (i + 0.5 * width) * step,
            low[1] + (j + 0.5 * width) * step,
            low[2] + (k + 0.5 * width) * step,
        )
        s = _nearest_normal(row, first[beside], last[beside], points, normals, x, y, z)
        toward = (
            (points[s, 0] - x) * normals[s, 0] + (points[s, 1] - y) * normals[s, 1] + (points[s, 2] - z) * normals[s, 2]
        )
        colours[seed] = IN if toward > 0.0 else OUT
        queue[0], head, tail = seed, 0, 1
        while head < tail:
            node = queue[head]
            head += 1
            width = 1 << (depth - level[node])
            i, j, k = cell[node, 0] * width, cell[node, 1] * width, cell[node, 2] * width
            stride = 1 if every_face else width
            start = 0 if every_face else width >> 1
            for face in range(6):
                for u in range(start, width, stride):
                    for v in range(start, width, stride):
                        a, b, c = _beyond(face, i, j, k, width, u, v)
                        if min(min(a, b), c) < 0 or max(max(a, b), c) >= count:
                            continue
                        other = leaf_at(child, level, depth, a, b, c)
                        if colours[other] == UNKNOWN and child[other] < 0:
                            colours[other] = colours[seed]
                            queue[tail] = other
                            tail += 1
