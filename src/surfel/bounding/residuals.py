"""What all points say about a reference spline, micro-cell by micro-cell: one pass of fused kernels.

Heights are multiplied by ``sign``: +1 for a surface above, -1 for one below, so that a fit always bounds from above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel, rows, threads_for
from surfel.bounding.bezier import over_windows
from surfel.bounding.compare import (
    BLOCK,
    CELL,
    COUNTED,
    LARGEST,
    PLACES,
    RECORD,
    SCRATCH,
    STEP,
    SUM_R,
    SUM_Z,
    TALLY,
    WHO,
    WIDTH,
    place_eight,
    settle_eight,
    take_point,
    weigh_point,
)
from surfel.bounding.frame import Frame, project
from surfel.bounding.occupancy import Quarters
from surfel.bounding.passes import HALVED
from surfel.core.cast import Floats, Integers

MOST = 1 << 27
"""Points that are compared in one part, at most: the tallies have room for no more."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """What all points say about a reference spline, micro-cell by micro-cell.

    Parameters
    ----------
    split : int
        Micro-cells along a side of a cell.
    largest : Floats, shape (a, b)
        Largest residual (height less spline); -inf where the micro-cell is empty.
    smallest : Floats, shape (n - 1, m - 1)
        Smallest residual of each cell; inf where it is empty.
    uv, height : Floats, shape (a, b, 2) and (a, b)
        The point of the largest residual.
    count : Integers, shape (a, b)
        Points in the micro-cell.
    occupancy : Quarters, shape (n - 1, m - 1)
        Which quarters of the cells have data.
    weights : Floats, shape (n + 2, m + 2)
        Sums over the points of 36 times their weights on each coefficient.
    total : Floats, shape (2,)
        Sum of the heights, and of the residuals.
    """

    split: int
    largest: Floats
    smallest: Floats
    uv: Floats
    height: Floats
    count: Integers
    occupancy: Quarters
    weights: Floats
    total: Floats

    @property
    def points(self) -> int:
        """How many points were compared."""
        return int(self.count.sum())

    @property
    def mean_height(self) -> float:
        """Mean height of the points."""
        return float(self.total[0]) / max(self.points, 1)

    def mean_weights(self) -> Floats:
        """Return the mean weight of each coefficient over the points, shape (n + 2, m + 2); they add up to 1."""
        return np.asarray(self.weights / (36.0 * max(self.points, 1)))

    def mean_value(self, coefficients: Floats) -> float:
        """Return the mean over the points of a spline's value."""
        return float((self.mean_weights() * coefficients).sum())

    def mean_gap(self, surface: Floats, reference: Floats) -> float:
        """Return the mean gap between the points and a surface; the residuals are those to ``reference``."""
        return self.mean_value(surface - reference) - float(self.total[1]) / max(self.points, 1)

    def by_cell(self) -> Floats:
        """Return the largest residual of each cell, shape (n - 1, m - 1)."""
        return over_windows(self.largest, self.split, self.split)


def no_residuals(frame: Frame, split: int) -> Residuals:
    """Return empty residuals, to be filled by :func:`keep_residuals`."""
    cells = int(frame.cells[0]), int(frame.cells[1])
    micro = cells[0] * split, cells[1] * split
    return Residuals(
        split,
        np.full(micro, -np.inf),
        np.full(cells, np.inf),
        np.zeros((*micro, 2)),
        np.zeros(micro),
        np.zeros(micro, np.int64),
        np.zeros(cells, np.uint8),
        np.zeros((cells[0] + 3, cells[1] + 3)),
        np.zeros(2),
    )


