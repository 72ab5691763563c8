"""Silhouettes: the pixels where something else begins, whose edges have to be smoothed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.rendering.fragments import Fragments
from surfel.rendering.raster import View

_JUMP = np.float32(4.0)  # pixels, in the depth beyond what the slopes of the two surfaces explain
_BEND = np.float32(0.8)
"""Neighbours whose normals make a smaller cosine than this lie on two sides of an edge."""


def silhouettes(seen: Fragments, view: View) -> NDArray[np.int64]:
    """Return the numbers of the pixels at edges: of leaves, of depth, and of creases.

    Parameters
    ----------
    seen : Fragments
        Of every pixel, row after row.
    view : View
        The picture.
    """
    shape = (view.height, view.width)
    edge = np.zeros(shape, np.bool_)
    with threads_for(8 * edge.size):
        grid = seen.depth.reshape(shape), seen.normal.reshape(*shape, 3), seen.leaf.reshape(shape)
        _find(view.height, *grid, view, edge)
    return np.flatnonzero(edge)


@rows
def _find(first, last, depth, normal, leaf, view, edge):
    height, width = depth.shape
    for y in range(first, last):
        for x in range(width):
            for k in range(4):
                h, v = x + (1 if k == 0 else -1 if k == 1 else 0), y + (1 if k == 2 else -1 if k == 3 else 0)
                if h < 0 or v < 0 or h >= width or v >= height:
                    continue
                if leaf[v, h] != leaf[y, x]:
                    edge[y, x] = True
                    break
                if leaf[y, x] < 0:
                    continue
                cosine = (
                    normal[y, x, 0] * normal[v, h, 0]
                    + normal[y, x, 1] * normal[v, h, 1]
                    + normal[y, x, 2] * normal[v, h, 2]
                )
                if cosine < _BEND:
                    edge[y, x] = True
                    break
                pixel = (view.depth + depth[y, x]) * view.slope if view.slope > 0.0 else view.size
                flat = max(min(abs(normal[y, x, 2]), abs(normal[v, h, 2])), np.float32(0.05))
                if abs(depth[v, h] - depth[y, x]) > _JUMP * pixel / flat:
                    edge[y, x] = True
                    break
