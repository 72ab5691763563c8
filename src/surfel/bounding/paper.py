"""Mode ``paper``: the tensor surface of sec. 6: scattered data along the u-lines, broken lines along v.

Each point is projected to its two u-lines at its own height, so the blend of the two is its height. The exchange of
sec. 5 looks at all points once, then at those that came near its lines' bound. Between these looks it works on the
points that have ever been the worst of their line and abscissa, and on the highest of the micro-cells. It ends when no
point that it looks at lies above the bound.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import inner, kernel
from surfel.bounding.banded import COLUMNS
from surfel.bounding.corners import over_corners
from surfel.bounding.enclosure import second
from surfel.bounding.evaluate import cell_of
from surfel.bounding.frame import Frame
from surfel.bounding.job import Job, Outcome
from surfel.bounding.records import BLOCK, HEIGHT, LOCAL_U, LOCAL_V, RECORD, fetch_records
from surfel.bounding.scattered import AGREED, nearest, scattered
from surfel.core.cast import Floats, Integers

NEAR = 0.005
"""Points that come within this share of the range of the bound are looked at again."""

FEW = 2
"""They are kept apart if there is no more than one in so many."""

TAME = 4.0
"""Coefficients are kept within this many ranges of the middle; where that costs safety, the raise gives it back."""

PASSES = 6
"""Looks at all points of an array; what is left then is lifted. Chunks are looked at once, after the fit."""


def fit_paper(job: Job) -> Outcome:
    """Return the surface of sec. 6; with ``symmetric`` the mean of both orders of u and v."""
    straight = _one_order(job, exchanged=False)
    if not job.symmetric:
        return straight
    other = _one_order(job, exchanged=True)
    mean = 0.5 * straight.coefficients + 0.5 * other.coefficients.T
    return Outcome(np.ascontiguousarray(mean), max(straight.rounds, other.rounds), straight.fallbacks + other.fallbacks)


def _one_order(job: Job, exchanged: bool) -> Outcome:
    frame = _exchanged(job.frame) if exchanged else job.frame
    uv = np.ascontiguousarray(job.uv[:, ::-1]) if exchanged else job.uv
    n, m = frame.shape
    corner = np.full((n, m), -np.inf)
    solves, fallbacks = np.zeros(m, np.int64), np.zeros(m, np.bool_)
    chosen, sign = np.empty((m, n), np.int64), np.empty((m, n))
    line, place, height = _on_lines(uv, job.height, m)
    todo, near = np.ones(m, np.bool_), None
    for turn in range(PASSES):
        _fit_lines(line, place, height, job.boundary == "open", todo, corner, solves, fallbacks, chosen, sign)
        if job.source.streamed:
            break
        worst, near = _look(frame, corner, job, near, first=turn == 0)
        if worst is None:
            break
        more, more_place, more_height = worst
        todo = np.zeros(m, np.bool_)
        todo[more] = True
        line, place, height = _sorted(
            np.concatenate([line, more]), np.concatenate([place, more_place]), np.concatenate([height, more_height])
        )
    coefficients, sweeps, contracted = over_corners(corner, job.boundary)
    reach = TAME * 2.0 * job.scale.half
    coefficients = np.clip(coefficients, job.scale.middle - reach, job.scale.middle + reach)
    return Outcome(coefficients, max(int(solves.max()), sweeps), int(fallbacks.sum()) + contracted)


def _exchanged(frame: Frame) -> Frame:
    order = np.array([1, 0, 2])
    return Frame(frame.rotation[order], frame.low[::-1], frame.scale[::-1], frame.cells[::-1])


def _on_lines(uv: Floats, height: Floats, m: int) -> tuple[Integers, Floats, Floats]:
    """Project points to their two u-lines: line number, parameter and height, sorted by line."""
    row = np.minimum(uv[:, 1].astype(np.int64), m - 2)
    return _sorted(np.concatenate([row, row + 1]), np.tile(uv[:, 0], 2), np.tile(height, 2))


def _sorted(line: Integers, place: Floats, height: Floats) -> tuple[Integers, Floats, Floats]:
    order = np.argsort(line, kind="stable")
    return line[order], place[order], height[order]


def _look(
    frame: Frame, corner: Floats, job: Job, near: Floats | None, *, first: bool
) -> tuple[tuple[Integers, Floats, Floats] | None, Floats | None]:
    """Return the point of largest excess over its line's bound for each line and abscissa, and the points near to it.

    The first is None if no point lies above the bound. Points near to it, rows of u, v and height, are looked at where
    they are given, all points where not. They are found at the first look; None stands for many.
    """
    n, m = corner.shape
    half, is_open = job.scale.half, job.boundary == "open"
    tolerance = AGREED * 2.0 * half
    worst, place, height = np.full((m, n), tolerance), np.zeros((m, n)), np.zeros((m, n))
    if near is not None:
        _look_again(near, corner, is_open, worst, place, height)
    else:
        (points,) = job.source
        kept = np.empty((len(points) // FEW if first else 0, 3))
        count = _look_at(
            points,
            frame.signed_numbers(job.sign),
            corner,
            is_open,
            NEAR * 2.0 * half if first else 0.0,
            kept,
            worst,
            place,
            height,
        )
        near = kept[:count].copy() if first and count <= len(kept) else None
    line, at = np.nonzero(worst > tolerance)
    return ((line, place[line, at], height[line, at]) if len(line) else None), near


@kernel
def _fit_lines(line, place, height, is_open, todo, corner, solves, fallbacks, chosen, sign):
    # Points that were found later lie behind the older ones of their line, so its choice holds and is gone on from.
    n, m = corner.shape
    labels, b, worst_at = np.zeros(n, np.bool_), np.empty(n), np.empty(n, np.int64)
    work, rows = np.empty((2, n)), np.empty((n, COLUMNS))
    first = 0
    for j in range(m):
        last = first
        while last < line.shape[0] and line[last] == j:
            last += 1
        if todo[j] and last > first:
            known_before = corner[0, j] > -np.inf and not fallbacks[j]
            for i in range(n):
                b[i] = corner[i, j]
            t, y = place[first:last], height[first:last]
            count, plainly = scattered(t, y, labels, is_open, b, chosen[j], sign[j], known_before, worst_at, work, rows)
            solves[j] += count
            fallbacks[j] = plainly
            for i in range(n):
                corner[i, j] = b[i]
        first = last


@inner
def _table(corner, is_open):
    # Eq. (5) at both ends of an interval: b and min(D b, 0) / 6, line by line.
    n, m = corner.shape
    table, b = np.zeros((m, n, 2)), np.empty(n)
    for j in range(m):
        for i in range(n):
            b[i] = corner[i, j]
        for i in range(n):
            table[j, i, 0] = b[i]
            table[j, i, 1] = min(second(b, i, is_open), 0.0) / 6.0 if b[i] > -np.inf else 0.0
    return table


@inner
def _compare(table, h, k, s, z, worst, place, height):
    n = table.shape[1]
    q = 1.0 - s
    s3, q3 = s * s * s, q * q * q
    most = -np.inf
    for j in range(k, k + 2):
        low = q * table[j, h, 0] + s * table[j, h + 1, 0] + q3 * table[j, h, 1] + s3 * table[j, h + 1, 1]
        most = max(most, z - low)
        if z > low:
            u = h + s
            a = nearest(u, n)
            if z - low > worst[j, a]:
                worst[j, a], place[j, a], height[j, a] = z - low, u, z
    return most


@kernel
def _look_again(near, corner, is_open, worst, place, height):
    n, m = corner.shape
    table = _table(corner, is_open)
    for i in range(near.shape[0]):
        h, k = cell_of(near[i, 0], n - 1), cell_of(near[i, 1], m - 1)
        _compare(table, h, k, near[i, 0] - h, near[i, 2], worst, place, height)


@kernel
def _look_at(p, f, corner, is_open, margin, near, worst, place, height):
    # The bound lies nowhere below the least sum of its two numbers at the corners of a cell: most points pass.
    n, m = corner.shape
    table = _table(corner, is_open)
    least = np.empty((n - 1) * (m - 1))
    for h in range(n - 1):
        for k in range(m - 1):
            low = np.inf
            for j in range(k, k + 2):
                for i in range(h, h + 2):
                    low = min(low, table[j, i, 0] + table[j, i, 1])
            least[h * (m - 1) + k] = low - 1e-14 * abs(low) - margin
    w, cells = np.empty(RECORD * BLOCK), np.empty(BLOCK, np.int32)
    flat, count = p.ravel(), 0
    for first in range(0, p.shape[0], BLOCK):
        here = min(BLOCK, p.shape[0] - first)
        fetch_records(flat[3 * first :], 0, here, f, cells, w)
        for i in range(here):
            z, cell = w[RECORD * i + HEIGHT], np.int64(cells[i])
            if z <= least[cell]:
                continue
            h, k, s = cell // (m - 1), cell % (m - 1), w[RECORD * i + LOCAL_U]
            if _compare(table, h, k, s, z, worst, place, height) > -margin:
                if count < near.shape[0]:
                    near[count, 0], near[count, 1], near[count, 2] = h + s, k + w[RECORD * i + LOCAL_V], z
                count += 1
    return count
