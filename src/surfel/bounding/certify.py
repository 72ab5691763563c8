"""The guarantee: every point is compared with the very surface that is handed out, which is raised where it must be.

A raise is local: a coefficient goes up by the largest violation in the cells of its support, which is enough, because
the weights of a cell are not negative and add up to one. The slack against rounding is 32 units in the last place of
the largest of the 16 coefficients of a cell: a value is a sum of 16 products, each of a handful of roundings, in
whatever order an evaluator takes them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfel._numba import kernel, rows, threads_for
from surfel.bounding.blocks import (
    HALVED,
    HEIGHT,
    ROWS,
    VALUE,
    evaluate_block,
    number_block,
    place_block,
    weigh_block,
)
from surfel.bounding.evaluate import value_at
from surfel.bounding.frame import Frame, project
from surfel.bounding.lanes import BLOCK
from surfel.bounding.occupancy import Quarters, inside_trim
from surfel.core.cast import Floats

EPS = float(np.finfo(np.float64).eps)
LEAST = 1e-320
ROUNDS = 8
"""Raises after which a surface that still has violations would be lifted as a whole; one is the rule."""


def violations(
    frame: Frame, coefficients: Floats, trim: Quarters, points: Floats, side: str = "above"
) -> tuple[int, float]:
    """Return how many points lie on the wrong side or outside the trim, and the worst excess (infinite outside)."""
    sign = 1.0 if side == "above" else -1.0
    found = np.zeros(2)
    _violations(points, frame.numbers(), sign * coefficients, np.array(trim), sign, found)
    return int(found[0]), float(found[1])


@dataclass(frozen=True, eq=False)
class Check:
    """What one look at all points says of a surface.

    Parameters
    ----------
    worst : Floats, shape (n - 1, m - 1)
        Largest excess of a point over the surface in each cell; -inf where there are none.
    total, largest : float
        Sum and largest of the gaps (surface less point).
    points : int
        How many points.
    """

    worst: Floats
    total: float
    largest: float
    points: int


def check(frame: Frame, coefficients: Floats, points: Floats, sign: float) -> Check:
    """Compare all points, each of which lies in the domain, with a surface above them."""
    parts = 2 if len(points) >= HALVED else 1
    worst = np.full((parts, int(frame.cells[0]), int(frame.cells[1])), -np.inf)
    sums = np.array([[0.0, -np.inf]] * parts)
    with threads_for(len(points)):
        _check(parts, points, frame.numbers(), coefficients, sign, worst, sums)
    return Check(worst.max(axis=0), float(sums[:, 0].sum()), float(sums[:, 1].max()), len(points))


def raised(coefficients: Floats, by_cell: Floats, clamped: bool = False) -> Floats:
    """Return coefficients raised by the largest excess over the cells of their support; never lowered.

    With ``clamped`` the outermost coefficients stay equal to their neighbours.
    """
    n, m = by_cell.shape
    lift = np.zeros(coefficients.shape)
    for i in range(4):
        for j in range(4):
            view = lift[i : i + n, j : j + m]
            np.maximum(view, by_cell, out=view)
    return np.asarray(coefficients + (tied(lift) if clamped else lift))


def slack_of(coefficients: Floats) -> Floats:
    """Return the slack of each coefficient: what covers the rounding of any evaluator in the cells of its support."""
    size = np.abs(coefficients)
    step = np.zeros(coefficients.shape)
    np.maximum(step[1:], np.abs(np.diff(coefficients, axis=0)), out=step[1:])
    np.maximum(step[:, 1:], np.abs(np.diff(coefficients, axis=1)), out=step[:, 1:])
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
    wide = np.pad(values, 3, constant_values=0.0)
    n, m = values.shape
    rows = wide[0:n].copy()
    for i in range(1, 7):
        np.maximum(rows, wide[i : i + n], out=rows)
    out = rows[:, 0:m].copy()
    for j in range(1, 7):
        np.maximum(out, rows[:, j : j + m], out=out)
    return out


@rows
def _check(begin, end, p, f, b, sign, worst, sums):
    w, place = np.empty(ROWS * BLOCK), np.empty(3 * BLOCK, np.int32)
    flat, coefficients, width = p.ravel(), b.ravel(), b.shape[1]
    for part in range(begin, end):
        by_cell = worst[part].ravel()
        total, largest = 0.0, -np.inf
        last = p.shape[0] * (part + 1) // len(sums)
        for first in range(p.shape[0] * part // len(sums), last, BLOCK):
            here = min(BLOCK, last - first)
            place_block(flat, first, here, f, sign, w)
            weigh_block(here, w)
            number_block(here, width, 1, w, place)
            evaluate_block(here, coefficients, width, place, w)
            sum_here = 0.0
            for i in range(here):
                gap = w[VALUE * BLOCK + i] - w[HEIGHT * BLOCK + i]
                sum_here += gap
                largest = max(largest, gap)
                cell = np.int64(place[BLOCK + i])
                if -gap > by_cell[cell]:
                    by_cell[cell] = -gap
            total += sum_here
        sums[part, 0], sums[part, 1] = total, largest


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
