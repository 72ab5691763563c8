"""Evolving clouds: points that come and go."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import kernel
from surfel.bounding.belonging import Places, Tally
from surfel.bounding.certify import EPS, LEAST, raised, tied
from surfel.bounding.evaluate import cell_of, value_at, values
from surfel.bounding.growth import grown, trim_of
from surfel.bounding.height_spline import HeightSpline
from surfel.bounding.memory import Memory
from surfel.bounding.normal import fill_row
from surfel.bounding.passes import survey
from surfel.bounding.refit import fitted_to, limits
from surfel.bounding.source import chunks_of
from surfel.bounding.spline import SafeSpline
from surfel.core.cast import Floats, as_points
from surfel.core.errors import InputError


def with_points(spline: SafeSpline, points: Any) -> SafeSpline:
    """Return a spline that bounds some points more: each in turn raises its 16 coefficients as little as it takes."""
    started = time.perf_counter()
    memory, sign, new = _memory_of(spline), _sign(spline), _usable(points)
    if len(new) == 0:
        return spline
    places = Places.of(new, spline.frame, memory.cells)
    if not places.within(spline.frame):
        spline, memory = grown(spline, memory, places)
        places = Places.of(new, spline.frame, memory.cells)
    surface = _inserted(spline, places, sign)
    tally = Tally.of(places, spline.frame, memory, sign)
    higher = tally.largest > memory.largest
    memory = replace(
        memory,
        largest=np.maximum(memory.largest, tally.largest),
        count=memory.count + tally.count,
        uv=np.where(higher[..., None], places.first[tally.which], memory.uv),
        height=np.where(higher, places.heights[tally.which], memory.height),
        weight=memory.weight + tally.weight,
        total=memory.total + float(places.heights.sum()),
        gone=memory.gone & ~higher & ~tally.known,
    )
    lift = float(np.abs(surface - sign * spline.coefficients).max())
    largest = float((values(surface, places.uv) - sign * places.heights).max())
    report = replace(spline.report, gap_max=max(spline.report.gap_max + lift, largest))
    spline = replace(spline, coefficients=sign * surface, report=report)
    return _told(spline, spline.occupancy | tally.occupancy, memory, "inserted", started)


def without_points(spline: SafeSpline, points: Any) -> SafeSpline:
    """Return the spline with some of its points forgotten: the same surface, which a new fit can then bring closer."""
    started = time.perf_counter()
    memory, gone = _memory_of(spline), _usable(points)
    if len(gone) == 0:
        return spline
    places = Places.of(gone, spline.frame, memory.cells)
    if not places.within(spline.frame):
        raise _not_given()
    tally = Tally.of(places, spline.frame, memory, _sign(spline))
    count, known = memory.count - tally.count, memory.gone | tally.known
    empty = count == 0
    # the last point of a micro-cell cannot go before that of its largest residual
    if (count < 0).any() or (tally.largest > limits(memory)).any() or (empty & (tally.count > 0) & ~known).any():
        raise _not_given()
    if empty.all():
        raise InputError("no points would be left; a surface needs at least one point to bound")
    n, m = spline.occupancy.shape
    filled = (count.reshape(n, memory.split, m, memory.split) > 0).any(axis=(1, 3))
    occupancy = np.where(filled, spline.occupancy, 0).astype(np.uint8)
    memory = replace(
        memory,
        largest=np.where(empty, -np.inf, memory.largest),
        count=count,
        weight=memory.weight - tally.weight,
        total=memory.total - float(places.heights.sum()),
        gone=known & ~empty,
    )
    return _told(spline, occupancy, memory, "removed", started)


def fitted_again(spline: SafeSpline) -> SafeSpline:
    """Return a new fit of the remembered points, as close as mode ``fast``, without the points themselves."""
    started = time.perf_counter()
    spline, memory = fitted_to(_memory_of(spline), spline, _sign(spline))
    return _told(spline, spline.occupancy, memory, "refitted", started)


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


def _inserted(spline: SafeSpline, places: Places, sign: float) -> Floats:
    """Return signed coefficients above the new points too, with a margin for the rounding of any evaluator."""
    surface, clamped, uv = sign * spline.coefficients, spline.boundary == "clamped", places.uv
    size = max(float(np.abs(surface).max()), float(np.abs(places.heights).max()))
    goal = sign * places.heights + (64.0 * EPS * size + LEAST)
    _raise_over(uv, goal, surface, 16.0 * EPS * size)
    cells = np.minimum(uv.astype(np.int64), spline.frame.cells - 1)
    while (goal > values(surface, uv)).any():
        by_cell = np.full(spline.occupancy.shape, -np.inf)
        np.maximum.at(by_cell, (cells[:, 0], cells[:, 1]), goal - values(surface, uv) + 16.0 * EPS * size)
        surface = raised(surface, by_cell, clamped)
    return tied(surface) if clamped else surface


def _told(spline: SafeSpline, occupancy: Any, memory: Memory, mode: str, started: float) -> SafeSpline:
    """Return the spline with what it remembers now, and a report of that."""
    report = replace(
        spline.report,
        mode=mode,
        points=memory.points,
        gap_mean=memory.mean_gap(spline.coefficients, _sign(spline)),
        dual_bound=None,
        compression=3.0 * memory.points / spline.coefficients.size,
        seconds=time.perf_counter() - started,
    )
    return replace(spline, occupancy=occupancy, trim=trim_of(occupancy, memory), report=report, memory=memory)


def _memory_of(spline: SafeSpline) -> Memory:
    if spline.memory is None:
        raise InputError("this surface remembers nothing of its points (it was saved without); fit it again")
    return spline.memory


def _sign(spline: SafeSpline) -> float:
    return 1.0 if spline.side == "above" else -1.0


def _not_given() -> InputError:
    return InputError("some points to be removed are not among those that the surface bounds; remove what was given")


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
