"""A tree over a few thousand boxes, for kernels that ask which of them a line passes or a point lies in."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner
from surfel.core.cast import Floats
from surfel.index.hilbert import hilbert_order

FEW = 4
"""So few boxes are not worth a tree."""

STACK = 64
"""Room for the nodes that wait: one a level, and there are fewer levels than bits."""


class BoxTree(NamedTuple):
    """A complete binary tree as a heap: node k has the children 2 k and 2 k + 1; the last half are the boxes.

    Boxes that are unbounded are not in the heap; ``always`` names them. Nor are those of a few boxes.
    """

    boxes: Floats  # (2 p, 6): low and high corners; inverted where there is none
    item: NDArray[np.int32]  # (p,): the caller's box of each last node, -1 where there is none
    always: NDArray[np.int32]


def box_tree(boxes: Floats) -> BoxTree:
    """Build the tree over boxes of shape (n, 2, 3); inverted ones are left out, for nothing can hit them."""
    full = np.flatnonzero((boxes[:, 0] <= boxes[:, 1]).all(axis=1))
    bounded = np.isfinite(boxes[full]).all(axis=(1, 2)) & (len(full) > FEW)
    always, held = full[~bounded].astype(np.int32), full[bounded]
    width = 1 << max(len(held) - 1, 0).bit_length()
    heap = np.tile(np.array([np.inf] * 3 + [-np.inf] * 3), (2 * width, 1))
    item = np.full(width, -1, np.int32)
    if len(held):
        order = held[hilbert_order(boxes[held].mean(axis=1))]
        item[: len(held)] = order
        heap[width : width + len(held)] = boxes[order].reshape(-1, 6)
    for node in range(width - 1, 0, -1):
        heap[node, :3] = np.minimum(heap[2 * node, :3], heap[2 * node + 1, :3])
        heap[node, 3:] = np.maximum(heap[2 * node, 3:], heap[2 * node + 1, 3:])
    return BoxTree(heap, item, always)


@inner
def boxes_on_line(boxes, item, always, ox, oy, oz, dx, dy, dz, stack, found):
    """Write the items whose boxes a line passes into ``found``; return how many."""
    count = 0
    for k in range(len(always)):
        found[count] = always[k]
        count += 1
    ix = 1.0 / dx if abs(dx) > 1e-300 else 1e300
    iy = 1.0 / dy if abs(dy) > 1e-300 else 1e300
    iz = 1.0 / dz if abs(dz) > 1e-300 else 1e300
    width = len(item)
    if item[0] < 0:
        return count
    stack[0], top = 1, 1
    while top > 0:
        top -= 1
        node = stack[top]
        t0, t1 = (boxes[node, 0] - ox) * ix, (boxes[node, 3] - ox) * ix
        near, far = min(t0, t1), max(t0, t1)
        t0, t1 = (boxes[node, 1] - oy) * iy, (boxes[node, 4] - oy) * iy
        near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
        t0, t1 = (boxes[node, 2] - oz) * iz, (boxes[node, 5] - oz) * iz
        near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
        if near > far or boxes[node, 0] > boxes[node, 3]:
            continue
        if node >= width:
            found[count] = item[node - width]
            count += 1
        else:
            stack[top], stack[top + 1] = 2 * node, 2 * node + 1
            top += 2
    return count


@inner
def boxes_round_point(boxes, item, always, x, y, z, stack, found):
    """Write the items whose boxes hold a point into ``found``; return how many."""
    count = 0
    for k in range(len(always)):
        found[count] = always[k]
        count += 1
    width = len(item)
    if item[0] < 0:
        return count
    stack[0], top = 1, 1
    while top > 0:
        top -= 1
        node = stack[top]
        if x < boxes[node, 0] or y < boxes[node, 1] or z < boxes[node, 2]:
            continue
        if x > boxes[node, 3] or y > boxes[node, 4] or z > boxes[node, 5]:
            continue
        if node >= width:
            found[count] = item[node - width]
            count += 1
        else:
            stack[top], stack[top + 1] = 2 * node, 2 * node + 1
            top += 2
    return count
