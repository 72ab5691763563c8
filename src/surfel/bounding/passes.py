"""Passes over the points: everything that a fit asks of all of them, each in one sweep of fused kernels.

Heights are multiplied by ``sign``: +1 for a surface above, -1 for one below, so that a fit always bounds from above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfel._numba import inlined, kernel
from surfel.bounding.blocks import (
    CELL_U,
    CELL_V,
    HEIGHT,
    LOCAL_U,
    LOCAL_V,
    ROWS,
    VALUE,
    evaluate_block,
    place_block,
    weigh_block,
)
from surfel.bounding.evaluate import cell_of
from surfel.bounding.frame import Frame, project
from surfel.bounding.lanes import BLOCK, add_lane
from surfel.bounding.occupancy import Quarters, quarter
from surfel.core.cast import Floats, Integers

LARGEST = 1e300
"""Coordinates beyond this are refused: differences and products of coefficients must not overflow."""


def survey(points: Floats, rotation: Floats) -> tuple[bool, Floats, Floats]:
    """Return whether all is finite, and the box of the rotated coordinates (lowest, highest; three numbers each)."""
    lanes = np.empty((7, BLOCK))
    lanes[:3], lanes[3:6], lanes[6] = np.inf, -np.inf, 0.0
    _survey(points, rotation.ravel().copy(), lanes.ravel())
    lowest, highest = lanes[:3].min(axis=1), lanes[3:6].max(axis=1)
    usable = bool((lanes[6] == 0.0).all()) and bool(max(np.abs(lowest).max(), np.abs(highest).max()) <= LARGEST)
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
    """Keep the highest point of each micro-cell; of equal ones the first. Looks at every ``every``-th point only."""
    _keep_highest(points, frame.numbers(), sign, np.int64(every), np.int64(highest.split), highest.uv, highest.height)


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
    """Compare points with a spline and keep what matters of each micro-cell."""
    kept.total[0] += _keep_residuals(
        points, frame.numbers(), coefficients, sign, np.int64(kept.split), kept.largest, kept.smallest,
        kept.uv, kept.height, kept.count, kept.occupancy, kept.moments,
    )  # fmt: skip


@kernel
def _survey(p, r, lanes):
    # Lanes of a block keep extremes of their own: a running minimum of one number would not be vectorized.
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8]
    for first in range(0, p.shape[0], BLOCK):
        q = p[first : first + BLOCK]
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
def _keep_highest(p, f, sign, every, split, uv, height):
    n, m = np.int64(f[13]), np.int64(f[14])
    for i in range(0, p.shape[0], every):
        u, v, z = project(f, p[i, 0], p[i, 1], p[i, 2])
        z *= sign
        h, k = cell_of(u, n), cell_of(v, m)
        a, b = micro_cell(h, u - h, split), micro_cell(k, v - k, split)
        if z > height[a, b]:
            height[a, b] = z
            uv[a, b, 0], uv[a, b, 1] = u, v


@kernel
def _keep_residuals(p, f, b, sign, split, largest, smallest, uv, height, count, occupancy, moments):
    w, columns = np.empty(ROWS * BLOCK), np.empty(4 * BLOCK)
    cells = occupancy.shape[1]
    sums = moments.ravel()
    total = 0.0
    for first in range(0, p.shape[0], BLOCK):
        q = p[first : first + BLOCK]
        here = q.shape[0]
        place_block(q, f, sign, w)
        weigh_block(here, w)
        evaluate_block(here, b, w, columns)
        for i in range(here):
            z, s, t = w[HEIGHT * BLOCK + i], w[LOCAL_U * BLOCK + i], w[LOCAL_V * BLOCK + i]
            h, k = np.int64(w[CELL_U * BLOCK + i]), np.int64(w[CELL_V * BLOCK + i])
            r = z - w[VALUE * BLOCK + i]
            total += z
            occupancy[h, k] |= quarter(s, t)
            add_lane(sums, h * cells + k, w, i)
            x, y = micro_cell(h, s, split), micro_cell(k, t, split)
            count[x, y] += 1
            if r > largest[x, y]:
                largest[x, y] = r
                uv[x, y, 0], uv[x, y, 1] = h + s, k + t
                height[x, y] = z
            if r < smallest[x, y]:
                smallest[x, y] = r
    return total
