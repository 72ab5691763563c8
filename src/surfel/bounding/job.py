"""What a fit works on: the source, the frame, the heights' range and the highest points of the micro-cells."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surfel.bounding.candidates import Rows
from surfel.bounding.evaluate import values
from surfel.bounding.frame import Frame, frame_over
from surfel.bounding.gather import gather
from surfel.bounding.normal import Unknowns, unknowns_of
from surfel.bounding.passes import keep_highest, no_points, survey
from surfel.bounding.reference import Scale, by_cells
from surfel.bounding.residuals import Residuals, keep_residuals, no_residuals
from surfel.bounding.source import Source
from surfel.core.cast import Floats, as_points
from surfel.core.errors import InputError

Duals = tuple[Rows, Floats, Floats]
SPLIT = 4
"""Micro-cells along the side of a cell, at most; fewer where a micro-cell would have hardly a point."""

ENOUGH = 16
"""Points a micro-cell among which its highest is sought in an array; a fit is safe with any choice of them."""


@dataclass(frozen=True, eq=False)
class Job:
    """A fit that is about to be made. Heights carry the sign of the side: fits bound from above.

    Parameters
    ----------
    source : Source
        The points.
    frame : Frame
        The grid.
    sign : float
        1 for a surface above, -1 for one below.
    boundary : str
        ``open`` or ``clamped``.
    symmetric : bool
        Whether u and v are treated alike where the method has an order.
    scale : Scale
        The range of the signed heights.
    uv, height : Floats, shape (k, 2) and (k,)
        Highest points of the micro-cells, sorted by cell: candidates.
    weight : Floats, shape (k,)
        How many points each candidate stands for, as far as that is known before the second pass.
    points : int
        How many points there are.
    split : int
        Micro-cells along the side of a cell.
    unknowns : Unknowns
        The coefficients that the boundary rule leaves free.
    cells : NDArray, shape (points,)
        The cell of each point of an array, counted in rows along v, as the last look found it.
    """

    source: Source
    frame: Frame
    sign: float
    boundary: str
    symmetric: bool
    scale: Scale
    uv: Floats
    height: Floats
    weight: Floats
    points: int
    split: int
    unknowns: Unknowns
    cells: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a mode found: a surface that is nearly or fully safe, to be compared with every point.

    Parameters
    ----------
    coefficients : Floats, shape (n + 2, m + 2)
        Of the signed heights.
    rounds, fallbacks : int
        For the report.
    duals : tuple, optional
        Constraints and multipliers of the linear program: rows of A, heights z (k,), y (k,).
    """

    coefficients: Floats
    rounds: int
    fallbacks: int = 0
    duals: Duals | None = None


def prepare(
    source: Source, rotation: Floats, shape: tuple[int, int], sign: float, boundary: str, symmetric: bool
) -> Job:
    """Look at all points once or twice: lay the grid, keep the highest point of every micro-cell.

    Raises
    ------
    InputError
        If there are no points, or some are not finite.
    """
    look = _look_at_chunks if source.streamed else _look_at_array
    frame, low, high, candidates, points = look(source, rotation, shape, sign)
    low, high = sorted((sign * low, sign * high))
    return Job(
        source,
        frame,
        sign,
        boundary,
        symmetric,
        Scale.of(low, high),
        *candidates,
        points,
        split_for(points, shape),
        unknowns_of(shape, boundary),
        np.empty(0 if source.streamed else points, np.int32),
    )


def compared(job: Job, coefficients: Floats) -> Residuals:
    """Compare every point with a surface, in one pass.

    Raises
    ------
    InputError
        If chunks are not the same as before.
    """
    residuals = no_residuals(job.frame, job.split)
    cells = None if job.source.streamed else job.cells
    for chunk in job.source:
        keep_residuals(residuals, chunk, job.frame, coefficients, job.sign, cells)
    if residuals.points != job.points:
        raise InputError(
            f"points changed between two passes: {job.points} in the first, {residuals.points} in the second; "
            "give chunks that are the same each time they are read"
        )
    return residuals


def split_for(points: int, shape: tuple[int, int]) -> int:
    """Return the micro-cells along the side of a cell: some 1.5 points each where points are few."""
    cells = (shape[0] - 1) * (shape[1] - 1)
    return min(max(round(math.sqrt(points / (1.5 * cells))), 1), SPLIT)


def beside(job: Job, other: Floats) -> Job:
    """Return a job whose candidates also hold the other side's surface wherever cells have no points.

    There it decides alone, so that the two surfaces of a sandwich fill a hole alike.

    Parameters
    ----------
    job : Job
        The fit that is about to be made.
    other : Floats, shape (n + 2, m + 2)
        Coefficients of the other surface, in heights without sign.
    """
    filled = np.zeros(tuple(job.frame.cells), dtype=np.bool_)
    cells = np.minimum(job.uv.astype(np.int64), job.frame.cells - 1)
    filled[cells[:, 0], cells[:, 1]] = True
    inside = (np.arange(job.split) + 0.5) / job.split
    local = np.stack(np.meshgrid(inside, inside, indexing="ij"), axis=-1).reshape(1, -1, 2)
    uv = (np.argwhere(~filled)[:, None, :] + local).reshape(-1, 2)
    more = np.stack([uv[:, 0], uv[:, 1], job.sign * values(other, uv), np.zeros(len(uv))], axis=1)
    own = np.concatenate([job.uv, job.height[:, None], job.weight[:, None]], axis=1)
    rows = np.concatenate([own, more])
    cells = np.minimum(rows[:, :2].astype(np.int64), job.frame.cells - 1)
    rows = rows[np.lexsort((cells[:, 1], cells[:, 0]))]
    return replace(job, uv=rows[:, :2].copy(), height=rows[:, 2].copy(), weight=rows[:, 3].copy())


def _look_at_array(
    source: Source, rotation: Floats, shape: tuple[int, int], sign: float
) -> tuple[Frame, float, float, tuple[Floats, Floats, Floats], int]:
    (points,) = source
    if len(points) == 0:
        raise _no_points()
    usable, lowest, highest = survey(points, rotation)
    if not usable:
        raise unusable(points)
    frame = frame_over(rotation, lowest, highest, shape)
    split = split_for(len(points), shape)
    kept = no_points(frame, split)
    keep_highest(kept, points, frame, sign, max(1, len(points) // (ENOUGH * kept.height.size)))
    uv, height = by_cells(kept.uv, kept.height, split)
    return frame, float(lowest[2]), float(highest[2]), (uv, height, np.ones(len(height))), len(points)


def _look_at_chunks(
    source: Source, rotation: Floats, shape: tuple[int, int], sign: float
) -> tuple[Frame, float, float, tuple[Floats, Floats, Floats], int]:
    kept = gather(source, rotation, shape, sign, SPLIT)
    if kept.points == 0:
        raise _no_points()
    frame = frame_over(rotation, kept.lowest, kept.highest, shape)
    return (
        frame,
        float(kept.lowest[2]),
        float(kept.highest[2]),
        kept.over(frame, 2 * split_for(kept.points, shape)),
        kept.points,
    )


def unusable(points: Floats) -> InputError:
    """Return the error that tells which points cannot be used."""
    try:
        as_points(points)
    except InputError as error:
        return error
    return InputError(
        f"points has coordinates of up to {np.abs(points).max():.3g}; beyond 1e300 nothing can be bounded in double "
        "precision: scale them down"
    )


def _no_points() -> InputError:
    return InputError("points is empty; a surface needs at least one point to bound")
