"""Near lines: between which places a line of sight runs close to any of the surfels of a cloud."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from surfel._numba import inlined, rows, threads_for
from surfel.core.cast import Floats

_LEAF = 8  # surfels that follow each other, in one box
_STACK = 64
_WORK = 50  # what a line costs, in the items of kernels


class Balls(NamedTuple):
    """Balls round surfels that follow each other along a curve, under a complete binary tree of boxes.

    Node k has the children 2 k and 2 k + 1; the last half are boxes round ``_LEAF`` balls each, inverted where empty.
    """

    centres: Floats  # (n, 3)
    radii: Floats  # (n,)
    boxes: Floats  # (2 p, 6)


def balls_round(centres: Floats, radii: Floats) -> Balls:
    """Build the tree over balls.

    Parameters
    ----------
    centres : Floats, shape (n, 3)
        Sorted so that neighbours follow each other; at least one.
    radii : Floats, shape (n,)
        Of the balls.
    """
    starts = np.arange(0, len(centres), _LEAF)
    width = 1 << max(len(starts) - 1, 0).bit_length()
    boxes = np.tile(np.array([np.inf] * 3 + [-np.inf] * 3), (2 * width, 1))
    last = slice(width, width + len(starts))
    boxes[last, :3] = np.minimum.reduceat(centres - radii[:, None], starts)
    boxes[last, 3:] = np.maximum.reduceat(centres + radii[:, None], starts)
    while width > 1:
        width //= 2
        children = boxes[2 * width : 4 * width].reshape(width, 2, 6)
        boxes[width : 2 * width, :3] = children[:, :, :3].min(axis=1)
        boxes[width : 2 * width, 3:] = children[:, :, 3:].max(axis=1)
    return Balls(np.array(centres), np.array(radii), boxes)


def next_runs(balls: Balls, origins: Floats, directions: Floats, after: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the first run of each line within balls, beyond some place of it.

    Parameters
    ----------
    balls : Balls
        The balls.
    origins, directions : Floats, shape (m, 3)
        Of the lines; the directions unit vectors.
    after : Floats, shape (m,)
        Places of the lines, from which on they are looked at.

    Returns
    -------
    begin, end : Floats, shape (m,)
        Of the run; infinite where there is none.
    least : Floats, shape (m,)
        Radius of the least ball that the run passes.
    """
    m = len(origins)
    begin, end, least = np.empty(m), np.empty(m), np.empty(m)
    with threads_for(_WORK * m):
        _runs(m, *balls, origins, directions, after, begin, end, least)
    return begin, end, least


@rows
def _runs(first, last, centres, radii, boxes, origins, directions, after, begin, end, least):
    count, width = len(centres), len(boxes) // 2
    stack = np.empty(_STACK, np.int64)
    enter, leave, radius = np.empty(256), np.empty(256), np.empty(256)
    for line in range(first, last):
        ox, oy, oz = origins[line, 0], origins[line, 1], origins[line, 2]
        dx, dy, dz = directions[line, 0], directions[line, 1], directions[line, 2]
        ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
        start, found, top = after[line], 0, 1
        stack[0] = 1
        while top > 0:
            top -= 1
            node = stack[top]
            a, b = (boxes[node, 0] - ox) * ix, (boxes[node, 3] - ox) * ix
            c, d = (boxes[node, 1] - oy) * iy, (boxes[node, 4] - oy) * iy
            e, f = (boxes[node, 2] - oz) * iz, (boxes[node, 5] - oz) * iz
            far = min(min(max(a, b), max(c, d)), max(e, f))
            if max(max(min(a, b), min(c, d)), min(e, f)) > far or far < start or boxes[node, 0] > boxes[node, 3]:
                continue
            if node < width:
                stack[top], stack[top + 1] = 2 * node, 2 * node + 1
                top += 2
                continue
            for i in range((node - width) * _LEAF, min((node - width + 1) * _LEAF, count)):
                x, y, z = centres[i, 0] - ox, centres[i, 1] - oy, centres[i, 2] - oz
                along = x * dx + y * dy + z * dz
                x, y, z = x - along * dx, y - along * dy, z - along * dz
                square = radii[i] * radii[i] - (x * x + y * y + z * z)
                half = math.sqrt(max(square, 0.0))
                if square <= 0.0 or along + half <= start:
                    continue
                if found == len(enter):
                    enter = np.concatenate((enter, np.empty(found)))
                    leave = np.concatenate((leave, np.empty(found)))
                    radius = np.concatenate((radius, np.empty(found)))
                spot = found
                while spot > 0 and enter[spot - 1] > along - half:
                    enter[spot], leave[spot], radius[spot] = enter[spot - 1], leave[spot - 1], radius[spot - 1]
                    spot -= 1
                enter[spot], leave[spot], radius[spot] = along - half, along + half, radii[i]
                found += 1
        begin[line] = end[line] = least[line] = np.inf
        if found == 0:
            continue
        begin[line], end[line], least[line] = max(enter[0], start), leave[0], radius[0]
        for k in range(1, found):
            if enter[k] > end[line]:
                break
            end[line], least[line] = max(end[line], leave[k]), min(least[line], radius[k])


@inlined
def _inverse(x):
    """Return one over a coordinate of a direction."""
    return 1.0 / x if abs(x) > 1e-300 else 1e300
