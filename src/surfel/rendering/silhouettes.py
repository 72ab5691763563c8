"""Silhouettes: the pixels where something else begins, whose edges have to be smoothed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.rendering.eights import LANES, equal, load, pick, some
from surfel.rendering.fragments import Fragments
from surfel.rendering.placing import View

JUMP = np.float32(4.0)
"""Pixels, in the depth beyond what the slopes of the two surfaces explain."""

BEND = np.float32(0.8)
"""Neighbours whose normals make a smaller cosine than this lie on two sides of an edge."""

LEAST = np.float32(0.05)
"""Surfaces are taken to be turned towards the eye by this cosine at least."""

_TURN = np.float32(2.0 * (1.0 - BEND) / 3.0)  # squares of differences of coordinates; smaller ones tell of no edge
_ZERO, _INF = np.float32(0.0), np.float32(np.inf)


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
        _find(view.height, seen.depth, seen.normal, seen.normal.reshape(-1), seen.leaf, view, edge)
    return np.flatnonzero(edge)


@rows
def _find(first, last, depth, normal, flat, leaf, view, edge):
    """Compare pixels with those to the right of them and below; marks are only set, so threads may share a row.

    Most are passed over eight at once: those that see nothing, and those that are surely of one smooth surface.
    """
    height, width = np.uint64(view.height), np.uint64(view.width)
    one, eight, three = np.uint64(1), np.uint64(LANES), np.uint64(3)
    slope = view.slope
    least = view.depth * slope if slope > _ZERO else view.size
    for y in range(np.uint64(first), np.uint64(last)):
        for side in range(2):
            step, count = (one, width - one) if side == 0 else (width, width)
            if side == 1 and y + one == height:
                continue
            for begin in range(np.uint64(0), count, eight):
                p = y * width + begin
                q, number = p + step, min(eight, count - begin)
                if q + eight <= len(depth) and equal(leaf, p, q):
                    near, far = load(depth, p), load(depth, q)
                    if not some(near < _INF):
                        continue
                    over, jump = far - near, JUMP * (least + slope * pick(near < far, near, far))
                    a = load(flat, three * p) - load(flat, three * q)
                    b = load(flat, three * p + eight) - load(flat, three * q + eight)
                    c = load(flat, three * p + eight + eight) - load(flat, three * q + eight + eight)
                    turned = (a * a > _TURN) | (b * b > _TURN) | (c * c > _TURN)
                    if not some(turned | (over * over > jump * jump)):
                        continue
                for i in range(p, p + number):
                    j = i + step
                    if leaf[i] != leaf[j]:
                        edge[i] = edge[j] = True
                    elif leaf[i] >= 0:
                        cosine = normal[i, 0] * normal[j, 0] + normal[i, 1] * normal[j, 1] + normal[i, 2] * normal[j, 2]
                        steep = max(min(abs(normal[i, 2]), abs(normal[j, 2])), LEAST)
                        jump_here = JUMP * (least + slope * min(depth[i], depth[j]))
                        if cosine < BEND or abs(depth[j] - depth[i]) * steep > jump_here:
                            edge[i] = edge[j] = True
