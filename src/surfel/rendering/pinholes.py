"""Pinholes: few pixels at which lines of sight slip through between the disks of a cloud, closed again."""

from __future__ import annotations

import numpy as np

from surfel._numba import inner, kernel, rows, threads_for
from surfel.rendering.eights import LANES, load, some
from surfel.rendering.fragments import Fragments
from surfel.rendering.placing import View
from surfel.rendering.silhouettes import BEND, JUMP, LEAST

MOST = 6
"""Pixels that hang together: more of them are a hole of the cloud."""

_DEEP = np.float32(8.0)  # jumps: what is so much deeper than the surface beside it is not that surface
_ACROSS = np.float32(2.0)  # jumps by which the surface round a pinhole may bend
_ZERO, _HALF = np.float32(0.0), np.float32(0.5)


def close_pinholes(seen: Fragments, view: View) -> None:
    """Let few pixels show the cloud that all round them is nearer, and one smooth surface.

    Disks cover a surface that is sampled well enough; where points lie at random, a gap is left now and then. What is
    seen through it, if anything, covers less of the picture than the surface does.

    Parameters
    ----------
    seen : Fragments
        Of every pixel, row after row; changed in place.
    view : View
        The picture.
    """
    found = np.zeros(len(seen), np.bool_)
    with threads_for(4 * len(seen)):
        _find(view.height, seen.depth, seen.normal, seen.leaf, seen.row, view, found)
    holes = np.flatnonzero(found)
    if len(holes):
        closed = Fragments.room(len(holes))
        _fill(
            holes, found, np.int64(view.width), seen.depth, seen.normal, seen.color, seen.leaf, seen.row,
            closed.depth, closed.normal, closed.color, closed.leaf, closed.row,
        )  # fmt: skip
        seen.put(holes, closed)


@rows
def _find(first, last, depth, normal, leaf, row, view, found):
    """Mark pinholes, each found from a pixel that is deeper than its left one; marks are only set, whoever does it."""
    width, height = np.int64(view.width), np.int64(view.height)
    slope, one = view.slope, np.uint64(1)
    least = view.depth * slope if slope > _ZERO else view.size
    hole = np.empty(MOST, np.int64)
    for begin in range(first * width + 1, last * width, LANES):
        at, end = np.uint64(begin), min(begin + LANES, last * width)
        if begin + LANES <= len(depth):
            before = load(depth, at - one)
            if not some(load(depth, at) - before > JUMP * (least + slope * before)):
                continue
        for p in range(begin, end):
            near = depth[p - 1]
            jump = JUMP * (least + slope * near)
            if depth[p] - near > jump:
                deep = near + min(_HALF * (depth[p] - near), _DEEP * jump)
                for i in range(_count_closed(p, width, height, deep, jump, depth, normal, leaf, row, hole)):
                    found[hole[i]] = True


@inner
def _count_closed(p, width, height, deep, jump, depth, normal, leaf, row, hole):
    """List the deep pixels that hang together with one; return how many, 0 unless one smooth cloud closes them in."""
    hole[0], count, at, lead = p, 1, 0, -1
    low, high, steep = np.float32(np.inf), np.float32(-np.inf), np.float32(1.0)
    while at < count:
        x, y = hole[at] % width, hole[at] // width
        at += 1
        if x == 0 or y == 0 or x == width - 1 or y == height - 1:
            return 0
        for k in range(9):
            q = (y + k // 3 - 1) * width + x + k % 3 - 1
            if depth[q] <= deep:
                lead = q if lead < 0 else lead
                cosine = (
                    normal[lead, 0] * normal[q, 0] + normal[lead, 1] * normal[q, 1] + normal[lead, 2] * normal[q, 2]
                )
                if row[q] < 0 or leaf[q] != leaf[lead] or cosine < BEND:
                    return 0
                steep = min(steep, max(abs(normal[q, 2]), LEAST))
                low, high = min(low, depth[q]), max(high, depth[q])
                continue
            known = False
            for i in range(count):
                known = known or hole[i] == q
            if not known:
                if count == MOST:
                    return 0
                hole[count] = q
                count += 1
    return count if (high - low) * steep <= _ACROSS * jump else 0


@kernel
def _fill(
    holes, found, width, depth, normal, color, leaf, row, to_depth, to_normal, to_color, to_leaf, to_row
):  # fmt: skip
    """Give each pixel the mean of its neighbours that are no pinholes, and the surfel of the nearest."""
    for i in range(len(holes)):
        p = holes[i]
        nearest, count = p, 0
        far, shade, upright = 0.0, np.zeros(3), np.zeros(3)
        for k in range(9):
            q = p + (k // 3 - 1) * width + k % 3 - 1
            if found[q] or row[q] < 0:
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
