"""The guarantee: a surface that lies above every point, rounding included.

Every point has been compared with a reference spline by the kernel that evaluates surfaces, and the largest residual of
each cell kept. The surface less the reference lies in each cell above the least of its Bezier coefficients. Where that
exceeds the largest residual by more than all rounding on the way, no point of the cell is above the surface; where it
does not, the surface is raised.

A raise is local: a coefficient goes up by the largest shortfall in the cells of its support, which is enough, because
the weights of a cell are not negative and add up to one. The slack against rounding is 32 units in the last place of
the largest of the 16 coefficients of a cell: a value is a sum of 16 products, each of a handful of roundings, in
whatever order an evaluator takes them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel
from surfel.bounding.bezier import cell_bounds, framed, largest_of_cells, over_windows
from surfel.bounding.evaluate import value_at
from surfel.bounding.frame import Frame, project
from surfel.bounding.lanes import larger
from surfel.bounding.occupancy import Quarters, inside_trim
from surfel.bounding.residuals import Residuals
from surfel.core.cast import Floats

EPS = float(np.finfo(np.float64).eps)
EVALUATED = 25.0 * EPS
"""How far two values that our kernel gives are off at most, as a share of the largest coefficient of their cell."""

LEAST = 1e-320
ROUNDS = 8
"""Raises after which a surface that still is not proven would be lifted as a whole; none is the rule."""


def violations(
    frame: Frame, coefficients: Floats, trim: Quarters, points: Floats, side: str = "above"
) -> tuple[int, float]:
    """Return how many points lie on the wrong side or outside the trim, and the worst excess (infinite outside)."""
    sign = 1.0 if side == "above" else -1.0
    found = np.zeros(2)
    _violations(points, frame.numbers(), sign * coefficients, np.array(trim), sign, found)
    return int(found[0]), float(found[1])


@dataclass(frozen=True, eq=False)
class Lead:
    """How far a surface lies above a reference spline in each cell, for points whose residuals to that are known.

    Parameters
    ----------
    low, high : Floats, shape (n - 1, m - 1)
        What the surface less the reference lies between, all rounding of two evaluations included.
    residuals : Residuals
        Of all points beside the reference.
    """

    low: Floats
    high: Floats
    residuals: Residuals

    @classmethod
    def of(cls, surface: Floats, reference: Floats, residuals: Residuals) -> Lead:
        """Bound the lead of a surface, by the coefficients of both."""
        low, high = cell_bounds(surface - reference)
        rounding = EVALUATED * largest_of_cells(np.maximum(np.abs(surface), np.abs(reference))) + 0.5 * LEAST
        return cls(low - rounding, high + rounding, residuals)

    def shortfall(self) -> Floats:
        """Return by how much the surface misses to be proven above the points of a cell; not positive where it is."""
        most = self.residuals.by_cell()
        return np.asarray(most + EPS * np.abs(most, where=most > -np.inf, out=np.zeros(most.shape)) - self.low)

    def gap_limits(self) -> Floats:
        """Return what no gap between a point and the surface exceeds, cell by cell; -inf where there are no points."""
        return np.asarray(self.high - self.residuals.smallest)


def proven(surface: Floats, reference: Floats, residuals: Residuals, clamped: bool) -> tuple[Floats, Lead, int]:
    """Return a surface that no point exceeds, its lead over the reference, and how often it was raised for that."""
    lead, lift = Lead.of(surface, reference, residuals), 0
    while (short := lead.shortfall()).max() > 0.0 and lift < ROUNDS:
        lift += 1
        surface = raised(surface, short if lift < ROUNDS else np.full(short.shape, 4.0 * short.max()), clamped)
        lead = Lead.of(surface, reference, residuals)
    return surface, lead, lift


def largest_gap(
    lead: Lead, surface: Floats, frame: Frame, points: Floats, sign: float, cells: NDArray[np.int32]
) -> float:
    """Return the largest gap between points, whose cells are given, and a surface above them.

    Points are evaluated where the bound on the gaps of their cell exceeds the largest that is known: first those of one
    cell, and mostly that is all.
    """
    limits, numbers, flat = lead.gap_limits().ravel(), frame.signed_numbers(sign), points.ravel()
    cell = int(limits.argmax())
    one = np.where(np.arange(len(limits)) == cell, limits, -np.inf)
    largest = float(_largest_gap(flat, numbers, surface, cells, one, -np.inf))
    limits[cell] = -np.inf
    return float(_largest_gap(flat, numbers, surface, cells, limits, largest)) if limits.max() > largest else largest


def raised(coefficients: Floats, by_cell: Floats, clamped: bool = False) -> Floats:
    """Return coefficients raised by the largest excess over the cells of their support; never lowered.

    With ``clamped`` the outermost coefficients stay equal to their neighbours.
    """
    lift = over_windows(framed(np.maximum(by_cell, 0.0), 3, 0.0), 4)
    return np.asarray(coefficients + (tied(lift) if clamped else lift))


def slack_of(coefficients: Floats) -> Floats:
    """Return the slack of each coefficient: what covers the rounding of any evaluator in the cells of its support."""
    size, step = np.empty(coefficients.shape), np.empty(coefficients.shape)
    _sizes(coefficients, size, step)
    # the second term: rounding of the domain coordinates themselves, a few units in the last place of n + m
    # the third: products of numbers near the least that there are
    return np.asarray(32.0 * EPS * _around(size) + 2.0 * EPS * sum(coefficients.shape) * _around(step) + LEAST)


def slackened(coefficients: Floats, clamped: bool = False) -> tuple[Floats, float]:
    """Return the coefficients with the slack added, and the largest slack."""
    slack = tied(slack_of(coefficients)) if clamped else slack_of(coefficients)
    return np.asarray(coefficients + slack), float(slack.max(initial=0.0))


def tied(lift: Floats) -> Floats:
    """Return coefficients, or raises of them, whose outermost equal their neighbours; none is smaller than before."""
    lift = lift.copy()
    lift[1], lift[-2] = np.maximum(lift[0], lift[1]), np.maximum(lift[-1], lift[-2])
    lift[:, 1], lift[:, -2] = np.maximum(lift[:, 0], lift[:, 1]), np.maximum(lift[:, -1], lift[:, -2])
    return np.pad(lift[1:-1, 1:-1], 1, mode="edge")


def _around(values: Floats) -> Floats:
    """Return the largest value among all coefficients that share a cell with each: a window of 7 x 7."""
    return over_windows(framed(values, 3, 0.0), 7)


@kernel
def _sizes(b, size, step):
    # how large each coefficient is, and how far from those before it
    for i in range(b.shape[0]):
        for j in range(b.shape[1]):
            size[i, j] = abs(b[i, j])
            step[i, j] = abs(b[i, j] - b[i - 1, j]) if i > 0 else 0.0
        for j in range(1, b.shape[1]):
            step[i, j] = larger(step[i, j], abs(b[i, j] - b[i, j - 1]))


@kernel
def _largest_gap(p, f, b, cells, limits, largest):
    for i in range(len(cells)):
        if limits[cells[i]] > largest:
            u, v, z = project(f, p[3 * i], p[3 * i + 1], p[3 * i + 2])
            largest = max(largest, value_at(b, u, v) - z)
    return largest


@kernel
def _violations(p, f, b, trim, sign, found):
    for i in range(p.shape[0]):
        u, v, z = project(f, p[i, 0], p[i, 1], p[i, 2])
        excess = sign * z - value_at(b, u, v)
        if not excess <= 0.0:
            found[0] += 1.0
            found[1] = max(found[1], excess) if excess == excess else np.inf
        elif not inside_trim(trim, u, v):
            found[0] += 1.0
            found[1] = np.inf
