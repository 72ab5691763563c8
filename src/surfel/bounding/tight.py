"""Mode ``tight``: the least mean gap, with a proof of how little is left to gain.

An interior-point method on candidates: of each micro-cell the point that stands out most from the reference. It begins
with multipliers that say how many points each stands for, which nearly balance the cost already. On the way, where 5 %
and 0.5 % are left to gain, it looks at all points: those that stand out join, and candidates that have hardly a
multiplier go. The multipliers give a lower bound on the mean gap of every spline of the grid.
"""

from __future__ import annotations

import numpy as np

from surfel.bounding.candidates import Rows, product
from surfel.bounding.certify import raised
from surfel.bounding.corners import corners_of, over_corners
from surfel.bounding.energy import Tether, no_matrix
from surfel.bounding.evaluate import values
from surfel.bounding.fast import fit_fast
from surfel.bounding.interior import Walk
from surfel.bounding.job import Duals, Job, Outcome, compared
from surfel.bounding.normal import PAD, factorize, solve
from surfel.bounding.reference import by_cells
from surfel.bounding.residuals import Residuals
from surfel.core.cast import Floats

LOOKS = (0.05, 0.005)
"""Shares of the mean gap left to gain at which all points are looked at."""

DROP = 0.05
"""At the first of these looks candidates go whose multipliers are below this share of the mean."""

FAR = 3.0
"""Where points stand out by more than so many mean gaps the walk begins anew, with them, where it began."""

MOST_STEPS = 60
TOLERANCE = 5e-3
"""Share of the mean gap that may be left to gain on the candidates."""

NEGLIGIBLE = 2e-3
"""Points that stand out by less than this share of the mean gap are left to the raise."""

CHEAP = 5e-3
"""All are left to it where it costs no more than this share of the mean gap: to let points join costs steps."""

PROVEN = 0.975
"""Share of the mean gap below which the lower bound is sought anew, with next to no tether."""

PROOF_LEFT = 0.01
"""Share of the mean gap that the lower bound may be charged for what multipliers leave of the cost."""

PROOF_STEPS = 8
"""Steps towards that, at most."""

DAMPING = 0.03
"""Weight of the damping of their steps."""

PROOF = 0.03
"""Share of the tether that is left when only the multipliers are wanted."""

TETHER = 1e-5
"""Price of a coefficient's distance from the surface to start from, in its mean gap: a coefficient with next to no
weight at any point would otherwise run off for a gain that is next to nothing."""

STIFF = 1e-2
"""Weight of bending beside that price."""

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
    uv, height, weight = job.uv, job.height, job.weight
    cost, level = _cost_of_candidates(job)
    if not job.source.streamed:
        seen = compared(job, reference.coefficients)
        cost, level = job.unknowns.collect(seen.mean_weights()), _level(job, seen)
        uv, height = by_cells(seen.uv, _heights(seen), job.split)
        weight = by_cells(seen.uv, np.where(seen.count > 0, seen.count, -np.inf), job.split)[1]
    rows, z = Rows.of(uv, job.unknowns), job.scale.inward(height)
    start = _start(job, reference.coefficients, uv, height)
    if product(cost, start) - level <= CLOSE:
        surface = job.scale.outward(job.unknowns.spread(start))
        return Outcome(surface, reference.rounds, 0, (rows, z, np.zeros(len(z))))
    price = TETHER * (product(cost, start) - level)
    tether = Tether(job.unknowns, STIFF * price, price, price * start)
    walk = Walk(rows, z, cost, level, tether, start, weight / weight.sum())
    _arrive(job, walk, start)
    x = walk.x if _is_better(walk.x, start, cost) else start
    surface = job.scale.outward(job.unknowns.spread(x))
    proven, y = _proven(job, walk.rows, walk.z, walk.y, cost, level)
    if proven - level < PROVEN * (product(cost, x) - level):
        walk.loosen(PROOF)
        while walk.steps < MOST_STEPS and walk.left(BOX) > TOLERANCE and walk.step():
            pass
        y = _proven(job, walk.rows, walk.z, walk.y, cost, level)[1]
    return Outcome(surface, walk.steps, 0, (walk.rows, walk.z, y))


