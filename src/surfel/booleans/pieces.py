"""Pieces: the cells into which lines part the disks of surfels, and the few convex ones that are left of each."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, kernel
from surfel.booleans.cells import CORNERS, EDGES, Cells, area_and_middle, clip_polygon
from surfel.core.cast import Floats

LINES = 12
"""Most lines that cut one surfel; further ones are left out."""

_SIDES = 16  # of the polygon round a disk or an ellipse
_ROUND = 1.0 / math.cos(math.pi / _SIDES)
_ROOM = CORNERS + _SIDES + 2 * LINES + EDGES + 4
_SLIVER = 1e-3  # parts of a disk smaller than this share are left out, unless they hold some of the cell


class Pieces(NamedTuple):
    """Convex parts of surfels, in the order of the surfels.

    Parameters
    ----------
    row : NDArray[np.int64], shape (p,)
        The surfel, as a row of what was cut.
    used : NDArray[np.int64], shape (p,)
        Bits of the lines that bound the piece.
    above : NDArray[np.int64], shape (p,)
        Bits of the lines that the piece lies above.
    area : Floats, shape (p,)
        Of the part of the surfel's cell.
    middle : Floats, shape (p, 2)
        Of that part; of the part of the disk where there is none of the cell.
    """

    row: NDArray[np.int64]
    used: NDArray[np.int64]
    above: NDArray[np.int64]
    area: Floats
    middle: Floats

    def chosen(self, rows: NDArray[np.generic] | slice) -> Pieces:
        """Return some of the pieces."""
        return Pieces(self.row[rows], self.used[rows], self.above[rows], self.area[rows], self.middle[rows])


def parted(
    starts: NDArray[np.int64], lines: Floats, disks: Floats, cells: Cells,
    before: tuple[NDArray[np.int64], Floats],
) -> Pieces:  # fmt: skip
    """Part surfels by their lines.

    Parameters
    ----------
    starts : NDArray[np.int64], shape (m + 1,)
        Where the lines of each surfel start.
    lines : Floats, shape (k, 3)
        ``a u + b v = d`` in the tangent plane.
    disks : Floats, shape (m, 2, 2)
        Half axes of the disks and ellipses, in the tangent planes.
    cells : Cells
        What each stands for.
    before : NDArray[np.int64], shape (m + 1,), and Floats, shape (j, 3)
        Lines that cut the surfels off already: what is above them is gone.
    """
    room = 8 * len(disks) + 64
    while True:
        found = Pieces(
            np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room),
            np.empty((room, 2)),
        )  # fmt: skip
        written = _part(starts, lines, disks, *cells, *before, *found)
        if written <= room:
            return found.chosen(slice(written))
        room = written


@kernel
def _part(
    starts, lines, disks, corners, counts, edges, gone_starts, gone, out_row, out_used, out_above, out_area, out_middle
):
    """Split every surfel by one line after the other, depth first; return how many pieces there are."""
    levels = LINES + 1
    dx, dy, nd = np.empty((levels + 1, _ROOM)), np.empty((levels + 1, _ROOM)), np.zeros(levels + 1, np.int64)
    cx, cy, nc = np.empty((levels + 1, _ROOM)), np.empty((levels + 1, _ROOM)), np.zeros(levels + 1, np.int64)
    side, used, above = (
        np.zeros(levels + 1, np.int64),
        np.zeros(levels + 1, np.int64),
        np.zeros(levels + 1, np.int64),
    )
    written = 0
    turned = np.empty((_SIDES, 2))
    for s in range(_SIDES):
        turn = 2.0 * math.pi * s / _SIDES
        turned[s, 0], turned[s, 1] = _ROUND * math.cos(turn), _ROUND * math.sin(turn)
    for row in range(len(disks)):
        ax, ay, bx, by = disks[row, 0, 0], disks[row, 0, 1], disks[row, 1, 0], disks[row, 1, 1]
        if ax * by < ay * bx:
            bx, by = -bx, -by
        for s in range(_SIDES):
            a, b = turned[s, 0], turned[s, 1]
            dx[0, s], dy[0, s] = a * ax + b * bx, a * ay + b * by
        nd[0] = _SIDES
        for c in range(counts[row]):
            cx[0, c], cy[0, c] = corners[row, c, 0], corners[row, c, 1]
        nc[0] = counts[row]
        for g in range(gone_starts[row], min(gone_starts[row + 1], gone_starts[row] + LINES)):
            a, b, d = gone[g, 0], gone[g, 1], gone[g, 2]
            nd[0] = _trim(dx, dy, nd[0], a, b, d)
            nc[0] = _trim(cx, cy, nc[0], a, b, d)
        for e in range(EDGES):
            if edges[row, e, 2] < math.inf:
                nd[0] = _trim(dx, dy, nd[0], edges[row, e, 0], edges[row, e, 1], edges[row, e, 2])
        whole, full = area_and_middle(dx[0], dy[0], nd[0])[0], area_and_middle(cx[0], cy[0], nc[0])[0]
        total = min(starts[row + 1] - starts[row], LINES)
        depth = 0
        side[0] = used[0] = above[0] = 0
        while depth >= 0:
            if depth == total:
                area, mx, my = area_and_middle(cx[depth], cy[depth], nc[depth])
                if area <= 0.0:
                    _, mx, my = area_and_middle(dx[depth], dy[depth], nd[depth])
                if written < len(out_row):
                    out_row[written], out_used[written], out_above[written] = row, used[depth], above[depth]
                    out_area[written], out_middle[written, 0], out_middle[written, 1] = area, mx, my
                written += 1
                depth -= 1
                continue
            if side[depth] == 2:
                depth -= 1
                continue
            # side 0: below the line; side 1: above it
            up = side[depth] == 1
            side[depth] += 1
            line = starts[row] + depth
            sign = -1.0 if up else 1.0
            a, b, d = sign * lines[line, 0], sign * lines[line, 1], sign * lines[line, 2]
            passed = _passes(dx[depth], dy[depth], nd[depth], a, b, d) or _passes(
                cx[depth], cy[depth], nc[depth], a, b, d
            )
            nd[depth + 1] = clip_polygon(dx[depth], dy[depth], nd[depth], a, b, d, dx[depth + 1], dy[depth + 1])
            nc[depth + 1] = clip_polygon(cx[depth], cy[depth], nc[depth], a, b, d, cx[depth + 1], cy[depth + 1])
            disk = area_and_middle(dx[depth + 1], dy[depth + 1], nd[depth + 1])[0]
            if disk <= _SLIVER * whole:
                cell = area_and_middle(cx[depth + 1], cy[depth + 1], nc[depth + 1])[0]
                if cell <= 1e-6 * max(whole, full):
                    continue
            bit = np.int64(1) << depth
            side[depth + 1] = 0
            # a line that leaves a sliver of the other side bounds the piece all the same
            used[depth + 1] = used[depth] | (bit if passed else np.int64(0))
            above[depth + 1] = above[depth] | (bit if up else np.int64(0))
            depth += 1
    return written


@inner
def _passes(x, y, count, a, b, d):
    """Tell whether a line leaves something of a polygon on both sides."""
    below = above = False
    for c in range(count):
        over = a * x[c] + b * y[c] - d
        below |= over < 0.0
        above |= over > 0.0
    return below and above


@kernel
def _trim(x, y, count, a, b, d):
    """Cut off in place what the first polygon has above a line; the next one's room is scratch."""
    left = clip_polygon(x[0], y[0], count, a, b, d, x[1], y[1])
    for c in range(left):
        x[0, c], y[0, c] = x[1, c], y[1, c]
    return left


