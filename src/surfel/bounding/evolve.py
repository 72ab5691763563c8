"""Evolving clouds: points that come and go, and a new fit from what a spline remembers."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import kernel
from surfel.bounding.bezier import bezier_nets
from surfel.bounding.certify import EPS, LEAST, raised, slack_of, slackened, tied
from surfel.bounding.corners import corners_of, over_corners
from surfel.bounding.evaluate import cell_of, value_at, values
from surfel.bounding.fast import upper_spline
from surfel.bounding.frame import Frame
from surfel.bounding.height_spline import HeightSpline
from surfel.bounding.memory import Memory
from surfel.bounding.normal import fill_row, unknowns_of
from surfel.bounding.occupancy import HIGH, LEFT, LOW, RIGHT, WHOLE, Quarters
from surfel.bounding.passes import survey
from surfel.bounding.reference import Scale, by_cells
from surfel.bounding.residuals import keep_residuals, no_residuals
from surfel.bounding.source import chunks_of
from surfel.bounding.spline import SafeSpline
from surfel.bounding.trim import trimmed
from surfel.core.cast import Floats, as_points
from surfel.core.errors import InputError

MOST_CELLS = 4096
"""Cells along a side to which a grid may grow."""


def with_points(spline: SafeSpline, points: Any) -> SafeSpline:
    """Return a spline that bounds some points more: each in turn raises its 16 coefficients as little as it takes."""
    started = time.perf_counter()
    memory = _memory_of(spline)
    new = _usable(points)
    if len(new) == 0:
        return spline
    spline = _grown(spline, new)
    memory = _memory_of(spline)
    sign = _sign(spline)
    surface = _inserted(spline, new, sign)
    seen = no_residuals(spline.frame, memory.split)
    keep_residuals(seen, new, spline.frame, sign * memory.reference, sign)
    more = Memory.of(memory.reference * sign, seen, sign)
    higher = more.largest > memory.largest
    memory = Memory(
        memory.split,
        memory.reference,
        np.maximum(memory.largest, more.largest),
        memory.count + more.count,
        np.where(higher[..., None], more.uv, memory.uv),
        np.where(higher, more.height, memory.height),
        memory.weight + more.weight,
        memory.total + more.total,
        memory.blur,
    )
    lift = float(np.abs(surface - sign * spline.coefficients).max())
    uv, heights = spline.frame.to_domain(new)
    largest = max(spline.report.gap_max + lift, float((values(surface, uv) - sign * heights).max()))
    return _result(spline, sign * surface, spline.occupancy | seen.occupancy, memory, "inserted", largest, started)


def without_points(spline: SafeSpline, points: Any) -> SafeSpline:
    """Return the spline with some of its points forgotten: the same surface, which a new fit can then bring closer."""
    started = time.perf_counter()
    memory = _memory_of(spline)
    gone = _usable(points)
    if len(gone) == 0:
        return spline
    uv, _ = spline.frame.to_domain(gone)
    seen = no_residuals(spline.frame, memory.split)
    inside = ((uv >= 0.0) & (uv <= spline.frame.cells)).all(axis=1)
    if inside.all():
        keep_residuals(seen, gone, spline.frame, memory.reference.copy(), 1.0)
    count = memory.count - seen.count
    if not inside.all() or (count < 0).any():
        raise InputError("some points to be removed are not among those that the surface bounds; remove what was given")
    empty = count == 0
    memory = Memory(
        memory.split,
        memory.reference,
        np.where(empty, -np.inf, memory.largest),
        count,
        memory.uv,
        memory.height,
        memory.weight - seen.mean_weights() * len(gone),
        memory.total - float(seen.total[0]),
        memory.blur,
    )
    n, m = spline.occupancy.shape
    filled = (count.reshape(n, memory.split, m, memory.split) > 0).any(axis=(1, 3))
    occupancy = np.where(filled, spline.occupancy, 0).astype(np.uint8)
    if not filled.any():
        raise InputError("no points would be left; a surface needs at least one point to bound")
    return _result(spline, spline.coefficients, occupancy, memory, "removed", spline.report.gap_max, started)


def fitted_again(spline: SafeSpline) -> SafeSpline:
    """Return a new fit of the remembered points, as close as mode ``fast``, without the points themselves.

    All points of a micro-cell lie on the safe side of the old reference plus the micro-cell's largest residual. Beside
    a new reference that residual is at most the old one plus the largest difference of both references there, which the
    difference's Bezier net over the micro-cell bounds. The surface over these is safe.
    """
    started = time.perf_counter()
    memory, sign = _memory_of(spline), _sign(spline)
    uv, height = by_cells(memory.uv.copy(), np.where(memory.count > 0, sign * memory.height, -np.inf), memory.split)
    scale = Scale.of(float(height.min()), float(height.max()))
    z, unknowns = scale.inward(height), unknowns_of(spline.shape, spline.boundary)
    reference = scale.outward(upper_spline(uv, z, unknowns, spline.boundary))
    largest = memory.largest + _highest_by_micro_cell(sign * memory.reference - reference, memory.split)
    n, m = spline.occupancy.shape
    by_cell = largest.reshape(n, memory.split, m, memory.split).max(axis=(1, 3))
    above, rounds, fallbacks = over_corners(corners_of(by_cell), spline.boundary)
    clamped = spline.boundary == "clamped"
    surface, slack = slackened(reference + above, clamped)
    # residuals were rounded when they were taken against the old reference, perhaps on a grid that grew since
    extra = float(slack_of(memory.reference).max())
    steps = (np.abs(np.diff(c, axis=axis)).max() for c in (surface, memory.reference) for axis in (0, 1))
    surface = surface + (2.0 * extra + 4.0 * memory.blur * float(sum(steps)))
    memory = replace(memory, reference=sign * reference, largest=largest)
    spline = replace(spline, report=replace(spline.report, rounds=rounds + 2, slack=slack, fallbacks=fallbacks))
    smallest = float((values(surface, uv) - height).max())
    limit = max(smallest, spline.report.gap_max + float(np.abs(surface - sign * spline.coefficients).max()))
    return _result(spline, sign * surface, spline.occupancy, memory, "refitted", limit, started)


def heights_between(spline: HeightSpline, other: HeightSpline, places: ArrayLike | None) -> Floats:
    """Return the height of another surface less that of this one, at places or at the corners of the grid."""
    if not isinstance(other, HeightSpline):
        raise InputError(f"other must be a SafeSpline; got {type(other).__name__}")
    if np.abs(spline.frame.rotation - other.frame.rotation).max() > 1e-12:
        raise InputError("the two surfaces have different directions; fit both along the same one")
    n, m = spline.shape
    corners = np.stack(np.meshgrid(np.arange(float(n)), np.arange(float(m)), indexing="ij"), axis=-1).reshape(-1, 2)
    uv = corners if places is None else spline._places(places)
    mine = spline(uv)
    uv_there = uv
    if (spline.frame.numbers() != other.frame.numbers()).any():
        uv_there, _ = other.to_domain(spline.frame.to_world(uv, np.where(np.isfinite(mine), mine, 0.0)))
    apart = other(uv_there) - mine
    return apart.reshape(n, m) if places is None else apart


def _highest_by_micro_cell(coefficients: Floats, split: int) -> Floats:
    """Return what a spline does not exceed over each micro-cell: the largest of its Bezier net there."""
    part = [_cut(a / split, (a + 1) / split) for a in range(split)]
    nets = bezier_nets(coefficients)
    n, m = nets.shape[:2]
    out = np.empty((n, split, m, split))
    for a in range(split):
        for b in range(split):
            out[:, a, :, b] = (part[a] @ nets @ part[b].T).max(axis=(2, 3))
    size = np.lib.stride_tricks.sliding_window_view(np.abs(coefficients), (4, 4)).max(axis=(2, 3))
    return np.asarray((out + 32.0 * EPS * size[:, None, :, None]).reshape(n * split, m * split))


def _cut(start: float, end: float) -> Floats:
    """Return the matrix that takes a cubic's Bezier coefficients to those of its part from start to end (blossoms)."""

    def blossom(a: float, b: float, c: float) -> Floats:
        row = np.eye(4)
        for t in (a, b, c):
            row = (1.0 - t) * row[:-1] + t * row[1:]
        return np.asarray(row[0])

    return np.stack([blossom(*([end] * i + [start] * (3 - i))) for i in range(4)])


