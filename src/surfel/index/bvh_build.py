"""The tree over triangles: Hilbert order, leaves of eight triangles, nodes of eight boxes, level by level."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel
from surfel.core.box import corners
from surfel.core.cast import Floats
from surfel.index.bvh_simd import LANES
from surfel.index.hilbert import hilbert_order

PAD = np.float32(1e-6)
"""How far boxes are widened, in sizes of the mesh: above the rounding of boxes and lines in float32, 10 x 2^-24."""
REACH = np.float32(2.001)
"""A line whose sheared offset exceeds this misses the box [-1, 1]^3, however it is inclined."""
_ULP = 2.0**-24


class Tree(NamedTuple):
    """The arrays of a tree, in the order of its triangles along the curve.

    Boxes and leaves hold float32 coordinates, moved and scaled to [-1, 1]; ``vertices`` are exact, scaled by a power
    of two.
    """

    nodes: NDArray[np.float32]  # (m, 6, 8): low and high corners of the children, NaN where there is none
    first: NDArray[np.int32]  # (m,): the first child: a node, or a leaf for nodes from ``bottom`` on
    leaves: NDArray[np.float32]  # (l, 9, 8): the corners of eight triangles
    slack: NDArray[np.float32]  # (l,): bounds the rounding of the leaf's edge functions
    vertices: Floats  # (v, 3)
    corners: NDArray[np.int32]  # (f, 3): rows of ``vertices``
    order: NDArray[np.int32]  # (f,): the caller's triangles
    middle: Floats  # (3,): the middle of the box, scaled
    bottom: int
    scale: float  # a power of two: vertices = scale * the caller's
    size: float  # a power of two: half the longest side of the box or up to twice that, scaled


def build_tree(vertices: Floats, triangles: NDArray[np.int32]) -> Tree:
    """Sort the triangles, pack them into leaves and put the tree of boxes on top."""
    scale, middle, size = _frame(vertices)
    order = hilbert_order(_centers(vertices, triangles, scale))
    own_vertices, corners = _gather(vertices, triangles, order, scale)
    leaves, boxes, slack = _pack_leaves(own_vertices, corners, middle, 1.0 / size)
    sizes = _level_sizes(len(leaves))
    nodes, first = _pack_nodes(boxes, sizes)
    bottom = int(sizes[:-1].sum())
    return Tree(nodes, first, leaves, slack, own_vertices, corners, order, middle, bottom, scale, size)


def aligned(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return an uninitialised float32 array that starts at a multiple of 64 bytes, a line of the cache."""
    raw = np.empty(4 * math.prod(shape) + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + 4 * math.prod(shape)].view(np.float32).reshape(shape)


def _frame(vertices: Floats) -> tuple[float, Floats, float]:
    """Return powers of two that bring coordinates and sizes near 1, and the middle of the box between the two."""
    low, high = corners(vertices)
    largest = float(max(np.abs(low).max(), np.abs(high).max()))
    scale = math.ldexp(1.0, min(1000, -math.frexp(largest)[1])) if largest > 0.0 else 1.0
    low, high = low * scale, high * scale
    half = float((high - low).max()) * 0.5
    return scale, low * 0.5 + high * 0.5, math.ldexp(1.0, math.frexp(half)[1]) if half > 0.0 else 1.0


def _level_sizes(leaves: int) -> NDArray[np.int64]:
    """Return how many nodes each level has, from the root down."""
    sizes = [-(-leaves // LANES)]
    while sizes[0] > 1:
        sizes.insert(0, -(-sizes[0] // LANES))
    return np.array(sizes)


def _pack_leaves(
    vertices: Floats, corners: NDArray[np.int32], middle: Floats, shrink: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    count = -(-len(corners) // LANES)
    leaves, boxes, slack = aligned((count, 9, LANES)), np.empty((count, 6), np.float32), np.empty(count, np.float32)
    _fill_leaves(vertices, corners, middle, shrink, leaves, boxes, slack)
    return leaves, boxes, slack


def _pack_nodes(boxes: NDArray[np.float32], sizes: NDArray[np.int64]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    total = int(sizes.sum())
    nodes, first = aligned((total, 6, LANES)), np.empty(total, np.int32)
    below = boxes
    stop = total
    for level in range(len(sizes) - 1, -1, -1):
        start = stop - int(sizes[level])
        above = np.empty((stop - start, 6), np.float32)
        _fill_level(below, above, nodes[start:stop])
        child = 0 if level == len(sizes) - 1 else stop
        first[start:stop] = child + LANES * np.arange(stop - start)
        below, stop = above, start
    return nodes, first


@kernel
def _centers(vertices, triangles, scale):
    """Return the middle of each triangle's box: close to its centroid, and kinder to slivers."""
    centers = np.empty((len(triangles), 3))
    for i in range(len(triangles)):
        a, b, c = triangles[i]
        for axis in range(3):
            x, y, z = vertices[a, axis] * scale, vertices[b, axis] * scale, vertices[c, axis] * scale
            centers[i, axis] = 0.5 * (min(min(x, y), z) + max(max(x, y), z))
    return centers


@kernel
def _gather(vertices, triangles, order, scale):
    """Return the used vertices in the order of their first use along the curve, and the triangles in that order."""
    number = np.full(len(vertices), np.int32(-1))
    corners = np.empty((len(order), 3), np.int32)
    used = 0
    for i in range(len(order)):
        for k in range(3):
            v = triangles[order[i], k]
            if number[v] < 0:
                number[v] = used
                used += 1
            corners[i, k] = number[v]
    own = np.empty((used, 3))
    for v in range(len(vertices)):
        if number[v] >= 0:
            for axis in range(3):
                own[number[v], axis] = vertices[v, axis] * scale
    return own, corners


@kernel
def _fill_leaves(vertices, corners, middle, shrink, leaves, boxes, slack):
    for leaf in range(len(leaves)):
        for axis in range(3):
            low, high = np.float32(np.inf), np.float32(-np.inf)
            for k in range(3):
                for lane in range(LANES):
                    i = leaf * LANES + lane
                    if i < len(corners):
                        x = np.float32((vertices[corners[i, k], axis] - middle[axis]) * shrink)
                        low, high = min(low, x), max(high, x)
                    else:
                        x = np.float32(np.nan)
                    leaves[leaf, 3 * k + axis, lane] = x
            boxes[leaf, axis] = low - PAD
            boxes[leaf, 3 + axis] = high + PAD
        slack[leaf] = _edge_error(boxes[leaf])


@inlined
def _edge_error(box):
    """Bound the error of an edge function of a triangle in ``box``, for lines that meet the box.

    Sheared coordinates are at most r, the sum of the box's two longest sides. Five roundings of values up to 2 and
    one of the result put them off by at most u (8 + r), u = 2^-24; an edge function is then off by 4 r u (8 + r) + 4
    u r^2 and terms of u^2.
    """
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    r = np.float64(x + y + z - min(min(x, y), z)) + 1e-5
    return np.float32(1.1 * _ULP * r * (32.0 + 8.0 * r) + 1e-11)


@kernel
def _fill_level(below, above, nodes):
    """Gather eight boxes at a time into a node, and the box round them."""
    for node in range(len(nodes)):
        for side in range(6):
            bound = below[node * LANES, side]
            for lane in range(LANES):
                child = node * LANES + lane
                value = np.float32(np.nan)
                if child < len(below):
                    value = below[child, side]
                    bound = min(bound, value) if side < 3 else max(bound, value)
                nodes[node, side, lane] = value
            above[node, side] = bound
