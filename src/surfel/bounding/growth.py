"""A grid that grows by whole cells, for points that come from beyond it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surfel.bounding.belonging import Places
from surfel.bounding.certify import slackened
from surfel.bounding.memory import Memory
from surfel.bounding.occupancy import HIGH, LEFT, LOW, RIGHT, WHOLE, Quarters
from surfel.bounding.spline import SafeSpline
from surfel.bounding.trim import trimmed
from surfel.core.errors import InputError

MOST_CELLS = 4096
"""Cells along a side to which a grid may grow."""


def grown(spline: SafeSpline, memory: Memory, places: Places) -> tuple[SafeSpline, Memory]:
    """Return the spline, and what it remembers, on a grid with as many cells more on each side as the points need."""
    frame = spline.frame
    before = np.maximum(-places.cell.min(axis=0), 0.0)
    after = np.maximum(places.cell.max(axis=0) - (frame.cells - 1), 0.0)
    cells = frame.cells + before + after
    if not (cells <= MOST_CELLS).all():
        raise InputError(
            f"the new points reach so far beyond the grid that it would have {cells[0]:.0f} x {cells[1]:.0f} cells; "
            "fit a new surface to all points"
        )
    low, high = before.astype(np.int64), after.astype(np.int64)
    wide = ((low[0], high[0]), (low[1], high[1]))
    surface, lift = np.pad(spline.coefficients, wide, mode="edge"), 0.0
    if low.any():  # the sum of an old coordinate and the new number of cells before it is rounded anew
        sign = 1.0 if spline.side == "above" else -1.0
        surface, lift = slackened(sign * surface, spline.boundary == "clamped")
        surface *= sign
    memory = memory.padded(wide)
    occupancy = np.pad(spline.occupancy, wide)
    larger = replace(frame, cells=frame.cells + low + high, origin=frame.origin + low)
    spline = replace(
        spline,
        frame=larger,
        coefficients=surface,
        occupancy=occupancy,
        trim=trim_of(occupancy, memory),
        report=replace(spline.report, gap_max=spline.report.gap_max + 2.0 * lift),
        memory=memory,
    )
    return spline, memory


def trim_of(occupancy: Quarters, memory: Memory) -> Quarters:
    """Return the trim; once the grid has grown, with all quarters that a point of a cell may be evaluated in.

    That is the quarters of its own cell, and those of its neighbours that it touches where it lies on the border.
    """
    if (memory.cells == occupancy.shape).all():
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
