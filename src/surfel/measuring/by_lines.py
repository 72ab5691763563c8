"""Measuring by lines: randomly shifted copies of one sequence, cast in blocks, doubled until the error is small."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from surfel.core.cast import Floats
from surfel.core.errors import ConvergenceError
from surfel.core.estimate import Estimate, at_best_halved
from surfel.core.execute import Policy, Progress, blocks, run_blocks
from surfel.core.lines import Lines
from surfel.lines.box import OrientedBox
from surfel.lines.cylinder import EnclosingCylinder
from surfel.lines.enclosing import Ball
from surfel.lines.models import line_block
from surfel.lines.sequences import from_shifts, shifts
from surfel.measuring.line_sums import COLUMNS, Moments, inertia_tensor, moments_of, set_sums
from surfel.shapes.base import Shape
from surfel.shapes.tree import Tree

SHIFTS = 16
"""Random shifts behind every error bar: with 8 the intervals were found to be too narrow."""

MOST_LINES = 1 << 28
"""A tolerance that asks for more lines than this is refused."""

_ROUNDING = 1e-13  # of a value that all sets agree upon
_UNSEEN = 0.25  # of what one hit stands for: what so many lines cannot tell where all sets agree
_DOUBLINGS = 4  # before anything is extrapolated
_LEAST_ORDER, _MOST_ORDER = 0.5, 1.25  # powers of the number of lines with which errors fall
_LENIENT = 0.15  # of which one may be seen as so much less
_BLOCK = 4096  # lines of each shift that are cast at a time


class LineSource(Protocol):
    """Sixteen randomised sets of lines: where they come from, and the measure that each set stands for."""

    @property
    def centre(self) -> Floats:
        """What moments are taken about, shape (3,)."""
        ...

    def block(self, first: int, last: int, total: int) -> Lines:
        """Return lines first to last - 1 of the ``total`` lines of every set, set by set."""
        ...

    def measure(self, shift: int) -> float:
        """Return the line measure of a whole set."""
        ...


@dataclass(frozen=True, eq=False)
class ShiftedLines:
    """Lines of all directions through a convex body, from randomly shifted copies of one sequence."""

    body: Ball | OrientedBox | EnclosingCylinder
    model: str
    sequence: Any
    offsets: Floats

    @classmethod
    def of(cls, body: Ball | OrientedBox | EnclosingCylinder, model: str, sequence: Any, seed: int) -> ShiftedLines:
        """Draw the shifts."""
        return cls(body, model, sequence, shifts(seed, SHIFTS, 4))

    @property
    def centre(self) -> Floats:
        """The middle of the body."""
        return np.asarray(self.body.centre)

    def block(self, first: int, last: int, total: int) -> Lines:
        """Return lines first to last - 1 of the ``total`` lines of every shift, shift by shift."""
        return line_block(self.sequence, self.model, self.body, first, last - first, total, self.offsets)

    def measure(self, shift: int) -> float:
        """Return the measure of the lines that hit the body, ``pi S / 2``."""
        return float(0.5 * np.pi * self.body.surface)


@dataclass(frozen=True, eq=False)
class LineResult:
    """What lines tell about a shape.

    Parameters
    ----------
    area, volume, centroid, inertia : Estimate
        With the errors of the lines alone.
    leak : float
        Share of the lines that hit which pass an odd number of sheets; NaN where none hit.
    lines : int
        How many were cast.
    areas : tuple of Estimate
        The area of each leaf.
    """

    area: Estimate
    volume: Estimate
    centroid: Estimate
    inertia: Estimate
    leak: float
    lines: int
    areas: tuple[Estimate, ...]


def measure_by_lines(
    shape: Shape,
    source: LineSource,
    lines: int,
    *,
    tolerance: float | None = None,
    goal: str = "volume",
    policy: Policy | None = None,
    progress: Progress | None = None,
) -> LineResult:
    """Cast lines through a shape.

    Parameters
    ----------
    shape : Shape
        What is crossed.
    source : LineSource
        Where the lines come from.
    lines : int
        How many to cast in all, over the sixteen sets.
    tolerance : float, optional
        Double the lines until the half-width of the 95 % interval of ``goal`` is at most this share of its value.
    goal : {"area", "volume"}
        What the tolerance is for.
    policy : Policy, optional
        Where the blocks run.
    progress : Progress, optional
        Called as the work proceeds.

    Raises
    ------
    ConvergenceError
        If more than :data:`MOST_LINES` lines would be needed, as far as the first few doublings tell.
    """
    done, wanted = 0, max(1, -(-lines // SHIFTS))
    leaves = len(shape.leaves) if isinstance(shape, Tree) and goal == "area" else 0
    sums = np.zeros((SHIFTS, COLUMNS + leaves))
    widths: list[float] = []
    before: LineResult | None = None
    while True:
        sums = sums + _cast(shape, leaves, source, done, wanted, policy, progress)
        done = wanted
        result = _estimates(sums, done, source)
        if tolerance is None:
            return result
        if before is not None:
            result = replace(
                result,
                area=at_best_halved(result.area, before.area),
                volume=at_best_halved(result.volume, before.volume),
            )
        before = result
        widths.append(_width(result.area if goal == "area" else result.volume))
        if widths[-1] <= tolerance:
            return result
        needed = _lines_needed(widths, done * SHIFTS, tolerance)
        if max(needed, 2 * done * SHIFTS) > MOST_LINES:
            would = f", and would be after about {needed:.1g} of them at best" if needed > MOST_LINES else ""
            raise ConvergenceError(
                f"the {goal} is not known to {tolerance:g} of its value after {done * SHIFTS:,} lines{would}; "
                f"at most {MOST_LINES:,} are cast; ask for less"
            )
        wanted = 2 * done


def _cast(
    shape: Shape,
    leaves: int,
    source: LineSource,
    start: int,
    stop: int,
    policy: Policy | None,
    progress: Progress | None,
) -> Floats:
    """Return the column sums of each set over its lines start to stop, and the weighted hits of each leaf."""

    def block(span: tuple[int, int]) -> Floats:
        first, last = start + span[0], start + span[1]
        lines = source.block(first, last, stop)
        hits = shape._cross(lines)
        events = shape._sheets(hits)
        return set_sums(lines, hits, events, shape._pieces(lines, events), source.centre, SHIFTS, leaves)

    total = np.zeros((SHIFTS, COLUMNS + leaves))
    for part in run_blocks(block, blocks(stop - start, _BLOCK), policy, progress, "casting lines"):
        total += part
    return total


def _estimates(sums: Floats, per_shift: int, source: LineSource) -> LineResult:
    parts = [moments_of(row[:COLUMNS], per_shift, source.measure(shift)) for shift, row in enumerate(sums)]
    measures = np.array([source.measure(shift) for shift in range(len(sums))])
    one_hit = float(measures.mean()) / (np.pi * per_shift * SHIFTS)
    area = _at_least(_over_shifts(np.array([part.area for part in parts])), _UNSEEN * one_hit)
    volume = _over_shifts(np.array([part.volume for part in parts]))
    if min(part.volume for part in parts) > 0.0:
        bodies = [inertia_tensor(part.volume, part.first, part.second) for part in parts]
        whole = _mean(parts)
        centre, tensor = inertia_tensor(whole.volume, whole.first, whole.second)
        centroid = replace(_over_shifts(np.array([c for c, _ in bodies])), value=centre + source.centre)
        inertia = replace(_over_shifts(np.array([i for _, i in bodies])), value=tensor)
    else:
        reason = "no line passes through an inside" if volume.value == 0.0 else "too few lines hit"
        centroid = Estimate.unknown(reason, np.full(3, np.nan))
        inertia = Estimate.unknown(reason, np.full((3, 3), np.nan))
    hit, odd = measures @ sums[:, 1:3]
    areas = tuple(
        _at_least(_over_shifts(measures * column / (per_shift * np.pi)), _UNSEEN * one_hit)
        for column in sums[:, COLUMNS:].T
    )
    return LineResult(
        area, volume, centroid, inertia, float(odd / hit) if hit else math.nan, per_shift * SHIFTS, areas or (area,)
    )


def _over_shifts(values: Floats) -> Estimate:
    unit = math.ldexp(
        1.0, math.frexp(float(np.abs(values).max()))[1] - 1
    )  # squares of raw values may over- or underflow
    mean, error, freedom = from_shifts(values / unit)
    return Estimate(mean * unit, np.hypot(error, _ROUNDING * np.abs(mean)) * unit, freedom=freedom)


def _at_least(estimate: Estimate, error: float) -> Estimate:
    return replace(estimate, standard_error=math.hypot(float(estimate.standard_error), error))


def _mean(parts: list[Moments]) -> Moments:
    return Moments(*(np.mean(np.array([part[i] for part in parts]), axis=0) for i in range(len(parts[0]))))


def _width(estimate: Estimate) -> float:
    """Return half of the 95 % interval as a share of the value."""
    low, high = estimate.interval(0.95)
    half = 0.5 * float(high - low)
    return half / abs(float(estimate.value)) if half and float(estimate.value) else 0.0


def _lines_needed(widths: list[float], lines: int, tolerance: float) -> float:
    """Extrapolate how many lines the tolerance takes, rather too few than too many.

    The error falls with a power of the number of lines that was seen while it was doubled, between those of random
    points and of an even grid; 0 while too little was seen.
    """
    seen = np.array(widths)
    if len(seen) <= _DOUBLINGS or not (np.isfinite(seen).all() and (seen > 0.0).all()):
        return 0.0
    order = -float(np.polyfit(np.arange(len(seen)), np.log2(seen), 1)[0])
    power = min(max(order + _LENIENT, _LEAST_ORDER), _MOST_ORDER)
    return float(lines * (seen[-1] / tolerance) ** (1.0 / power))