def keep_residuals(
    kept: Residuals,
    points: Floats,
    frame: Frame,
    coefficients: Floats,
    sign: float,
    cells: NDArray[np.int32] | None = None,
) -> None:
    """Compare points with a spline and keep what matters of each micro-cell.

    Many points are cut in two, wherever there are threads or not, and the halves are joined in order: so the sums are
    the same to the last bit on any number of threads. The cell of each point, counted in rows along v, is written to
    ``cells``.
    """
    n, m = kept.occupancy.shape
    repeated = max(0, BLOCK - len(points)) if len(points) else 0  # the first, which does not count more than once
    points = np.concatenate([np.repeat(points[:1], repeated, axis=0), points]) if repeated else points
    parts = max(2 if len(points) >= HALVED else 1, -(-len(points) // MOST))
    found = cells if cells is not None and not repeated else np.empty(len(points), np.int32)
    records = np.zeros((parts, kept.largest.size, RECORD))
    records[:, :, LARGEST] = -np.inf
    least, totals = np.full((parts, n * m), np.inf), np.zeros((parts, 16))
    shares = np.zeros((parts, 4, n + 3, side_of(m + 3)))
    numbers, flat, split, step = frame.signed_numbers(sign), points.ravel(), kept.split, side_of(m + 3)
    grid = np.array([split, m, m * split, m + 3, step, (n + 3) * step], np.float64)
    with threads_for(len(points)):
        _keep_residuals(
            parts, flat, numbers, grid, coefficients.ravel(), repeated, found, records, least, shares, totals
        )
    if cells is not None and repeated:
        cells[:] = found[repeated:]
    for part in range(parts):
        first = len(points) * part // parts
        _join(
            records[part], records[part].ravel().view(np.int32), flat[3 * first :], numbers, np.int64(split),
            kept.largest, kept.uv, kept.height, kept.count, kept.occupancy,
        )  # fmt: skip
        np.minimum(kept.smallest, least[part].reshape(n, m), out=kept.smallest)
        kept.total[:] += totals[part].reshape(2, -1).sum(axis=1)
        _collect(shares[part], kept.weights)


def side_of(width: int) -> int:
    """Return how long the rows of weights are for rows of coefficients of a width: a multiple of four."""
    return (width + 3) // 4 * 4


@rows
def _keep_residuals(begin, end, p, f, grid, b, repeated, cells, records, least, shares, totals):
    w, places = np.zeros(SCRATCH), np.empty(PLACES, np.int32)
    width, step = np.int64(grid[WIDTH]), np.int64(grid[STEP])
    for part in range(begin, end):
        own, lows, sums = records[part].ravel(), least[part], shares[part].ravel()
        start, last = len(cells) * part // len(totals), len(cells) * (part + 1) // len(totals)
        w[SUM_Z : SUM_R + 8] = 0.0
        for begun in range(start + repeated, last, BLOCK):
            at = min(begun, last - BLOCK)  # the last block may begin with points that were in the one before
            seen = begun - at
            for i in range(0, BLOCK, 8):
                place_eight(p, 3 * (at + i), f, grid, i, w, places)
            for i in range(seen, BLOCK):
                weigh_point(i, b, width, sums, step, w, places)
            for i in range(seen // 8 * 8, BLOCK, 8):
                settle_eight(i, seen - i, at - start + i, w, places)
            for i in range(seen, BLOCK):
                take_point(i, own, lows, w, places)
                cells[at + i] = places[CELL + i]
        totals[part] = w[SUM_Z : SUM_R + 8]


@kernel
def _join(records, whole, p, f, split, largest, uv, height, count, occupancy):
    wide = largest.shape[1]
    for h in range(occupancy.shape[0]):
        for a in range(h * split, (h + 1) * split):
            for k in range(occupancy.shape[1]):
                quarters = np.uint8(0)
                for b in range(k * split, (k + 1) * split):
                    i = a * wide + b
                    tally = np.int64(whole[4 * i + TALLY])
                    count[a, b] += tally & ((1 << COUNTED) - 1)
                    quarters |= np.uint8(tally >> COUNTED & 15)
                    if records[i, LARGEST] > largest[a, b]:
                        largest[a, b] = records[i, LARGEST]
                        at = 3 * np.int64(whole[4 * i + WHO])
                        uv[a, b, 0], uv[a, b, 1], height[a, b] = project(f, p[at], p[at + 1], p[at + 2])
                occupancy[h, k] |= quarters


@kernel
def _collect(shares, sums):
    # grid g holds what points in columns k of cells with k % 4 = g give: its place j stands for the coefficient j + g
    for g in range(4):
        for i in range(sums.shape[0]):
            for j in range(sums.shape[1] - g):
                sums[i, j + g] += shares[g, i, j]
