"""Mode ``tight``: the least mean gap, with a proof of how little is left to gain.

An interior-point method on candidates (the highest points of the micro-cells and those that stand out most from the
reference), then a look at all points, which adds the worst violators; twice. The linear program's multipliers give a
lower bound on the mean gap of every spline of the grid.
"""

from __future__ import annotations

import numpy as np

from surfel.bounding.corners import corners_of, over_corners
from surfel.bounding.evaluate import values
from surfel.bounding.fast import fit_fast
from surfel.bounding.interior import Rows, minimize
from surfel.bounding.job import Duals, Job, Outcome, joined
from surfel.bounding.normal import PAD, energy, factorize, solve
from surfel.bounding.passes import Residuals, keep_residuals, no_residuals
from surfel.bounding.reference import by_cells
from surfel.core.cast import Floats

ROUNDS = 3
TOLERANCE = 5e-3
"""Share of the mean gap that may be left to gain on the candidates."""

NEGLIGIBLE = 2e-3
"""Points that stand out by less than this share of the mean gap are left to the raise."""

PROVEN = 0.975
"""Share of the mean gap below which the lower bound is sought anew, with next to no tether."""

PROOF = 0.03
"""Share of the tether that is left when only the multipliers are wanted."""

TETHER = 3e-5
"""Price of a coefficient's distance from the surface to start from, in its mean gap: a coefficient with next to no
weight at any point would otherwise run off for a gain that is next to nothing."""

CLOSE = 1e-9
"""Mean gap, in half ranges, below which a surface is taken as it is: what is left is rounding."""

TAME = 16.0
"""Coefficients further from the middle, in half ranges, are not accepted."""

BOX = 20.0
"""The lower bound is on splines whose coefficients lie within this many half ranges of the middle: ten ranges."""


def fit_tight(job: Job) -> Outcome:
    """Return the surface of least mean gap over the candidates; safe for them, nearly so for all points."""
    reference = fit_fast(job)
    if job.scale.half == 0.0:
        return reference
    uv, height, cost = job.uv, job.height, _cost_of_candidates(job)
    level = float(job.scale.inward(height) @ job.weight) / float(job.weight.sum())
    if not job.source.streamed:
        seen = _look(job, reference.coefficients)
        cost = job.unknowns.collect(seen.mean_weights())
        level = _level(job, seen)
        uv, height = joined(job.frame, uv, height, *by_cells(seen.uv, _heights(seen), job.split))
    x = start = _start(job, reference.coefficients, uv, height)
    if float(cost @ x) - level <= CLOSE:
        return Outcome(
            job.scale.outward(job.unknowns.spread(x)),
            reference.rounds,
            0,
            (Rows.of(uv, job.unknowns), job.scale.inward(height), np.zeros(len(height))),
        )
    price = TETHER * (float(cost @ x) - level)
    steps = 0
    for left in range(ROUNDS, 0, -1):
        rows, z = Rows.of(uv, job.unknowns), job.scale.inward(height)
        best = minimize(rows, z, cost, level, *_tether(job, price, start), x, TOLERANCE)
        steps, x = steps + best.steps, best.x
        surface = job.scale.outward(job.unknowns.spread(x))
        if job.source.streamed or left == 1:
            break
        seen = _look(job, surface)
        beyond = seen.largest > NEGLIGIBLE * (seen.mean_value(surface) - seen.mean_height)
        if not beyond.any():
            break
        near = (best.s < best.s.mean()) | (best.y > 1e-2 * best.y.mean())
        more = by_cells(seen.uv, np.where(beyond, _heights(seen), -np.inf), job.split)
        uv, height = joined(job.frame, uv[near], height[near], *more)
    if not _is_better(x, start, cost):
        surface = job.scale.outward(job.unknowns.spread(start))
    y = best.y
    if _proven(job, rows, z, y, cost) - level < PROVEN * (float(cost @ x) - level):
        y = minimize(rows, z, cost, level, *_tether(job, PROOF * price, x), x, TOLERANCE).y
    return Outcome(surface, steps, 0, (rows, z, y))


def _is_better(x: Floats, start: Floats, cost: Floats) -> bool:
    """Tell whether the interior method did its work: it may fail where rounding leaves the constraints no inside."""
    return bool(np.isfinite(x).all() and np.abs(x).max() <= TAME and float(cost @ x) <= float(cost @ start))


def _tether(job: Job, price: float, center: Floats) -> tuple[Floats, Floats]:
    """Return the energy of the distance from a surface, with a little bending: its band matrix and its pull."""
    quadratic = energy(job.unknowns, 1e-2 * price, 0.0)
    quadratic[:, -1 - PAD] += price
    return quadratic, price * center


def dual_bound(job: Job, duals: Duals, residuals: Residuals) -> float:
    """Return a mean gap that no safe spline with coefficients within ten ranges of the middle goes below."""
    cost, level = job.unknowns.collect(residuals.mean_weights()), _level(job, residuals)
    proven = _proven(job, *duals, cost)
    return job.scale.half * max(proven - level, 0.0)  # no gap is negative


def _proven(job: Job, rows: Rows, z: Floats, y: Floats, cost: Floats) -> float:
    """Return a mean height that no safe spline with coefficients within ten ranges of the middle goes below.

    For multipliers y >= 0 of any points, every safe x has ``c.x >= y.z + (c - A^T y).x``. The multipliers of the
    interior-point method are moved by a few weighted least-squares steps until ``c - A^T y`` is next to nothing; what
    is left is charged with the box.
    """
    best = -np.inf
    for _ in range(8):
        left = cost - rows.transposed_times(y)
        charge = BOX * float(np.abs(left).sum())
        best = max(best, float(y @ z) - charge)
        if charge <= 1e-9:
            break
        band = energy(job.unknowns, 0.0, 0.0)
        rows.add_normal(y, band)
        band[:, -1 - PAD] += 1e-15 + 1e-12 * band[:, -1 - PAD]
        if not factorize(band):
            break
        solve(band, left)
        y = np.maximum(y + y * rows.times(left), 0.0)
    return best


def _start(job: Job, reference: Floats, uv: Floats, height: Floats) -> Floats:
    """Return a surface that is safe for the candidates, as unknowns: the interior method begins inside."""
    cells = np.minimum(uv.astype(np.int64), job.frame.cells - 1)
    by_cell = np.full((int(job.frame.cells[0]), int(job.frame.cells[1])), -np.inf)
    np.maximum.at(by_cell, (cells[:, 0], cells[:, 1]), height - values(reference, uv))
    above, _, _ = over_corners(corners_of(by_cell), job.boundary)
    return job.unknowns.gather(job.scale.inward(reference + above))


def _look(job: Job, surface: Floats) -> Residuals:
    seen = no_residuals(job.frame, job.split)
    for chunk in job.source:
        keep_residuals(seen, chunk, job.frame, surface, job.sign)
    return seen


def _level(job: Job, seen: Residuals) -> float:
    """Return the mean height of all points, as fits see heights."""
    return float(job.scale.inward(np.array([seen.mean_height]))[0])


def _heights(seen: Residuals) -> Floats:
    return np.where(seen.count > 0, seen.height, -np.inf)


def _cost_of_candidates(job: Job) -> Floats:
    rows = Rows.of(job.uv, job.unknowns)
    return rows.transposed_times(job.weight / job.weight.sum())
