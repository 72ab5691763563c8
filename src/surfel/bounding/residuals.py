"""What all points say about a reference spline, micro-cell by micro-cell: one pass of fused kernels.

Heights are multiplied by ``sign``: +1 for a surface above, -1 for one below, so that a fit always bounds from above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfel._numba import rows, threads_for
from surfel.bounding.compare import (
    AXIS_Z,
    BLOCK,
    CONSTANTS,
    HEIGHT,
    LEAST_R,
    LOCAL_U,
    LOCAL_V,
    RESIDUAL,
    ROWS,
    SPLIT,
    SUM_R,
    SUM_Z,
    SUMS,
    WIDE,
    compare_and_weigh_eight,
    compare_eight,
)
from surfel.bounding.frame import Frame
from surfel.bounding.occupancy import Quarters
from surfel.bounding.order import Order, fetch_block, set_cell, sort_block
from surfel.core.cast import Floats, Integers


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
    moments : Floats, shape (n - 1, m - 1, 16)
        Sums over the points of 36 times their weights on the 16 coefficients of their cell.
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
        along_v = np.zeros((n, m + 3, 4))
        for j in range(4):
            along_v[:, j : j + m] += self.moments.reshape(n, m, 4, 4)[..., j]
        sums = np.zeros((n + 3, m + 3))
        for i in range(4):
            sums[i : i + n] += along_v[..., i]
        return np.asarray(sums / (36.0 * max(self.points, 1)))

    def mean_value(self, coefficients: Floats) -> float:
        """Return the mean over the points of a spline's value."""
        return float((self.mean_weights() * coefficients).sum())

    def mean_gap(self, surface: Floats, reference: Floats) -> float:
        """Return the mean gap between the points and a surface; the residuals are those to ``reference``."""
        return self.mean_value(surface - reference) - float(self.total[1]) / max(self.points, 1)

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
        np.full(cells, np.inf),
        np.zeros((*micro, 2)),
        np.zeros(micro),
        np.zeros(micro, np.int64),
        np.zeros(cells, np.uint8),
        np.zeros((*cells, 16)),
        np.zeros(2),
    )


def keep_residuals(
    kept: Residuals,
    points: Floats,
    frame: Frame,
    coefficients: Floats,
    sign: float,
    order: Order | None = None,
    *,
    weigh: bool = True,
) -> None:
    """Compare points with a spline and keep what matters of each micro-cell.

    Many points are cut in two, wherever there are threads or not, and the halves are joined in order: so the sums are
    the same to the last bit on any number of threads. An ``order`` is filled in, or used if it has been; without
    ``weigh`` the moments are left alone.
    """
    order = order or Order.of(len(points), frame)
    parts = order.parts
    if parts == 1:
        arrays = [getattr(kept, name)[None] for name in _KEPT]
    else:
        none = no_residuals(frame, kept.split)
        arrays = [np.repeat(getattr(none, name)[None], parts, axis=0) for name in _KEPT]
    with threads_for(len(points)):
        _keep_residuals(
            parts,
            points,
            frame.numbers(),
            coefficients,
            float(sign),
            np.int64(kept.split),
            order.rank,
            order.starts,
            np.int64(order.block),
            order.known,
            weigh,
            *arrays,
        )
    order.known = True
    if parts == 1:
        return
    for most, least, uv, height, count, occupancy, moments, totals in zip(*arrays, strict=True):
        higher = most > kept.largest
        np.copyto(kept.uv, uv, where=higher[:, :, None])
        np.copyto(kept.height, height, where=higher)
        np.maximum(kept.largest, most, out=kept.largest)
        np.minimum(kept.smallest, least, out=kept.smallest)
        np.bitwise_or(kept.occupancy, occupancy, out=kept.occupancy)
        for into, more in ((kept.count, count), (kept.moments, moments), (kept.total, totals)):
            into += more


_KEPT = ("largest", "smallest", "uv", "height", "count", "occupancy", "moments", "total")


@rows
def _keep_residuals(
    begin, end, p, f, coefficients, sign, split, rank, starts, block, known, weigh,
    largest, smallest, uv, height, count, occupancy, moments, totals,
):  # fmt: skip
    w, marks, sums = np.empty(ROWS * BLOCK), np.zeros(BLOCK + 8, np.int32), np.zeros(8 * SUMS)
    c = np.empty(CONSTANTS)
    c[:13] = f[:13]
    c[AXIS_Z : AXIS_Z + 3] *= sign
    n, m = occupancy.shape[1:]
    wide = m * split
    c[SPLIT], c[WIDE] = split, wide
    b, width, flat = coefficients.ravel(), coefficients.shape[1], p.ravel()
    places = np.empty(block, np.int32)
    for part in range(begin, end):
        all_sums, quarters, least = moments[part].ravel(), occupancy[part].ravel(), smallest[part].ravel()
        most, many = largest[part].ravel(), count[part].ravel()
        where, high = uv[part].ravel(), height[part].ravel()
        sums[:] = 0.0
        last = p.shape[0] * (part + 1) // len(totals)
        for number, first in enumerate(range(p.shape[0] * part // len(totals), last, block)):
            begins = starts[part, number]
            if known:
                w[0] = fetch_block(flat, first, min(block, last - first))
            else:
                sort_block(flat, first, min(block, last - first), f, places, rank, begins)
            for cell in range(n * m):
                if begins[cell] == begins[cell + 1]:
                    continue
                h, k = cell // m, cell % m
                set_cell(b, width, h, k, c)
                corner = h * split * wide + k * split
                for i in range(8):
                    sums[8 * LEAST_R + i], marks[BLOCK + i] = np.inf, 0
                for at in range(begins[cell], begins[cell + 1], BLOCK):
                    here = min(BLOCK, begins[cell + 1] - at)
                    if weigh:
                        for i in range(0, here, 8):
                            compare_and_weigh_eight(flat, rank, first, at, here, w, i, c, marks, sums)
                    else:
                        for i in range(0, here, 8):
                            compare_eight(flat, rank, first, at, here, w, i, c, marks, sums)
                    for i in range(here):
                        r, micro = w[RESIDUAL * BLOCK + i], corner + np.int64(marks[i])
                        many[micro] += 1
                        if r > most[micro]:
                            most[micro] = r
                            where[2 * micro] = h + w[LOCAL_U * BLOCK + i]
                            where[2 * micro + 1] = k + w[LOCAL_V * BLOCK + i]
                            high[micro] = w[HEIGHT * BLOCK + i]
                for i in range(8):
                    least[cell] = min(least[cell], sums[8 * LEAST_R + i])
                    quarters[cell] |= np.uint8(marks[BLOCK + i])
                if weigh:
                    for i in range(16):
                        total = 0.0
                        for j in range(8):
                            total += sums[8 * i + j]
                            sums[8 * i + j] = 0.0
                        all_sums[16 * cell + i] += total
        for i in range(8):
            totals[part, 0] += sums[8 * SUM_Z + i]
            totals[part, 1] += sums[8 * SUM_R + i]
