"""Spheres round blocks of 16 surfels, round eight of those, and so on: for asking about many surfels at a time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel, rows, threads_for
from surfel.core.cast import Floats

BLOCK = 16
WIDTH = 8


class Spheres(NamedTuple):
    """Bounding spheres of runs of sorted points: of 16 points in level 0, of eight spheres in each level above.

    Parameters
    ----------
    levels : NDArray[np.int64], shape (levels + 1,)
        Where the spheres of each level start; the last level has one.
    centres : Floats, shape (spheres, 3)
        Middles of the boxes of what they hold.
    radii : Floats, shape (spheres,)
        Never too small.
    """

    levels: NDArray[np.int64]
    centres: Floats
    radii: Floats


def spheres_of(points: Floats) -> Spheres:
    """Build the spheres of points that are sorted along a curve, at least one."""
    starts = [0]
    width = -(-len(points) // BLOCK)
    starts.append(width)
    while width > 1:
        width = -(-width // WIDTH)
        starts.append(starts[-1] + width)
    levels = np.array(starts, np.int64)
    centres, radii = np.empty((starts[-1], 3)), np.empty(starts[-1])
    with threads_for(len(points)):
        _enclose_points(starts[1], points, centres, radii)
    _enclose_spheres(levels, centres, radii)
    return Spheres(levels, centres, radii)


@rows
def _enclose_points(first, last, points, centres, radii):
    n = len(points)
    for block in range(first, last):
        start, stop = block * BLOCK, min(block * BLOCK + BLOCK, n)
        for axis in range(3):
            low = high = points[start, axis]
            for i in range(start + 1, stop):
                low, high = min(low, points[i, axis]), max(high, points[i, axis])
            centres[block, axis] = 0.5 * low + 0.5 * high
        farthest = 0.0
        for i in range(start, stop):
            dx, dy, dz = (
                points[i, 0] - centres[block, 0],
                points[i, 1] - centres[block, 1],
                points[i, 2] - centres[block, 2],
            )
            farthest = max(farthest, dx * dx + dy * dy + dz * dz)
        radii[block] = math.sqrt(farthest) * (1.0 + 1e-12)


@kernel
def _enclose_spheres(levels, centres, radii):
    for level in range(1, len(levels) - 1):
        below = levels[level] - levels[level - 1]
        for node in range(levels[level + 1] - levels[level]):
            here = levels[level] + node
            start = levels[level - 1] + node * WIDTH
            stop = levels[level - 1] + min(below, node * WIDTH + WIDTH)
            for axis in range(3):
                low, high = np.inf, -np.inf
                for s in range(start, stop):
                    low, high = min(low, centres[s, axis] - radii[s]), max(high, centres[s, axis] + radii[s])
                centres[here, axis] = 0.5 * low + 0.5 * high
            farthest = 0.0
            for s in range(start, stop):
                dx, dy, dz = (
                    centres[s, 0] - centres[here, 0],
                    centres[s, 1] - centres[here, 1],
                    centres[s, 2] - centres[here, 2],
                )
                farthest = max(farthest, math.sqrt(dx * dx + dy * dy + dz * dz) + radii[s])
            radii[here] = farthest * (1.0 + 1e-12)