def merged(pieces: Pieces, fate: NDArray[np.int8]) -> tuple[Pieces, NDArray[np.int8]]:
    """Join pieces that were parted by a line which changes nothing, from the last line back to the first.

    Parameters
    ----------
    pieces : Pieces
        All of them.
    fate : NDArray[np.int8], shape (p,)
        What becomes of each; only those of one fate are joined.

    Returns
    -------
    Pieces, NDArray[np.int8]
        Fewer, and their fates.
    """
    pieces = pieces.chosen(np.arange(len(fate)))  # a copy
    pieces.above[:] &= pieces.used  # which side of a line that passes by says nothing
    every = int(np.bitwise_or.reduce(pieces.used, initial=0))
    for line in reversed(range(every.bit_length())):
        bit = np.int64(1) << line
        beside = np.flatnonzero(pieces.used & bit)
        above = pieces.above[beside]
        order = np.lexsort((above & bit, above & ~bit, pieces.used[beside], pieces.row[beside]))
        beside = beside[order]
        keys = (pieces.row[beside], pieces.used[beside], pieces.above[beside] & ~bit, fate[beside])
        pairs = np.logical_and.reduce([key[:-1] == key[1:] for key in keys])
        first, second = beside[:-1][pairs], beside[1:][pairs]
        if not len(first):
            continue
        area = pieces.area[first] + pieces.area[second]
        share = np.where(area > 0.0, pieces.area[first] / np.where(area > 0.0, area, 1.0), 0.5)[:, None]
        middle = share * pieces.middle[first] + (1.0 - share) * pieces.middle[second]
        pieces.used[first] &= ~bit
        pieces.above[first] &= ~bit
        pieces.area[first], pieces.middle[first] = area, middle
        keep = np.ones(len(fate), bool)
        keep[second] = False
        pieces, fate = pieces.chosen(keep), fate[keep]
    return pieces, fate
