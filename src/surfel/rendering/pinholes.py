"""Pinholes: few pixels at which lines of sight slip through between the disks of a cloud, closed again."""

from __future__ import annotations

import numpy as np

from surfel._numba import inner, kernel, rows, threads_for
from surfel.rendering.fragments import Fragments
from surfel.rendering.placing import View
from surfel.rendering.silhouettes import BEND, JUMP, LEAST

PASSES = 2
"""Each closes pixels that have at most one open neighbour: rows of up to four pixels are closed, larger holes stay."""

_MOST_OPEN = 1
_ACROSS = np.float32(2.0)  # the neighbours reach over two pixels

_ZERO = np.float32(0.0)


def close_pinholes(seen: Fragments, view: View) -> None:
    """Let pixels show the cloud that all round them is nearer, and one smooth surface.

    Disks cover a surface that is sampled well enough; where points lie at random, a gap is left now and then that is
    smaller than a pixel. Whatever is seen through it, if anything, covers less of the picture than the surface does.

    Parameters
    ----------
    seen : Fragments
        Of every pixel, row after row; changed in place.
    view : View
        The picture.
    """
    if view.width < 3 or view.height < 3:
        return
    for _ in range(PASSES):
        open_ = np.zeros(len(seen), np.bool_)
        with threads_for(4 * len(seen)):
            _find(view.height - 2, seen.depth, seen.normal, seen.leaf, seen.row, view, open_)
        holes = np.flatnonzero(open_)
        if not len(holes):
            return
        closed = Fragments.room(len(holes))
        _fill(
            holes, seen.depth, seen.normal, seen.color, seen.leaf, seen.row, view,
            closed.depth, closed.normal, closed.color, closed.leaf, closed.row,
        )  # fmt: skip
        seen.put(holes, closed)


@rows
def _find(first, last, depth, normal, leaf, row, view, open_):
    """Mark the pixels that are deeper than a neighbour and closed all round."""
    width = np.int64(view.width)
    slope, middle, size = view.slope, view.depth, view.size
    for y in range(first + 1, last + 1):
        for x in range(1, width - 1):
            p = y * width + x
            near = min(min(depth[p - 1], depth[p + 1]), min(depth[p - width], depth[p + width]))
            if not near < depth[p]:
                continue
            pixel = (middle + near) * slope if slope > _ZERO else size
            if depth[p] - near > JUMP * pixel:
                open_[p] = _is_closed_round(p, width, pixel, depth, normal, leaf, row)


@inner
def _is_closed_round(p, width, pixel, depth, normal, leaf, row):
    """Tell whether the neighbours that are nearer lie on one smooth cloud, and are all but one at the most."""
    lead, steep = -1, np.float32(1.0)
    low, high = np.float32(np.inf), np.float32(-np.inf)
    missing = 0
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            q = p + dy * width + dx
            if q == p:
                continue
            if row[q] < 0 or not depth[p] - depth[q] > JUMP * pixel:
                missing += 1
                if missing > _MOST_OPEN:
                    return False
                continue
            if lead < 0:
                lead = q
            cosine = normal[lead, 0] * normal[q, 0] + normal[lead, 1] * normal[q, 1] + normal[lead, 2] * normal[q, 2]
            if leaf[q] != leaf[lead] or cosine < BEND:
                return False
            steep = min(steep, max(abs(normal[q, 2]), LEAST))
            low, high = min(low, depth[q]), max(high, depth[q])
    return (high - low) * steep <= _ACROSS * JUMP * pixel


@kernel
def _fill(holes, depth, normal, color, leaf, row, view, to_depth, to_normal, to_color, to_leaf, to_row):
    """Give each pixel the mean of its nearer neighbours, and the surfel of the nearest."""
    width = np.int64(view.width)
    slope, middle, size = view.slope, view.depth, view.size
    for i in range(len(holes)):
        p = holes[i]
        nearest, count = p, 0
        far, shade, upright = 0.0, np.zeros(3), np.zeros(3)
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                q = p + dy * width + dx
                pixel = (middle + depth[q]) * slope if slope > _ZERO else size
                if row[q] < 0 or not depth[p] - depth[q] > JUMP * pixel:
                    continue
                count += 1
                far += depth[q]
                for axis in range(3):
                    shade[axis] += color[q, axis]
                    upright[axis] += normal[q, axis]
                if depth[q] < depth[nearest]:
                    nearest = q
        length = np.sqrt(upright[0] ** 2 + upright[1] ** 2 + upright[2] ** 2)
        to_depth[i], to_leaf[i], to_row[i] = far / count, leaf[nearest], row[nearest]
        for axis in range(3):
            to_normal[i, axis] = upright[axis] / length
            to_color[i, axis] = np.uint8(shade[axis] / count + 0.5)
