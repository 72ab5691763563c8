"""The first passes over the points: their box, and the highest of each micro-cell.

Heights are multiplied by ``sign``: +1 for a surface above, -1 for one below, so that a fit always bounds from above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfel._numba import inlined, kernel, rows, threads_for
from surfel.bounding.evaluate import cell_of
from surfel.bounding.frame import Frame, project
from surfel.bounding.lanes import larger, stretch
from surfel.bounding.records import BLOCK, micro_cells_of_eight
from surfel.core.cast import Floats

HALVED = 100_000
"""Points from which on the two halves of a pass may run side by side."""

NOTES = 256
"""Points that were the highest of their micro-cell for a while, before their places are written down."""

LARGEST = 1e300
"""Coordinates beyond this are refused: differences and products of coefficients must not overflow."""


def survey(points: Floats, rotation: Floats) -> tuple[bool, Floats, Floats]:
    """Return whether all is finite, and the box of the rotated coordinates (lowest, highest; three numbers each)."""
    axes = np.abs(rotation).argmax(axis=1)
    along = rotation[np.arange(3), axes]
    parts = 2 if len(points) >= HALVED else 1
    with threads_for(len(points)):
        if (np.abs(along) == 1.0).all() and np.count_nonzero(rotation) == 3:  # the axes themselves, in some order
            lanes = np.zeros((parts, 3, 8, 3))
            lanes[:, 0], lanes[:, 1] = np.inf, -np.inf
            _stretch(parts, points, lanes.reshape(parts, -1))
            low, high = lanes[:, 0].min(axis=(0, 1)), lanes[:, 1].max(axis=(0, 1))
            ends = np.stack([along * low[axes], along * high[axes]])
            lowest, highest, odd = ends.min(axis=0), ends.max(axis=0), lanes[:, 2]
        else:
            lanes = np.empty((parts, 7, BLOCK))
            lanes[:, :3], lanes[:, 3:6], lanes[:, 6] = np.inf, -np.inf, 0.0
            _survey(parts, points, rotation.ravel().copy(), lanes.reshape(parts, -1))
            lowest, highest, odd = lanes[:, :3].min(axis=(0, 2)), lanes[:, 3:6].max(axis=(0, 2)), lanes[:, 6]
    usable = bool((odd == 0.0).all()) and bool(max(np.abs(lowest).max(), np.abs(highest).max()) <= LARGEST)
    return usable, lowest, highest


@dataclass(frozen=True, eq=False)
class Highest:
    """The highest point of every micro-cell: ``split`` x ``split`` of them a cell.

    Parameters
    ----------
    split : int
        Micro-cells along a side of a cell.
    uv : Floats, shape (a, b, 2)
        Where it lies.
    height : Floats, shape (a, b)
        How high; -inf where the micro-cell is empty.
    """

    split: int
    uv: Floats
    height: Floats


def no_points(frame: Frame, split: int) -> Highest:
    """Return micro-cells without points, to be filled by :func:`keep_highest`."""
    a, b = int(frame.cells[0]) * split, int(frame.cells[1]) * split
    return Highest(split, np.zeros((a, b, 2)), np.full((a, b), -np.inf))


def keep_highest(highest: Highest, points: Floats, frame: Frame, sign: float, every: int = 1) -> None:
    """Keep the highest point of each micro-cell; of equal ones the first. Looks at eight of ``8 every`` points only."""
    _keep_highest(
        points, frame.signed_numbers(sign), np.int64(every), np.int64(highest.split), highest.uv, highest.height
    )


@rows
def _stretch(begin, end, p, every):
    flat = p.ravel()
    for part in range(begin, end):
        lanes = every[part]
        first = 3 * (p.shape[0] * part // every.shape[0])
        last = 3 * (p.shape[0] * (part + 1) // every.shape[0])
        whole = last - (last - first) % 24
        stretch(flat, first, (whole - first) // 24, lanes)
        for at in range(whole, last):
            x, i = flat[at], at - whole
            lanes[i], lanes[24 + i] = min(lanes[i], x), max(lanes[24 + i], x)
            lanes[48 + i] += x - x


@rows
def _survey(begin, end, p, r, every):
    # Lanes of a block keep extremes of their own: a running minimum of one number would not be vectorized.
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8]
    for part in range(begin, end):
        lanes, last = every[part], p.shape[0] * (part + 1) // every.shape[0]
        for first in range(p.shape[0] * part // every.shape[0], last, BLOCK):
            q = p[first : min(first + BLOCK, last)]
            for i in range(q.shape[0]):
                a, b, c = q[i, 0], q[i, 1], q[i, 2]
                x = r0 * a + r1 * b + r2 * c
                y = r3 * a + r4 * b + r5 * c
                z = r6 * a + r7 * b + r8 * c
                lanes[i] = x if x < lanes[i] else lanes[i]
                lanes[BLOCK + i] = y if y < lanes[BLOCK + i] else lanes[BLOCK + i]
                lanes[2 * BLOCK + i] = z if z < lanes[2 * BLOCK + i] else lanes[2 * BLOCK + i]
                lanes[3 * BLOCK + i] = x if x > lanes[3 * BLOCK + i] else lanes[3 * BLOCK + i]
                lanes[4 * BLOCK + i] = y if y > lanes[4 * BLOCK + i] else lanes[4 * BLOCK + i]
                lanes[5 * BLOCK + i] = z if z > lanes[5 * BLOCK + i] else lanes[5 * BLOCK + i]
                lanes[6 * BLOCK + i] += (x - x) + (y - y) + (z - z)


@inlined
def micro_cell(cell, local, split):
    """Return the micro-cell along one axis."""
    return np.int64(cell) * split + min(np.int64(local * split), split - 1)


@kernel
def _keep_highest(p, f, every, split, uv, height):
    # Which point is the highest so far cannot be foretold: there are no branches, but notes of those that were.
    n, m = np.int64(f[13]), np.int64(f[14])
    flat, high, where = p.ravel(), height.ravel(), uv.ravel()
    z, places = np.empty(8), np.empty(8, np.int32)
    noted, into = np.empty(NOTES + 8, np.int64), np.empty(NOTES + 8, np.int64)
    notes, first, whole = 0, 0, p.shape[0] - p.shape[0] % 8
    while first < whole:
        micro_cells_of_eight(flat, 3 * first, f, float(split), places, z, 0)
        for i in range(8):
            at, top = np.int64(places[i]), z[i]
            before = high[at]
            noted[notes], into[notes] = first + i, at
            notes += 1 if top > before else 0
            high[at] = larger(top, before)
        first += 8 * every
        if notes >= NOTES or first >= whole:  # while the points are near
            for j in range(notes):
                q, at = 3 * noted[j], into[j]
                where[2 * at], where[2 * at + 1], _ = project(f, flat[q], flat[q + 1], flat[q + 2])
            notes = 0
    for i in range(whole, p.shape[0]):
        u, v, top = project(f, p[i, 0], p[i, 1], p[i, 2])
        h, k = cell_of(u, n), cell_of(v, m)
        a, b = micro_cell(h, u - h, split), micro_cell(k, v - k, split)
        if top > height[a, b]:
            height[a, b], uv[a, b, 0], uv[a, b, 1] = top, u, v
