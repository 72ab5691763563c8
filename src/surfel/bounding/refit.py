"""A new fit from what a spline remembers of its points, without the points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surfel.bounding.bezier import bezier_nets, largest_of_cells
from surfel.bounding.certify import EPS, proven, slack_of, slackened
from surfel.bounding.corners import corners_of, over_corners
from surfel.bounding.evaluate import values
from surfel.bounding.fast import upper_spline
from surfel.bounding.memory import Memory
from surfel.bounding.normal import unknowns_of
from surfel.bounding.reference import Scale, by_cells
from surfel.bounding.residuals import no_residuals
from surfel.bounding.spline import SafeSpline
from surfel.core.cast import Floats


def fitted_to(memory: Memory, spline: SafeSpline, sign: float) -> tuple[SafeSpline, Memory]:
    """Return a new surface over the remembered points, as close as mode ``fast``, and what is remembered from now on.

    All points of a micro-cell lie on the safe side of the old reference plus the micro-cell's limit. Beside a new
    reference that limit grows at most by the largest difference of both references there, which the difference's
    Bezier net over the micro-cell bounds. The surface over these is safe.

    Remembered are the old reference and limits, so that differences do not add up from fit to fit; but the new ones
    once the grid has grown, because there the old reference only goes on as it was at the border.
    """
    clamped = spline.boundary == "clamped"
    uv, height = _highest(memory, spline, sign)
    scale = Scale.of(float(height.min()), float(height.max()))
    unknowns = unknowns_of(spline.shape, spline.boundary)
    reference = scale.outward(upper_spline(uv, scale.inward(height), unknowns, spline.boundary))
    largest = limits(memory) + _highest_by_micro_cell(sign * memory.reference - reference, memory.split)
    residuals = replace(no_residuals(spline.frame, memory.split), largest=largest)
    above, rounds, fallbacks = over_corners(corners_of(residuals.by_cell()), spline.boundary)
    surface, first = slackened(reference + above, clamped)
    surface, _, lifts = proven(surface, reference, residuals, clamped)
    surface, slack = slackened(surface, clamped)  # once more: the coordinates of points are rounded too
    smallest = float((values(surface, uv) - height).max())
    limit = max(smallest, spline.report.gap_max + float(np.abs(surface - sign * spline.coefficients).max()))
    report = replace(spline.report, gap_max=limit, rounds=rounds + 2, slack=first + slack, fallbacks=fallbacks + lifts)
    if (memory.cells != spline.frame.cells).any():
        memory = replace(memory, reference=sign * reference, largest=largest)
    return replace(spline, coefficients=sign * surface, report=report), memory


def limits(memory: Memory) -> Floats:
    """Return what no residual of a micro-cell exceeds: the largest that was computed, and all rounding on the way.

    The reference was evaluated at rounded coordinates, and the difference to the height was rounded.
    """
    rounding = largest_of_cells(slack_of(memory.reference))
    filled = np.abs(memory.largest, where=memory.count > 0, out=np.zeros(memory.largest.shape))
    return np.asarray(memory.largest + 2.0 * (_by_micro_cell(rounding, memory.split) + EPS * filled))


def _highest(memory: Memory, spline: SafeSpline, sign: float) -> tuple[Floats, Floats]:
    """Return the remembered points of filled micro-cells, those of one cell together."""
    uv = memory.uv + spline.frame.origin
    uv, height = by_cells(uv, np.where(memory.count > 0, sign * memory.height, -np.inf), memory.split)
    cells = np.minimum(uv.astype(np.int64), spline.frame.cells - 1)  # on a border perhaps not the one that counts it
    order = np.lexsort((cells[:, 1], cells[:, 0]))
    return uv[order], height[order]


def _by_micro_cell(by_cell: Floats, split: int) -> Floats:
    return np.repeat(np.repeat(by_cell, split, axis=0), split, axis=1)


def _highest_by_micro_cell(coefficients: Floats, split: int) -> Floats:
    """Return what a spline does not exceed over each micro-cell: the largest of its Bezier net there."""
    part = [_cut(a / split, (a + 1) / split) for a in range(split)]
    nets = bezier_nets(coefficients)
    n, m = nets.shape[:2]
    out = np.empty((n, split, m, split))
    for a in range(split):
        for b in range(split):
            out[:, a, :, b] = (part[a] @ nets @ part[b].T).max(axis=(2, 3))
    size = largest_of_cells(np.abs(coefficients))
    return out.reshape(n * split, m * split) + 32.0 * EPS * _by_micro_cell(size, split)


def _cut(start: float, end: float) -> Floats:
    """Return the matrix that takes a cubic's Bezier coefficients to those of its part from start to end (blossoms)."""

    def blossom(a: float, b: float, c: float) -> Floats:
        row = np.eye(4)
        for t in (a, b, c):
            row = (1.0 - t) * row[:-1] + t * row[1:]
        return np.asarray(row[0])

    return np.stack([blossom(*([end] * i + [start] * (3 - i))) for i in range(4)])
