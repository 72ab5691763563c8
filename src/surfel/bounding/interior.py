"""The least mean gap as a linear program with a little bending energy, by a primal-dual interior-point method.

``min c.x + x.Q x / 2`` subject to ``A x >= z``, one row of A for each candidate point. Every step solves one banded
system ``(Q + A^T (Y / S) A) dx = r`` (Mehrotra's predictor and corrector share its factor). Feasibility is not needed
at the start: what is left over of it shrinks with the steps.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import kernel
from surfel.bounding.candidates import Rows, product
from surfel.bounding.energy import Tether, no_matrix
from surfel.bounding.lanes import row_add, row_times
from surfel.bounding.normal import PAD, factorize, solve
from surfel.core.cast import Floats

AROUND = 10.0
"""How many mean gaps coefficients may still move: what the dual residual is charged with."""

FLOOR = 0.3
"""Least slack, in mean gaps, of a constraint that joins: the walk begins inside of it."""


class Walk:
    """Where the method stands: coefficients x, slacks s, multipliers y. Constraints may join on the way.

    Minimizes ``cost.x`` and the energy of a tether subject to ``A x >= z``.

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
    tether : Tether
        What keeps x from running off.
    x : Floats, shape (size,)
        Where to start.
    y : Floats, shape (k,)
        Multipliers to start with: how much of the cloud each candidate stands for, which nearly balances the cost.
    """

    def __init__(self, rows: Rows, z: Floats, cost: Floats, level: float, tether: Tether, x: Floats, y: Floats) -> None:
        self.rows, self.z, self.x = rows, z, x.copy()
        self.cost, self.level, self.steps = cost, level, 0
        self._tether, self._matrix, self._band = tether, tether.matrix(), no_matrix(rows.unknowns)
        self._first = self.gap
        over = rows.times(x) - z
        self.s = np.maximum(over, max(0.1 * float(np.abs(over).mean()), 1e-12))
        self.y = np.maximum(y, 0.01 / len(z))

    @property
    def gap(self) -> float:
        """The mean gap of x, in half ranges."""
        return max(product(self.cost, self.x) - self.level, 1e-12)

    def left(self, box: float = 0.0) -> float:
        """Return what may be left to gain, or to mend, as a share of the mean gap.

        The dual residual is charged with how far coefficients may still move: some mean gaps, or all of a ``box``.
        """
        self._primal = self.rows.times(self.x)
        worst = float(_less(self._primal, self.s, self.z))
        self._dual = self.rows.transposed_times(self.y) + self._tether.force(self.x) - self.cost
        gained = max(product(self.s, self.y), worst) / max(self.gap, 0.1 * self._first)
        return max(gained, max(AROUND, box / self.gap) * float(np.abs(self._dual).sum()))

    def step(self) -> bool:
        """Take one step from where :meth:`left` looked; False where rounding forbids it."""
        s, y, count = self.s, self.y, len(self.z)
        theta, removed, ds, dy = y / s, y.copy(), np.empty(count), np.empty(count)
        band = self._band
        np.copyto(band, self._matrix)
        self.rows.add_normal(theta, band)
        band[:, -1 - PAD] += 1e-14 + 1e-13 * band[:, -1 - PAD]
        if not (np.isfinite(theta).all() and factorize(band)):
            return False
        mu = product(s, y) / count
        _, reach_s, reach_y = self._direction(band, theta, removed, ds, dy)
        after = float(_ahead(s, y, ds, dy, min(1.0, reach_s), min(1.0, reach_y))) / count
        _correct(s, y, ds, dy, (after / mu) ** 3 * mu, removed)
        dx, reach_s, reach_y = self._direction(band, theta, removed, ds, dy)
        reach_s, reach_y = (min(1.0, 0.99 * min(reach, 1e9)) for reach in (reach_s, reach_y))
        self.x += reach_s * dx
        self.s += reach_s * ds
        self.y += reach_y * dy
        self.steps += 1
        return True

    def loosen(self, factor: float) -> None:
        """Multiply the tether by a factor, and let it draw to where the walk stands."""
        self._tether = self._tether.loosened(factor, self.x)
        self._matrix = self._tether.matrix()
        self._draw_back(self.y)

    def admit(self, rows: Rows, z: Floats, x: Floats) -> None:
        """Let more constraints join, and go on from x. All draw back from the border first: else steps are short."""
        self.x = x.copy()
        order = np.argsort(np.concatenate([self.rows.place, rows.place]), kind="stable")
        self.rows = self.rows.with_more(rows, order)
        self.z = np.concatenate([self.z, z])[order]
        self._draw_back(np.concatenate([self.y, np.zeros(len(z))])[order])

    def _draw_back(self, y: Floats) -> None:
        self.s = np.maximum(self.rows.times(self.x) - self.z, FLOOR * self.gap)
        self.y = np.maximum(y, product(self.s, y) / (len(y) * self.s))

    def drop(self, share: float) -> None:
        """Let constraints go whose multipliers are less than a share of the mean."""
        near = self.y > share * self.y.mean()
        self.rows, self.z, self.s, self.y = self.rows.chosen(near), self.z[near], self.s[near], self.y[near]

    def _direction(
        self, factor: Floats, theta: Floats, removed: Floats, ds: Floats, dy: Floats
    ) -> tuple[Floats, float, float]:
        """Return Newton's step of x, write that of s and y, and tell how far both may go and stay positive.

        ``removed`` is what is to go of the products s y, over s.
        """
        rows, unknowns = self.rows, self.rows.unknowns
        sums = np.zeros((len(unknowns.along_u), len(unknowns.along_v)))
        _collect(rows.cell, rows.weight, removed, theta, self._primal, sums)
        dx = self._dual - unknowns.collect(sums)
        solve(factor, dx)
        _spread(rows.cell, rows.weight, unknowns.spread(dx), removed, theta, self._primal, ds, dy)
        return dx, float(_reach(self.s, ds)), float(_reach(self.y, dy))


@kernel
def _less(values, s, z):
    # values less s less z, in place, and the largest of their sizes
    worst = 0.0
    for i in range(values.shape[0]):
        values[i] = values[i] - s[i] - z[i]
        worst = max(worst, abs(values[i]))
    return worst


@kernel
def _collect(cell, weight, removed, theta, primal, sums):
    width, flat, along = sums.shape[1], sums.ravel(), weight.ravel()
    for i in range(removed.shape[0]):
        value = removed[i] + theta[i] * primal[i]
        row_add(flat, cell[i, 0] * width + cell[i, 1], width, along, 16 * i, value)


@kernel
def _spread(cell, weight, b, removed, theta, primal, ds, dy):
    width, flat, along = b.shape[1], b.ravel(), weight.ravel()
    for i in range(removed.shape[0]):
        ds[i] = row_times(flat, cell[i, 0] * width + cell[i, 1], width, along, 16 * i) + primal[i]
        dy[i] = -removed[i] - theta[i] * ds[i]


@kernel
def _ahead(s, y, ds, dy, reach_s, reach_y):
    total = 0.0
    for i in range(s.shape[0]):
        total += (s[i] + reach_s * ds[i]) * (y[i] + reach_y * dy[i])
    return total


@kernel
def _correct(s, y, ds, dy, center, removed):
    for i in range(s.shape[0]):
        removed[i] = y[i] + (ds[i] * dy[i] - center) / s[i]


@kernel
def _reach(values, change):
    # how far a step keeps all values positive
    fastest = 0.0
    for i in range(values.shape[0]):
        if change[i] < fastest * values[i]:
            fastest = change[i] / values[i]
    return -1.0 / fastest if fastest < 0.0 else np.inf