def _inserted(spline: SafeSpline, points: Floats, sign: float) -> Floats:
    """Return signed coefficients above the new points too, with a margin for the rounding of any evaluator."""
    surface, clamped = sign * spline.coefficients, spline.boundary == "clamped"
    uv, heights = spline.frame.to_domain(points)
    size = max(float(np.abs(surface).max()), float(np.abs(heights).max()))
    goal = sign * heights + (64.0 * EPS * size + LEAST)
    _raise_over(uv, goal, surface, 16.0 * EPS * size)
    cells = np.minimum(uv.astype(np.int64), spline.frame.cells - 1)
    while (goal > values(surface, uv)).any():
        by_cell = np.full(spline.occupancy.shape, -np.inf)
        np.maximum.at(by_cell, (cells[:, 0], cells[:, 1]), goal - values(surface, uv) + 16.0 * EPS * size)
        surface = raised(surface, by_cell, clamped)
    return tied(surface) if clamped else surface


def _grown(spline: SafeSpline, points: Floats) -> SafeSpline:
    """Return the spline on a grid with as many cells more on each side as the points need."""
    frame, memory = spline.frame, _memory_of(spline)
    uv, _ = frame.to_domain(points)
    before = np.maximum(np.ceil(-uv.min(axis=0)), 0.0)
    after = np.maximum(np.ceil(uv.max(axis=0) - frame.cells), 0.0)
    if not (before.any() or after.any()):
        return spline
    after[before > 0.0] += 1.0  # where the origin moves, rounding may carry old points over the far end
    cells = frame.cells + before + after
    if not (cells <= MOST_CELLS).all():
        raise InputError(
            f"the new points reach so far beyond the grid that it would have {cells[0]:.0f} x {cells[1]:.0f} cells; "
            "fit a new surface to all points"
        )
    low, high = before.astype(np.int64), after.astype(np.int64)
    larger = Frame(frame.rotation, frame.low - before / frame.scale, frame.scale, cells)
    again, _ = larger.to_domain(points)
    if not ((again >= 0.0) & (again <= larger.cells)).all():  # rounding at the border: one cell more
        low, high = low + 1, high + 1
        larger = Frame(frame.rotation, frame.low - low / frame.scale, frame.scale, frame.cells + low + high)
    wide = ((low[0], high[0]), (low[1], high[1]))
    fine = tuple((a * memory.split, b * memory.split) for a, b in wide)
    sign = _sign(spline)
    # the new coordinates of old points are rounded otherwise
    blur = 4.0 * EPS * (larger.scale * (np.abs(frame.low) + larger.cells / frame.scale)).max()
    step = max(float(np.abs(np.diff(spline.coefficients, axis=axis)).max()) for axis in (0, 1))
    moved = np.pad(spline.coefficients + sign * 4.0 * blur * step, wide, mode="edge")
    reference = np.pad(memory.reference + sign * 4.0 * blur * step, wide, mode="edge")
    memory = Memory(
        memory.split,
        reference,
        np.pad(memory.largest, fine, constant_values=-np.inf),
        np.pad(memory.count, fine),
        np.pad(memory.uv + low, (*fine, (0, 0))),
        np.pad(memory.height, fine),
        np.pad(memory.weight, wide),
        memory.total,
        memory.blur + float(blur),
    )
    occupancy = np.pad(spline.occupancy, wide)
    report = replace(spline.report, gap_max=spline.report.gap_max + 8.0 * float(blur) * step)
    return replace(
        spline,
        report=report,
        frame=larger,
        coefficients=moved,
        occupancy=occupancy,
        trim=_trim_of(occupancy, memory),
        memory=memory,
    )