def _arrive(job: Job, walk: Walk, start: Floats) -> None:
    """Walk to the optimum; points that stand out join at some looks at all of them."""
    looks = [] if job.source.streamed else list(LOOKS)
    while walk.steps < MOST_STEPS:
        left = walk.left()
        if looks and left <= looks[0]:
            first = looks.pop(0) == LOOKS[0]
            seen = compared(job, job.scale.outward(job.unknowns.spread(walk.x)))
            if _raise_of(seen) <= CHEAP * job.scale.half * walk.gap:
                continue
            excess = seen.largest / job.scale.half
            beyond = np.where(excess > NEGLIGIBLE * walk.gap, seen.height, -np.inf)
            uv, height = by_cells(seen.uv, beyond, job.split)
            away = float(excess.max()) > FAR * walk.gap
            if first and not away:
                walk.drop(DROP)
            if len(height):
                walk.admit(Rows.of(uv, job.unknowns), job.scale.inward(height), start if away else walk.x)
            left = walk.left()
        if (left <= TOLERANCE and not looks) or not walk.step():
            break


def _raise_of(seen: Residuals) -> float:
    """Return by how much the mean height of a surface grows if it is raised over all points."""
    return seen.mean_value(raised(np.zeros(seen.weights.shape), seen.by_cell()))


def _is_better(x: Floats, start: Floats, cost: Floats) -> bool:
    """Tell whether the interior method did its work: it may fail where rounding leaves the constraints no inside."""
    return bool(np.isfinite(x).all() and np.abs(x).max() <= TAME and product(cost, x) <= product(cost, start))


def dual_bound(job: Job, duals: Duals, residuals: Residuals) -> float:
    """Return a mean gap that no safe spline with coefficients within ten ranges of the middle goes below."""
    cost, level = job.unknowns.collect(residuals.mean_weights()), _level(job, residuals)
    steps = PROOF_STEPS if job.source.streamed else 0  # an array's points were all known when the steps were taken
    proven, _ = _proven(job, *duals, cost, level, steps)
    return job.scale.half * max(proven - level, 0.0)  # no gap is negative


def _proven(
    job: Job, rows: Rows, z: Floats, y: Floats, cost: Floats, level: float, steps: int = PROOF_STEPS
) -> tuple[float, Floats]:
    """Return a mean height that no safe spline with coefficients within ten ranges of the middle goes below.

    For multipliers y >= 0 of any points, every safe x has ``c.x >= y.z + (c - A^T y).x``; what is left of
    ``c - A^T y`` is charged with the box. The multipliers of the interior-point method are moved by a few weighted
    least-squares steps until that is little. The steps are damped by what is left: so hardly a multiplier would have to
    fall below zero, where the points of a coefficient cannot bear its cost. The multipliers are returned too.
    """
    best, kept, before = -np.inf, y, np.inf
    for step in range(steps + 1):
        left = cost - rows.transposed_times(y)
        charge, value = BOX * float(np.abs(left).sum()), product(y, z)
        if value - charge > best:
            best, kept = value - charge, y
        if step == steps or charge <= PROOF_LEFT * (value - level) or charge > 0.9 * before:
            break
        before = charge
        band = no_matrix(job.unknowns)
        rows.add_normal(y, band)
        band[:, -1 - PAD] += DAMPING * np.abs(left) + 1e-15
        if not factorize(band):
            break
        solve(band, left)
        y = np.maximum(y + y * rows.times(left), 0.0)
    return best, kept


def _start(job: Job, reference: Floats, uv: Floats, height: Floats) -> Floats:
    """Return a surface that is safe for the candidates, as unknowns: the interior method begins inside."""
    cells = np.minimum(uv.astype(np.int64), job.frame.cells - 1)
    by_cell = np.full((int(job.frame.cells[0]), int(job.frame.cells[1])), -np.inf)
    np.maximum.at(by_cell, (cells[:, 0], cells[:, 1]), height - values(reference, uv))
    above, _, _ = over_corners(corners_of(by_cell), job.boundary)
    return job.unknowns.gather(job.scale.inward(reference + above))


def _level(job: Job, seen: Residuals) -> float:
    """Return the mean height of all points, as fits see heights."""
    return float(job.scale.inward(np.array([seen.mean_height]))[0])


def _heights(seen: Residuals) -> Floats:
    return np.where(seen.count > 0, seen.height, -np.inf)


def _cost_of_candidates(job: Job) -> tuple[Floats, float]:
    """Return the mean weights and the mean height as the candidates of the first pass know them."""
    weight = job.weight / job.weight.sum()
    return Rows.of(job.uv, job.unknowns).transposed_times(weight), product(job.scale.inward(job.height), weight)
