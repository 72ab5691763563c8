"""Splitting: surfels at the cut as many smaller ones, for those who cannot clip."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, kernel
from surfel.booleans.cells import CORNERS, EDGES, Cells, area_and_middle, clip_polygon
from surfel.booleans.pieces import LINES, Pieces
from surfel.core.cast import Floats

DEEPEST = 8
"""Surfels are halved no more often than this."""

USUAL = 3
"""So often are they where neither a level nor a tolerance is given."""

_ROOM = CORNERS + 8


class Parts(NamedTuple):
    """Squares of the tangent planes that survive.

    Parameters
    ----------
    row : NDArray[np.int64], shape (q,)
        The surfel, as a row of what was cut.
    middle : Floats, shape (q, 2)
        Of the square.
    radius : Floats, shape (q,)
        Of the disk round it.
    area : Floats, shape (q,)
        Of the part of the surfel's cell in it.
    fate : NDArray[np.int8], shape (q,)
        1, or -1 where it is turned over.
    """

    row: NDArray[np.int64]
    middle: Floats
    radius: Floats
    area: Floats
    fate: NDArray[np.int8]


def levels_for(extents: Floats, level: int | None, tolerance: float | None) -> NDArray[np.int64]:
    """Return how often each is halved: a disk of the last level reaches over the cut by its radius at most."""
    if tolerance is None:
        return np.full(len(extents), USUAL if level is None else level, np.int64)
    steps = np.ceil(np.log2(np.maximum(math.sqrt(2.0) * extents / tolerance, 1.0)))
    return np.clip(steps, 1, DEEPEST).astype(np.int64)


def split(
    starts: NDArray[np.int64], lines: Floats, disks: Floats, cells: Cells,
    before: tuple[NDArray[np.int64], Floats], pieces: Pieces, fate: NDArray[np.int8], levels: NDArray[np.int64],
    chosen: NDArray[np.bool_],
) -> Parts:  # fmt: skip
    """Divide surfels into squares, those that a line passes again and again (Adams and Dutre).

    Parameters
    ----------
    starts, lines, disks, cells, before
        As for :func:`surfel.booleans.pieces.parted`.
    pieces, fate : Pieces, NDArray[np.int8]
        All pieces as they were parted, and what becomes of each.
    levels : NDArray[np.int64], shape (m,)
        How often each is halved along both directions.
    chosen : NDArray[np.bool_], shape (m,)
        Which surfels to divide.
    """
    order = np.argsort(pieces.row, kind="stable")
    piece_starts = np.searchsorted(pieces.row[order], np.arange(len(disks) + 1))
    room = 32 * len(disks) + 64
    while True:
        out = Parts(
            np.empty(room, np.int64), np.empty((room, 2)), np.empty(room), np.empty(room), np.empty(room, np.int8)
        )
        written = _split(
            starts, lines, disks, *cells, *before, piece_starts, pieces.above[order], fate[order], levels, chosen, *out
        )
        if written <= room:
            return Parts(out[0][:written], out[1][:written], out[2][:written], out[3][:written], out[4][:written])
        room = written


@kernel
def _split(
    starts, lines, disks, corners, counts, edges, gone_starts, gone, piece_starts, above, fate, levels, chosen,
    out_row, out_middle, out_radius, out_area, out_fate,
):  # fmt: skip
    stack = np.empty((4 * (DEEPEST + 2), 3))
    depth = np.empty(4 * (DEEPEST + 2), np.int64)
    px, py, qx, qy = np.empty(_ROOM), np.empty(_ROOM), np.empty(_ROOM), np.empty(_ROOM)
    written = 0
    for row in range(len(disks)):
        if not chosen[row]:
            continue
        ax, ay, bx, by = disks[row, 0, 0], disks[row, 0, 1], disks[row, 1, 0], disks[row, 1, 1]
        stack[0, 0] = stack[0, 1] = 0.0
        stack[0, 2] = math.sqrt(max(ax * ax + ay * ay, bx * bx + by * by))
        depth[0] = 0
        top = 1
        while top > 0:
            top -= 1
            u, v, half, level = stack[top, 0], stack[top, 1], stack[top, 2], depth[top]
            if not _meets(u, v, half, ax, ay, bx, by):
                continue
            if level < levels[row] and (
                level == 0 or _passed(row, u, v, half, starts, lines, edges, gone_starts, gone)
            ):
                for k in range(4):
                    stack[top, 0] = u + (half if k & 1 else -half) * 0.5
                    stack[top, 1] = v + (half if k & 2 else -half) * 0.5
                    stack[top, 2] = 0.5 * half
                    depth[top] = level + 1
                    top += 1
                continue
            verdict = _fate_at(row, u, v, starts, lines, edges, gone_starts, gone, piece_starts, above, fate)
            if verdict == 0:
                continue
            for c in range(counts[row]):
                px[c], py[c] = corners[row, c, 0], corners[row, c, 1]
            count = clip_polygon(px, py, counts[row], 1.0, 0.0, u + half, qx, qy)
            count = clip_polygon(qx, qy, np.int64(count), -1.0, 0.0, half - u, px, py)
            count = clip_polygon(px, py, np.int64(count), 0.0, 1.0, v + half, qx, qy)
            count = clip_polygon(qx, qy, np.int64(count), 0.0, -1.0, half - v, px, py)
            area = area_and_middle(px, py, np.int64(count))[0]
            if area <= 0.0 and not _meets(u, v, 0.0, ax, ay, bx, by):
                continue
            if written < len(out_row):
                out_row[written], out_middle[written, 0], out_middle[written, 1] = row, u, v
                out_radius[written], out_area[written], out_fate[written] = 1.4142135623730951 * half, area, verdict
            written += 1
    return written


@inner
def _meets(u, v, half, ax, ay, bx, by):
    """Tell whether a square has a place in common with the ellipse of two half axes."""
    size = ax * by - ay * bx
    if size == 0.0:
        return abs(u) <= half and abs(v) <= half
    # in the frame where the ellipse is the unit disk, the square is a parallelogram: the nearest of its places
    x, y = (u * by - v * bx) / size, (v * ax - u * ay) / size
    px, py, qx, qy = half * by / size, -half * ay / size, -half * bx / size, half * ax / size
    if abs(u) <= half and abs(v) <= half:
        return True
    for k in range(4):
        turn = -1.0 if k & 1 else 1.0
        fx, fy = (px, py) if k < 2 else (qx, qy)  # to the middle of a side
        gx, gy = (qx, qy) if k < 2 else (px, py)  # along it
        mx, my = x + turn * fx, y + turn * fy
        length = gx * gx + gy * gy
        t = min(max(-(mx * gx + my * gy) / length, -1.0), 1.0) if length > 0.0 else 0.0
        mx, my = mx + t * gx, my + t * gy
        if mx * mx + my * my < 1.0:
            return True
    return False


@inner
def _passed(row, u, v, half, starts, lines, edges, gone_starts, gone):
    """Tell whether a line passes the disk round a square."""
    reach = 1.4142135623730951 * half
    for k in range(starts[row], min(starts[row + 1], starts[row] + LINES)):
        if abs(lines[k, 0] * u + lines[k, 1] * v - lines[k, 2]) < reach:
            return True
    for k in range(EDGES):
        if edges[row, k, 2] < math.inf and abs(edges[row, k, 0] * u + edges[row, k, 1] * v - edges[row, k, 2]) < reach:
            return True
    for k in range(gone_starts[row], gone_starts[row + 1]):
        if abs(gone[k, 0] * u + gone[k, 1] * v - gone[k, 2]) < reach:
            return True
    return False


@inner
def _fate_at(row, u, v, starts, lines, edges, gone_starts, gone, piece_starts, above, fate):
    """Return what becomes of a place: 0 where it is cut off."""
    for k in range(EDGES):
        if edges[row, k, 2] < math.inf and edges[row, k, 0] * u + edges[row, k, 1] * v > edges[row, k, 2]:
            return 0
    for k in range(gone_starts[row], gone_starts[row + 1]):
        if gone[k, 0] * u + gone[k, 1] * v > gone[k, 2]:
            return 0
    bits = np.int64(0)
    for k in range(starts[row], min(starts[row + 1], starts[row] + LINES)):
        if lines[k, 0] * u + lines[k, 1] * v > lines[k, 2]:
            bits |= np.int64(1) << (k - starts[row])
    for k in range(piece_starts[row], piece_starts[row + 1]):
        if above[k] == bits:
            return fate[k]
    return 0