def _result(
    spline: SafeSpline, coefficients: Floats, occupancy: Any, memory: Memory, mode: str, gap_max: float, started: float
) -> SafeSpline:
    report = replace(
        spline.report,
        mode=mode,
        points=memory.points,
        gap_mean=memory.mean_gap(coefficients, _sign(spline)),
        gap_max=gap_max,
        dual_bound=None,
        compression=3.0 * memory.points / coefficients.size,
        seconds=time.perf_counter() - started,
    )
    return replace(
        spline,
        coefficients=coefficients,
        occupancy=occupancy,
        trim=_trim_of(occupancy, memory),
        report=report,
        memory=memory,
    )


def _trim_of(occupancy: Quarters, memory: Memory) -> Quarters:
    """Return the trim; once the grid has grown, with all quarters into which rounding may have moved a point."""
    if memory.blur == 0.0:
        return trimmed(occupancy)
    filled = occupancy > 0
    n, m = filled.shape
    wide = np.pad(filled, 1)
    reached = np.where(filled, WHOLE, occupancy).astype(np.uint8)
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            # an edge touches the quarter beside it and, at its ends, the two next to that
            quarters = {-1: LEFT, 0: LEFT | RIGHT, 1: RIGHT}[di] | {-1: LOW, 0: LOW | HIGH, 1: HIGH}[dj]
            neighbour = wide[1 + di : 1 + di + n, 1 + dj : 1 + dj + m]
            reached |= np.where(neighbour, np.uint8(quarters), np.uint8(0))
    return trimmed(reached)


def _memory_of(spline: SafeSpline) -> Memory:
    if spline.memory is None:
        raise InputError("this surface remembers nothing of its points (it was saved without); fit it again")
    return spline.memory


def _sign(spline: SafeSpline) -> float:
    return 1.0 if spline.side == "above" else -1.0


def _usable(points: Any) -> Floats:
    rows = [chunk for chunk in chunks_of(points) if len(chunk)]
    if not rows:
        return np.empty((0, 3))
    array = rows[0] if len(rows) == 1 else np.concatenate(rows)
    if not survey(array, np.eye(3))[0]:
        as_points(array)
        raise InputError("points has coordinates beyond 1e300; scale them down")
    return array


@kernel
def _raise_over(uv, z, b, least):
    # b += (z - F) w / |w|^2: the least change of the 16 coefficients. All w >= 0, so older points stay safe.
    n, m = b.shape[0] - 3, b.shape[1] - 3
    row = np.empty(16)
    for i in range(uv.shape[0]):
        excess = z[i] - value_at(b, uv[i, 0], uv[i, 1])
        if excess <= 0.0:
            continue
        h, k = cell_of(uv[i, 0], n), cell_of(uv[i, 1], m)
        fill_row(uv[i, 0] - h, uv[i, 1] - k, row)
        square = 0.0
        for a in range(16):
            square += row[a] * row[a]
        step = max(excess, least) / square
        for a in range(16):
            b[h + a // 4, k + a % 4] += step * row[a]
