"""Seam: where the kept pieces of surfels end at a cut, as segments in their tangent planes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel
from surfel.booleans.cells import EDGES, Cells, frames_of
from surfel.booleans.pieces import LINES, Pieces
from surfel.core.cast import Floats


class Seam(NamedTuple):
    """What is needed to find the segments of one part; kept until somebody asks.

    Parameters
    ----------
    points, normals : Floats, shape (m, 3)
        The surfels that are cut.
    starts, lines : NDArray[np.int64], shape (m + 1,), and Floats, shape (k, 3)
        Their lines.
    owners : NDArray[np.int64], shape (k,)
        The leaf that each line comes from.
    cells : Cells
        What each surfel stands for.
    pieces : Pieces
        The kept ones.
    """

    points: Floats
    normals: Floats
    starts: NDArray[np.int64]
    lines: Floats
    owners: NDArray[np.int64]
    cells: Cells
    pieces: Pieces

    def middles(self) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:
        """Return the middle of every segment, the surfel's normal, the normal of the line, and the other leaf."""
        counts = np.zeros(len(self.pieces.row), np.int64)
        for j in range(LINES):
            counts += self.pieces.used >> j & 1
        total = int(counts.sum())
        which, line, place = np.empty(total, np.int64), np.empty(total, np.int64), np.empty((total, 2))
        found = _segments(
            self.starts, self.lines, self.cells.corners, self.cells.counts, self.cells.edges,
            self.pieces.row, self.pieces.used, self.pieces.above, which, line, place,
        )  # fmt: skip
        row, line, place = self.pieces.row[which[:found]], line[:found], place[:found]
        across, along = frames_of(self.normals[row])
        points = self.points[row] + place[:, :1] * across + place[:, 1:] * along
        towards = self.lines[line, :1] * across + self.lines[line, 1:2] * along
        return points, self.normals[row], towards, self.owners[line]


@kernel
def _segments(starts, lines, corners, counts, edges, row, used, above, which, line, place):
    """Clip every line that bounds a piece to the piece's part of its cell; return how many are left."""
    found = 0
    for p in range(len(row)):
        r = row[p]
        total = min(starts[r + 1] - starts[r], LINES)
        for j in range(total):
            if not used[p] >> j & 1:
                continue
            k = starts[r] + j
            a, b, d = lines[k, 0], lines[k, 1], lines[k, 2]
            x, y = a * d, b * d  # the line is (x, y) + t (-b, a)
            low, high = -1e300, 1e300
            for c in range(counts[r]):
                e = c + 1 if c + 1 < counts[r] else 0
                ux, uy = corners[r, e, 0] - corners[r, c, 0], corners[r, e, 1] - corners[r, c, 1]
                # inside is to the left of every side: nx x + ny y <= nd with the outward normal (uy, -ux)
                low, high = _narrow(uy, -ux, uy * corners[r, c, 0] - ux * corners[r, c, 1], x, y, a, b, low, high)
            for other in range(total):
                if other == j or not used[p] >> other & 1:
                    continue
                sign = -1.0 if above[p] >> other & 1 else 1.0
                o = starts[r] + other
                low, high = _narrow(sign * lines[o, 0], sign * lines[o, 1], sign * lines[o, 2], x, y, a, b, low, high)
            for other in range(EDGES):
                if edges[r, other, 2] < np.inf:
                    low, high = _narrow(
                        edges[r, other, 0], edges[r, other, 1], edges[r, other, 2], x, y, a, b, low, high
                    )
            if high - low > 0.0 and high < 1e299 and low > -1e299:
                t = 0.5 * (low + high)
                which[found], line[found] = p, k
                place[found, 0], place[found, 1] = x - b * t, y + a * t
                found += 1
    return found


@kernel
def _narrow(nx, ny, nd, x, y, a, b, low, high):
    """Narrow the interval of t in which (x, y) + t (-b, a) lies where nx u + ny v <= nd."""
    slope, left = ny * a - nx * b, nd - nx * x - ny * y
    if slope > 0.0:
        high = min(high, left / slope)
    elif slope < 0.0:
        low = max(low, left / slope)
    elif left < 0.0:
        high = low
    return low, high
