"""Silhouettes: the pixels where something else begins, whose edges have to be smoothed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.rendering.fragments import Fragments
from surfel.rendering.placing import View

JUMP = np.float32(4.0)
"""Pixels, in the depth beyond what the slopes of the two surfaces explain."""

BEND = np.float32(0.8)
"""Neighbours whose normals make a smaller cosine than this lie on two sides of an edge."""

LEAST = np.float32(0.05)
"""Surfaces are taken to be turned towards the eye by this cosine at least."""

_ZERO = np.float32(0.0)


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
    """Compare pixels with those to the right of them and below; marks are only set, so threads may share a row."""
    height, width = np.uint64(view.height), np.uint64(view.width)
    slope, middle, size, one = view.slope, view.depth, view.size, np.uint64(1)
    for y in range(np.uint64(first), np.uint64(last)):
        for x in range(width):
            p = y * width + x
            for k in range(2):
                if (x + one == width) if k == 0 else (y + one == height):
                    continue
                q = p + one if k == 0 else p + width
                if leaf[p] != leaf[q]:
                    edge[p] = edge[q] = True
                    continue
                if leaf[p] < 0:
                    continue
                cosine = normal[p, 0] * normal[q, 0] + normal[p, 1] * normal[q, 1] + normal[p, 2] * normal[q, 2]
                pixel = (middle + min(depth[p], depth[q])) * slope if slope > _ZERO else size
                flat = max(min(abs(normal[p, 2]), abs(normal[q, 2])), LEAST)
                if cosine < BEND or abs(depth[q] - depth[p]) * flat > JUMP * pixel:
                    edge[p] = edge[q] = True
