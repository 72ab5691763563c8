"""The least mean gap as a linear program with a little bending energy, by a primal-dual interior-point method.

``min c.x + x.Q x / 2`` subject to ``A x >= z``, one row of A for each candidate point. Every step solves one banded
system ``(Q + A^T (Y / S) A) dx = r`` (Mehrotra's predictor and corrector share its factor). Feasibility is not needed
at the start: what is left over of it shrinks with the steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfel._numba import kernel
from surfel.bounding.lanes import add_scaled, row_add, row_times
from surfel.bounding.normal import PAD, Unknowns, factorize, fill_row_of, scatter_cell, solve
from surfel.core.cast import Floats, Integers

MOST_STEPS = 60


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of A: for each candidate its cell and its 16 weights there; candidates of a cell lie together.

    Parameters
    ----------
    cell : Integers, shape (k, 2)
        Cells (h, k).
    weight : Floats, shape (k, 16)
        Weights on the cell's coefficients.
    unknowns : Unknowns
        How coefficients are numbered.
    """

    cell: Integers
    weight: Floats
    unknowns: Unknowns

    @classmethod
    def of(cls, uv: Floats, unknowns: Unknowns) -> Rows:
        """Return the rows of points in the domain."""
        cell, weight = np.empty((len(uv), 2), np.int64), np.empty((len(uv), 16))
        fill_row_of(uv, len(unknowns.along_u) - 3, len(unknowns.along_v) - 3, cell, weight)
        return cls(cell, weight, unknowns)

    def times(self, x: Floats) -> Floats:
        """Return ``A x``."""
        out = np.empty(len(self.cell))
        _times(self.cell, self.weight, self.unknowns.spread(x), out)
        return out

    def transposed_times(self, y: Floats) -> Floats:
        """Return ``A^T y``."""
        shape = len(self.unknowns.along_u), len(self.unknowns.along_v)
        sums = np.zeros(shape)
        _transposed(self.cell, self.weight, y, sums)
        return self.unknowns.collect(sums)

    def add_normal(self, theta: Floats, band: Floats) -> None:
        """Add ``A^T diag(theta) A`` to a band matrix."""
        u = self.unknowns
        _add_normal(self.cell, self.weight, theta, u.along_u, u.along_v, u.step_u, u.step_v, band)


@dataclass(frozen=True, eq=False)
class Optimum:
    """Where the method ended: coefficients x, slacks s, multipliers y, steps taken."""

    x: Floats
    s: Floats
    y: Floats
    steps: int


def minimize(
    rows: Rows,
    z: Floats,
    cost: Floats,
    level: float,
    quadratic: Floats,
    pull: Floats,
    x: Floats,
    tolerance: float,
) -> Optimum:
    """Minimize ``(cost - pull).x + x.Q x / 2`` subject to ``A x >= z``.

    Parameters
    ----------
    rows : Rows
        The constraints.
    z : Floats, shape (k,)
        Heights of the candidates, from -1 to 1.
    cost : Floats, shape (size,)
        Mean weight of each unknown over all points.
    level : float
        Mean height of all points: ``cost.x - level`` is the mean gap.
    quadratic : Floats
        Band matrix Q.
    pull : Floats, shape (size,)
        What the quadratic part is centered on, times Q.
    x : Floats, shape (size,)
        Where to start.
    tolerance : float
        The method ends when the duality gap and what is left of infeasibility are below this share of the mean gap.

    Returns
    -------
    Optimum
        Nearly optimal; the constraints hold but for what is left of the infeasibility.
    """
    x = x.copy()
    over = rows.times(x) - z
    s = np.maximum(over, max(0.1 * float(np.abs(over).mean()), 1e-12))
    y = np.full(len(z), 1.0 / len(z))
    for step in range(MOST_STEPS):
        primal = rows.times(x) - s - z
        dual = rows.transposed_times(y) + pull - cost - band_times(quadratic, x)
        gap = float(s @ y)
        goal = tolerance * max(float(cost @ x) - level, 1e-12)
        if gap <= goal and float(np.abs(primal).max()) <= goal and float(np.abs(dual).sum()) <= 0.1 * goal:
            return Optimum(x, s, y, step)
        theta = y / s
        band = quadratic.copy()
        rows.add_normal(theta, band)
        band[:, -1 - PAD] += 1e-14 + 1e-13 * band[:, -1 - PAD]
        if not (np.isfinite(theta).all() and factorize(band)):
            break
        mu = gap / len(z)
        dx, ds, dy = _direction(rows, band, theta, s, y, primal, dual, s * y)
        reach_s, reach_y = _reach(s, ds), _reach(y, dy)
        after = float((s + reach_s * ds) @ (y + reach_y * dy)) / len(z)
        center = (after / mu) ** 3 * mu
        dx, ds, dy = _direction(rows, band, theta, s, y, primal, dual, s * y + ds * dy - center)
        reach_s, reach_y = 0.99 * _reach(s, ds, 1e9), 0.99 * _reach(y, dy, 1e9)
        x += min(1.0, reach_s) * dx
        s += min(1.0, reach_s) * ds
        y += min(1.0, reach_y) * dy
    return Optimum(x, s, y, MOST_STEPS)


def _direction(
    rows: Rows, factor: Floats, theta: Floats, s: Floats, y: Floats, primal: Floats, dual: Floats, product: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return Newton's step for given products ``s y`` to be removed."""
    dx = dual - rows.transposed_times(product / s + theta * primal)
    solve(factor, dx)
    ds = rows.times(dx) + primal
    return dx, ds, -(product / s) - theta * ds


def _reach(values: Floats, change: Floats, most: float = 1.0) -> float:
    """Return how far a step keeps all values positive."""
    falling = change < 0.0
    return float(min(most, (-values[falling] / change[falling]).min(initial=np.inf)))


def band_times(band: Floats, x: Floats) -> Floats:
    """Return the product of a symmetric band matrix and a vector."""
    out = np.zeros(len(x))
    _band_times(band, x, out)
    return out


@kernel
def _times(cell, weight, b, out):
    width, flat, along = b.shape[1], b.ravel(), weight.ravel()
    for i in range(out.shape[0]):
        out[i] = row_times(flat, cell[i, 0] * width + cell[i, 1], width, along, 16 * i)


@kernel
def _transposed(cell, weight, y, sums):
    width, flat, along = sums.shape[1], sums.ravel(), weight.ravel()
    for i in range(y.shape[0]):
        row_add(flat, cell[i, 0] * width + cell[i, 1], width, along, 16 * i, y[i])


@kernel
def _add_normal(cell, weight, theta, along_u, along_v, step_u, step_v, band):
    local = np.zeros(256)
    flat = weight.ravel()
    h = k = -1
    for i in range(theta.shape[0]):
        if cell[i, 0] != h or cell[i, 1] != k:
            if h >= 0:
                scatter_cell(local, h, k, along_u, along_v, step_u, step_v, band)
            h, k = cell[i, 0], cell[i, 1]
        for a in range(16):
            share = theta[i] * weight[i, a]
            add_scaled(local, 16 * a, share, flat, 16 * i)
            add_scaled(local, 16 * a + 8, share, flat, 16 * i + 8)
    if h >= 0:
        scatter_cell(local, h, k, along_u, along_v, step_u, step_v, band)


@kernel
def _band_times(band, x, out):
    size, width = band.shape[0], band.shape[1] - 1 - PAD
    for i in range(size):
        total = band[i, width] * x[i]
        for c in range(max(0, width - i), width):
            j = i - width + c
            total += band[i, c] * x[j]
            out[j] += band[i, c] * x[i]
        out[i] += total
