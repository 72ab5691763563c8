"""bound(): a smooth surface with every point of a cloud on one side, guaranteed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from surfel.bounding.certify import largest_gap, proven, raised, slackened
from surfel.bounding.corners import corners_of, over_corners
from surfel.bounding.enclosure import BOUNDARIES
from surfel.bounding.fast import fit_fast
from surfel.bounding.frame import rotation_onto
from surfel.bounding.job import Job, Outcome, beside, compared, prepare
from surfel.bounding.memory import Memory
from surfel.bounding.paper import fit_paper
from surfel.bounding.report import FitReport
from surfel.bounding.residuals import Residuals
from surfel.bounding.source import Source
from surfel.bounding.spline import SafeSpline
from surfel.bounding.tight import dual_bound, fit_tight
from surfel.bounding.trim import trimmed
from surfel.core.cast import Floats, as_choice, as_count, as_direction
from surfel.core.errors import InputError
from surfel.core.execute import Progress

MODES: dict[str, Callable[[Job], Outcome]] = {"paper": fit_paper, "fast": fit_fast, "tight": fit_tight}
SIDES = ("above", "below")


def bound(
    points: Any,
    direction: ArrayLike = (0.0, 0.0, 1.0),
    shape: tuple[int, int] | int = (20, 20),
    side: str = "above",
    mode: str = "fast",
    boundary: str = "open",
    symmetric: bool = False,
    progress: Progress | None = None,
) -> SafeSpline:
    """Fit a smooth height function that has every point on one side.

    Parameters
    ----------
    points : array_like of shape (n, 3), a cloud, or an iterable of these
        An iterable of chunks is passed over twice and never held in memory; it must begin anew each time, as a list of
        chunks and what :func:`surfel.open` returns do.
    direction : array_like, shape (3,)
        Heights are measured along it.
    shape : tuple of int, or int
        Coefficients along u and v of the ``clamped`` form, at least 4 each; ``open`` has two more in each direction.
    side : {"above", "below"}
        Whether the surface lies above or below the points, seen along the direction.
    mode : {"fast", "paper", "tight"}
        ``paper``: the tensor scheme of Myles and Peters, sec. 6. ``fast``: the same scheme on the residuals of a
        least-squares reference, much closer. ``tight``: the least mean gap to within some percent, with a proof, by an
        interior-point method.
    boundary : {"open", "clamped"}
        ``clamped`` repeats the outermost coefficients as the paper does, which costs closeness.
    symmetric : bool
        Average over both orders of u and v where the method has an order.
    progress : callable, optional
        Called with the share done and what is being done.

    Returns
    -------
    SafeSpline
        ``verify(points)`` is (0, 0.0).

    Raises
    ------
    InputError
        If there are no points, some are not finite, the direction is zero, or an option is unknown.

    Notes
    -----
    A. Myles and J. Peters, *Fast Safe Spline Surrogates for Large Point Clouds*.

    Examples
    --------
    >>> import numpy as np, surfel
    >>> p = np.random.default_rng(0).random((1000, 3))
    >>> lid = surfel.bound(p, shape=(8, 8))
    >>> lid.verify(p)
    (0, 0.0)
    """
    options = as_options(direction, shape, side, mode, boundary, symmetric)
    return fit(Source(points), options, progress)


def fit(source: Source, options: Options, progress: Progress | None = None, other: Floats | None = None) -> SafeSpline:
    """Fit one surface; ``other`` is the surface of the other side, which holes without points are to follow."""
    started = time.perf_counter()
    tell = progress or (lambda share, what: None)
    tell(0.0, "looking at the points")
    job = prepare(source, options.rotation, options.shape, options.sign, options.boundary, options.symmetric)
    tell(0.4, "fitting")
    outcome = MODES[options.mode](job if other is None else beside(job, other))
    tell(0.6, "comparing every point with the surface")
    residuals = compared(job, outcome.coefficients)
    spline = finished(job, options, outcome, residuals, started)
    tell(1.0, "done")
    return spline


@dataclass(frozen=True, eq=False)
class Options:
    """Arguments of :func:`bound`, validated."""

    rotation: Floats
    shape: tuple[int, int]
    side: str
    mode: str
    boundary: str
    symmetric: bool

    @property
    def sign(self) -> float:
        """Return 1 for a surface above the points, -1 for one below."""
        return 1.0 if self.side == "above" else -1.0


def as_options(
    direction: ArrayLike, shape: tuple[int, int] | int, side: str, mode: str, boundary: str, symmetric: bool
) -> Options:
    """Validate the arguments of a fit."""
    sides = (shape, shape) if isinstance(shape, int | np.integer) else shape
    try:
        n, m = sides
    except (TypeError, ValueError) as error:
        raise InputError(f"shape must be two whole numbers, or one for both; got {shape!r}") from error
    return Options(
        rotation_onto(as_direction(direction, "direction")),
        (as_count(n, "shape[0]", 4, 4096), as_count(m, "shape[1]", 4, 4096)),
        as_choice(side, "side", SIDES),
        as_choice(mode, "mode", tuple(MODES)),
        as_choice(boundary, "boundary", BOUNDARIES),
        bool(symmetric),
    )


def finished(job: Job, options: Options, outcome: Outcome, residuals: Residuals, started: float) -> SafeSpline:
    """Raise a surface over its residuals, add the slack, verify, and tell what came out."""
    clamped = job.boundary == "clamped"
    rounds, fallbacks = outcome.rounds, outcome.fallbacks
    by_cell, surfaces = residuals.by_cell(), []
    if options.mode != "fast":
        surfaces.append(raised(outcome.coefficients, by_cell, clamped))
    if options.mode != "paper":
        above, sweeps, contracted = over_corners(corners_of(by_cell), job.boundary, job.symmetric)
        rounds, fallbacks = rounds + sweeps, fallbacks + contracted
        surfaces.append(outcome.coefficients + above)
    surface = min(surfaces, key=residuals.mean_value) if len(surfaces) > 1 else surfaces[0]
    surface, slack = slackened(surface, clamped)
    surface, gap_mean, gap_max, lifts = _verified(job, surface, residuals, outcome.coefficients, clamped)
    report = FitReport(
        mode=options.mode,
        points=job.points,
        gap_mean=gap_mean,
        gap_max=gap_max,
        rounds=rounds,
        slack=slack,
        dual_bound=None if outcome.duals is None else dual_bound(job, outcome.duals, residuals),
        fallbacks=fallbacks + lifts,
        compression=3.0 * job.points / surface.size,
        seconds=time.perf_counter() - started,
    )
    return SafeSpline(
        job.frame,
        job.sign * surface,
        options.side,
        job.boundary,
        residuals.occupancy,
        trimmed(residuals.occupancy),
        report,
        Memory.of(outcome.coefficients, residuals, job.sign),
    )


def _verified(
    job: Job, surface: Floats, residuals: Residuals, reference: Floats, clamped: bool
) -> tuple[Floats, float, float, int]:
    """Return a surface that no point exceeds, its mean and largest gap, and how often it had to be raised again.

    Chunks are not read a third time: their largest gap is an upper bound.
    """
    surface, lead, lift = proven(surface, reference, residuals, clamped)
    if job.source.streamed:
        largest = float(lead.gap_limits().max())
    else:
        (points,) = job.source
        largest = largest_gap(lead, surface, job.frame, points, job.sign, job.cells)
    return surface, residuals.mean_gap(surface, reference), largest, lift
