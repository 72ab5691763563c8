"""Silhouettes: the pixels where something else begins, whose edges have to be smoothed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.rendering.fragments import Fragments
from surfel.rendering.placing import View

_JUMP = np.float32(4.0)  # pixels, in the depth beyond what the slopes of the two surfaces explain
_BEND = np.float32(0.8)
"""Neighbours whose normals make a smaller cosine than this lie on two sides of an edge."""
_ZERO, _LEAST = np.float32(0.0), np.float32(0.05)


def silhouettes(seen: Fragments, view: View) -> NDArray[np.int64]:
    """Return the numbers of the pixels at edges: of leaves, of depth, and of creases.

    Parameters
    ----------
    seen : Fragments
        Of every pixel, row after row.
    view : View
        The picture.
    """
    edge = np.zeros(len(seen), np.bool_)
    with threads_for(8 * len(seen)):
        _find(view.height, seen.depth, seen.normal, seen.leaf, view, edge)
    return np.flatnonzero(edge)


@rows
def _find(first, last, depth, normal, leaf, view, edge):
    """Compare rows with their neighbours; loops along a row have no branches, so that they become vectors."""
    height, width = view.height, view.width
    slope, middle, size = view.slope, view.depth, view.size
    for y in range(first, last):
        begin, end = width, 0
        for v in range(max(y - 1, 0), min(y + 2, height)):
            x = 0
            while x < begin and leaf[v * width + x] < 0:
                x += 1
            begin, x = x, width
            while x > end and leaf[v * width + x - 1] < 0:
                x -= 1
            end = x
        begin, end = max(begin - 1, 0), min(end + 1, width)
        for k in range(4):
            h, v = (1 if k == 0 else -1 if k == 1 else 0), y + (1 if k == 2 else -1 if k == 3 else 0)
            if v < 0 or v >= height:
                continue
            low, high = max(begin, -h), min(end, width - h)
            here, there = np.uint64(y * width + low), np.uint64(v * width + low + h)
            for x in range(np.uint64(max(high - low, 0))):
                p, q = here + x, there + x
                cosine = normal[p, 0] * normal[q, 0] + normal[p, 1] * normal[q, 1] + normal[p, 2] * normal[q, 2]
                pixel = (middle + depth[p]) * slope if slope > _ZERO else size
                one, other = abs(normal[p, 2]), abs(normal[q, 2])
                flat = one if one < other else other
                flat = flat if flat > _LEAST else _LEAST
                bent = (cosine < _BEND) | (abs(depth[q] - depth[p]) * flat > _JUMP * pixel)
                edge[p] |= (leaf[q] != leaf[p]) | ((leaf[p] >= 0) & bent)
