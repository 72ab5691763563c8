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
from surfel.bounding.normal import PAD, factorize, solve
from surfel.core.cast import Floats

AROUND = 10.0
"""How many mean gaps coefficients may still move: what the dual residual is charged with."""

FLOOR = 0.1
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
        self._primal = self.rows.times(self.x) - self.s - self.z
        self._dual = self.rows.transposed_times(self.y) + self._tether.force(self.x) - self.cost
        gained = max(product(self.s, self.y), float(np.abs(self._primal).max())) / max(self.gap, 0.1 * self._first)
        return max(gained, max(AROUND, box / self.gap) * float(np.abs(self._dual).sum()))

    def step(self) -> bool:
        """Take one step from where :meth:`left` looked; False where rounding forbids it."""
        s, y, count = self.s, self.y, len(self.z)
        theta = y / s
        band = self._band
        np.copyto(band, self._matrix)
        self.rows.add_normal(theta, band)
        band[:, -1 - PAD] += 1e-14 + 1e-13 * band[:, -1 - PAD]
        if not (np.isfinite(theta).all() and factorize(band)):
            return False
        mu = product(s, y) / count
        dx, ds, dy = self._direction(band, theta, y)
        reach_s, reach_y = _reach(s, ds), _reach(y, dy)
        after = product(s + reach_s * ds, y + reach_y * dy) / count
        center = (after / mu) ** 3 * mu
        dx, ds, dy = self._direction(band, theta, y + (ds * dy - center) / s)
        reach_s, reach_y = min(1.0, 0.99 * _reach(s, ds, 1e9)), min(1.0, 0.99 * _reach(y, dy, 1e9))
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

    def _direction(self, factor: Floats, theta: Floats, removed: Floats) -> tuple[Floats, Floats, Floats]:
        """Return Newton's step; ``removed`` is what is to go of the products s y, over s."""
        dx = self._dual - self.rows.transposed_times(removed + theta * self._primal)
        solve(factor, dx)
        ds = self.rows.times(dx) + self._primal
        return dx, ds, -removed - theta * ds


def _reach(values: Floats, change: Floats, most: float = 1.0) -> float:
    """Return how far a step keeps all values positive."""
    return min(most, float(_farthest(values, change)))


@kernel
def _farthest(values, change):
    fastest = 0.0
    for i in range(values.shape[0]):
        if change[i] < fastest * values[i]:
            fastest = change[i] / values[i]
    return -1.0 / fastest if fastest < 0.0 else np.inf
