"""What all points say about a reference spline, micro-cell by micro-cell: one pass of fused kernels.

Heights are multiplied by ``sign``: +1 for a surface above, -1 for one below, so that a fit always bounds from above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfel._numba import kernel, rows, threads_for
from surfel.bounding.bezier import over_windows
from surfel.bounding.buckets import EIGHT, Buckets, insert_one, set_cell
from surfel.bounding.compare import CONSTANTS, LEAST_R, SPLIT, SUM_R, SUM_Z, SUMS, compare_and_weigh_run, compare_run
from surfel.bounding.frame import Frame
from surfel.bounding.occupancy import Quarters
from surfel.bounding.records import HEIGHT, LOCAL_U, LOCAL_V, RECORD, copy_record, insert_eight
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
        sums = np.zeros((n + 3, m + 3))
        _collect(self.moments, sums)
        return np.asarray(sums / (36.0 * max(self.points, 1)))

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
        np.zeros((*cells, 16)),
        np.zeros(2),
    )


def keep_residuals(
    kept: Residuals,
    points: Floats,
    frame: Frame,
    coefficients: Floats,
    sign: float,
    buckets: Buckets | None = None,
    *,
    weigh: bool = True,
) -> None:
    """Compare points with a spline and keep what matters of each micro-cell.

    Many points are cut in two, wherever there are threads or not, and the halves are joined in order: so the sums are
    the same to the last bit on any number of threads. Without ``weigh`` the moments are left alone.
    """
    buckets = buckets or Buckets.of(len(points), kept.occupancy.size)
    parts = buckets.parts
    if parts == 1:
        arrays = [getattr(kept, name)[None] for name in _KEPT]
    else:
        none = no_residuals(frame, kept.split)
        arrays = [np.repeat(getattr(none, name)[None], parts, axis=0) for name in _KEPT]
    with threads_for(len(points)):
        _keep_residuals(
            parts,
            points,
            frame.signed_numbers(sign),
            coefficients,
            np.int64(kept.split),
            buckets.cells,
            buckets.records,
            weigh,
            *arrays,
        )
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


@kernel
def _collect(moments, sums):
    n, m = moments.shape[:2]
    for h in range(n):
        for k in range(m):
            for i in range(4):
                for j in range(4):
                    sums[h + i, k + j] += moments[h, k, 4 * i + j]


@rows
def _keep_residuals(
    begin, end, p, f, coefficients, split, cells, records, weigh,
    largest, smallest, uv, height, count, occupancy, moments, totals,
):  # fmt: skip
    c = np.empty(CONSTANTS)
    n, m = occupancy.shape[1:]
    c[SPLIT] = split
    room = records.shape[2] - EIGHT
    residual, marks, todo = np.empty(room + 8), np.empty(room + 9, np.int32), np.empty(room + 8, np.int32)
    stride, wide = room + EIGHT, m * split
    sums, filled = np.empty(SUMS), np.empty(n * m, np.int32)
    aside, here_many = np.zeros(16, np.int64), np.empty(16, np.int32)  # where micro-cells lie from the cell's first
    for i in range(split * split):
        aside[i] = i // split * wide + i % split
    b, width, flat = coefficients.ravel(), coefficients.shape[1], p.ravel()
    for part in range(begin, end):
        all_sums, quarters, least = moments[part].ravel(), occupancy[part].ravel(), smallest[part].ravel()
        most, many = largest[part].ravel(), count[part].ravel()
        where, high, bucket = uv[part].ravel(), height[part].ravel(), records[part].ravel()
        sums[:], filled[:] = 0.0, 0
        at, last = p.shape[0] * part // len(totals), p.shape[0] * (part + 1) // len(totals)
        full = rest = 0  # bits of the last eight that filled buckets, and cells that were looked through in the end
        while True:
            while full == 0 and at + 8 <= last:
                full = insert_eight(flat, 3 * at, f, cells, at, bucket, room, filled)
                at += 8
            cell = -1
            if full != 0:
                i = at - 8
                while full >> (i - at + 8) & 1 == 0:
                    i += 1
                full &= full - 1
                cell = np.int64(cells[i])
            else:  # all but the last few are in: what buckets still hold
                if at < last:
                    insert_one(flat, at, f, cells, bucket, stride, filled)
                    at += 1
                    continue
                while cell < 0 and rest < n * m:
                    if filled[rest] > 0:
                        cell = rest
                    rest += 1
                if cell < 0:
                    break
            run, held = cell * stride, np.int64(filled[cell])
            count_here = min(held, room) if rest == 0 else held
            filled[cell] = held - count_here
            ends = (count_here + 7) // 8 * 8
            for i in range(count_here, ends):
                copy_record(bucket, run, bucket, run + i)
            h, k = cell // m, cell % m
            set_cell(b, width, h, k, c)
            if weigh:
                compare_and_weigh_run(bucket, run, count_here, c, residual, marks, here_many, all_sums, sums, 16 * cell)
            else:
                compare_run(bucket, run, count_here, c, residual, marks, here_many, all_sums, sums, 16 * cell)
            least[cell] = min(least[cell], sums[LEAST_R])
            quarters[cell] |= np.uint8(marks[ends])
            corner, higher = h * split * wide + k * split, 0
            for i in range(split * split):
                many[corner + aside[i]] += here_many[i]
            for i in range(count_here):  # without branches: which is higher cannot be foretold
                todo[higher] = i
                higher += 1 if residual[i] > most[corner + aside[marks[i]]] else 0
            for j in range(higher):
                i = np.int64(todo[j])
                micro = corner + aside[marks[i]]
                if residual[i] > most[micro]:
                    most[micro] = residual[i]
                    where[2 * micro] = h + bucket[RECORD * (run + i) + LOCAL_U]
                    where[2 * micro + 1] = k + bucket[RECORD * (run + i) + LOCAL_V]
                    high[micro] = bucket[RECORD * (run + i) + HEIGHT]
            for i in range(filled[cell]):  # came into the full bucket with the last eight
                copy_record(bucket, run + count_here + i, bucket, run + i)
        for i in range(8):
            totals[part, 0] += sums[SUM_Z + i]
            totals[part, 1] += sums[SUM_R + i]
