"""What all points say about a reference spline, micro-cell by micro-cell: one pass of fused kernels.

Heights are multiplied by ``sign``: +1 for a surface above, -1 for one below, so that a fit always bounds from above.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from surfel._numba import rows, threads_for
from surfel.bounding.blocks import (
    CELL_U,
    CELL_V,
    HALVED,
    HEIGHT,
    LOCAL_U,
    LOCAL_V,
    ROOM,
    ROWS,
    VALUE,
    evaluate_block,
    number_block,
    place_block,
    weigh_block,
)
from surfel.bounding.frame import Frame
from surfel.bounding.lanes import BLOCK, add_lane
from surfel.bounding.occupancy import Quarters
from surfel.core.cast import Floats, Integers


@dataclass(frozen=True, eq=False)
class Residuals:
    """What all points say about a reference spline, micro-cell by micro-cell.

    Parameters
    ----------
    split : int
        Micro-cells along a side of a cell.
    largest, smallest : Floats, shape (a, b)
        Largest and smallest residual (height less spline); -inf and inf where the micro-cell is empty.
    uv, height : Floats, shape (a, b, 2) and (a, b)
        The point of the largest residual.
    count : Integers, shape (a, b)
        Points in the micro-cell.
    occupancy : Quarters, shape (n - 1, m - 1)
        Which quarters of the cells have data.
    moments : Floats, shape (n - 1, m - 1, 16)
        Sums over the points of 36 times their weights on the 16 coefficients of their cell.
    total : Floats, shape (1,)
        Sum of the heights.
    """

    split: int
    largest: Floats
    smallest: Floats
    uv: Floats
    height: Floats
    count: Integers
    occupancy: Quarters
    moments: Floats
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
        n, m = self.occupancy.shape
        sums = np.zeros((n + 3, m + 3))
        for i in range(4):
            for j in range(4):
                sums[i : i + n, j : j + m] += self.moments[:, :, 4 * i + j]
        return np.asarray(sums / (36.0 * max(self.points, 1)))

    def mean_value(self, coefficients: Floats) -> float:
        """Return the mean over the points of a spline's value."""
        return float((self.mean_weights() * coefficients).sum())

    def gap_limit(self, surface: Floats, reference: Floats) -> float:
        """Return what no gap between a point and ``surface`` exceeds, from the residuals to ``reference``."""
        n, m = self.occupancy.shape
        above = np.full((n, m), -np.inf)
        for i in range(4):
            for j in range(4):
                np.maximum(above, (surface - reference)[i : i + n, j : j + m], out=above)
        smallest = self.smallest.reshape(n, self.split, m, self.split).min(axis=(1, 3))
        filled = np.isfinite(smallest)
        return float((above - smallest)[filled].max(initial=-np.inf))

    def by_cell(self) -> Floats:
        """Return the largest residual of each cell, shape (n - 1, m - 1)."""
        a, b = self.occupancy.shape
        return np.asarray(self.largest.reshape(a, self.split, b, self.split).max(axis=(1, 3)))


def no_residuals(frame: Frame, split: int) -> Residuals:
    """Return empty residuals, to be filled by :func:`keep_residuals`."""
    cells = int(frame.cells[0]), int(frame.cells[1])
    micro = cells[0] * split, cells[1] * split
    return Residuals(
        split,
        np.full(micro, -np.inf),
        np.full(micro, np.inf),
        np.zeros((*micro, 2)),
        np.zeros(micro),
        np.zeros(micro, np.int64),
        np.zeros(cells, np.uint8),
        np.zeros((*cells, 16)),
        np.zeros(1),
    )


def keep_residuals(kept: Residuals, points: Floats, frame: Frame, coefficients: Floats, sign: float) -> None:
    """Compare points with a spline and keep what matters of each micro-cell.

    Many points are cut in two, wherever there are threads or not, and the halves are joined in order: so the sums are
    the same to the last bit on any number of threads.
    """
    if len(points) < HALVED:
        _compare(1, points, frame, coefficients, sign, kept.split, [getattr(kept, name)[None] for name in _KEPT])
        return
    halves = [no_residuals(frame, kept.split) for _ in range(2)]
    both = [np.stack([getattr(half, name) for half in halves]) for name in _KEPT]
    _compare(2, points, frame, coefficients, sign, kept.split, both)
    for most, least, uv, height, count, occupancy, moments, total in zip(*both, strict=True):
        higher = most > kept.largest
        np.copyto(kept.uv, uv, where=higher[:, :, None])
        np.copyto(kept.height, height, where=higher)
        np.maximum(kept.largest, most, out=kept.largest)
        np.minimum(kept.smallest, least, out=kept.smallest)
        np.bitwise_or(kept.occupancy, occupancy, out=kept.occupancy)
        for into, more in ((kept.count, count), (kept.moments, moments), (kept.total, total)):
            into += more


_KEPT = ("largest", "smallest", "uv", "height", "count", "occupancy", "moments", "total")


def _compare(
    parts: int, points: Floats, frame: Frame, coefficients: Floats, sign: float, split: int, kept: list[Any]
) -> None:
    with threads_for(len(points)):
        _keep_residuals(parts, points, frame.numbers(), coefficients, float(sign), np.int64(split), *kept)


@rows
def _keep_residuals(
    begin, end, p, f, coefficients, sign, split, largest, smallest, uv, height, count, occupancy, moments, totals
):
    w, place = np.empty(ROWS * BLOCK), np.empty(3 * BLOCK, np.int32)
    b, width, flat = coefficients.ravel(), coefficients.shape[1], p.ravel()
    for part in range(begin, end):
        sums, quarters = moments[part].ravel(), occupancy[part].ravel()
        most, least, many = largest[part].ravel(), smallest[part].ravel(), count[part].ravel()
        where, high = uv[part].ravel(), height[part].ravel()
        total = 0.0
        last = p.shape[0] * (part + 1) // len(totals)
        for first in range(p.shape[0] * part // len(totals), last, BLOCK):
            here = min(BLOCK, last - first)
            place_block(flat, first, here, f, sign, w)
            weigh_block(here, w)
            number_block(here, width, split, w, place)
            evaluate_block(here, b, width, place, w)
            for i in range(here):  # without a branch, so that it is done by whole vectors
                s, t = w[LOCAL_U * BLOCK + i], w[LOCAL_V * BLOCK + i]
                early = t <= 1.0 - s
                low, side = (4.0 if early else 2.0), (1.0 if early else 8.0)
                w[ROOM * BLOCK + i] = low if t <= s else side
                w[VALUE * BLOCK + i] = w[HEIGHT * BLOCK + i] - w[VALUE * BLOCK + i]
            for i in range(here):
                add_lane(sums, np.int64(place[BLOCK + i]), w, i)
            for i in range(here):
                z, r = w[HEIGHT * BLOCK + i], w[VALUE * BLOCK + i]
                at, cell = np.int64(place[2 * BLOCK + i]), np.int64(place[BLOCK + i])
                total += z
                quarters[cell] |= np.uint8(w[ROOM * BLOCK + i])
                many[at] += 1
                if r > most[at]:
                    most[at] = r
                    where[2 * at] = w[CELL_U * BLOCK + i] + w[LOCAL_U * BLOCK + i]
                    where[2 * at + 1] = w[CELL_V * BLOCK + i] + w[LOCAL_V * BLOCK + i]
                    high[at] = z
                if r < least[at]:
                    least[at] = r
        totals[part, 0] += total
