"""The reference spline of a large grid, without factors: a coarse fit, then conjugate gradients.

Where points lie everywhere alike, ``A^T W A`` is nearly a product of two small banded matrices, one along u and one
along v: the integrals of products of B-splines. Solving with these takes as long as there are coefficients, and a
handful of steps does. Where there are no points the coarse fit, whose energy fills holes, stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfel._numba import kernel
from surfel.bounding.candidates import Rows
from surfel.bounding.energy import bending_times
from surfel.bounding.evaluate import values
from surfel.bounding.normal import Unknowns, unknowns_of
from surfel.bounding.reference import STRETCHING, least_squares
from surfel.core.cast import Floats, Integers

COARSER = 3.0
"""Cells of the grid along a side of a cell of the coarse grid."""

PER_CELL = 8
"""Points a coefficient for the coarse fit."""

MOST_STEPS = 40
ENOUGH = 0.01
"""The steps end when one gains less than this share of what is left of the sum of squares."""


def upper_by_steps(uv: Floats, z: Floats, unknowns: Unknowns, boundary: str, bending: float, below: float) -> Floats:
    """Return what :func:`surfel.bounding.fast.upper_spline` does, without factors."""
    rows, products = Rows.of(uv, unknowns), Products.of(unknowns)
    x = start_coarse(uv, z, unknowns, boundary, bending)
    x = conjugate_gradients(rows, z, np.full(len(z), 1.0 / len(z)), products, x, bending)
    weight = np.where(z > rows.times(x), 1.0, below)
    x = conjugate_gradients(rows, z, weight / weight.sum(), products, x, bending)
    return unknowns.spread(np.clip(np.where(np.isfinite(x), x, 0.0), -5.0, 5.0))


def start_coarse(uv: Floats, z: Floats, unknowns: Unknowns, boundary: str, bending: float) -> Floats:
    """Return the unknowns of a spline near the least-squares fit on a coarser grid, to begin with."""
    shape = np.array([len(unknowns.along_u) - 2, len(unknowns.along_v) - 2])
    small = np.maximum(np.ceil((shape - 1) / COARSER).astype(np.int64) + 1, 4)
    ratio = (small - 1) / (shape - 1)
    some = slice(None, None, max(1, len(z) // (PER_CELL * int(small.prod()))))
    fewer = unknowns_of((int(small[0]), int(small[1])), boundary)
    rows = Rows.of(np.minimum(uv[some] * ratio, small - 1.0), fewer)
    coarse = fewer.spread(least_squares(rows, z[some], bending=bending))
    lines = [np.minimum(np.arange(float(n)) * r, s - 1.0) for n, r, s in zip(shape, ratio, small, strict=True)]
    at = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    inner = values(coarse, at).reshape(tuple(shape))
    for axis in (0, 1):  # (-1, 8, -1) / 6: the coefficients of a cubic from its values
        f = np.moveaxis(inner, axis, 0)
        wide = _longer(f)
        inner = np.moveaxis((8.0 * f - wide[:-2] - wide[2:]) / 6.0, 0, axis)
    if boundary == "clamped":
        return unknowns.gather(np.pad(inner, 1, mode="edge"))
    for axis in (0, 1):
        inner = np.moveaxis(_longer(np.moveaxis(inner, axis, 0)), 0, axis)
    return unknowns.gather(np.ascontiguousarray(inner))


def _longer(f: Floats) -> Floats:
    """Return rows with one more at each end, as a parabola goes on: a cubic would make more of noise."""
    first = 3.0 * f[:1] - 3.0 * f[1:2] + f[2:3]
    last = 3.0 * f[-1:] - 3.0 * f[-2:-1] + f[-3:-2]
    return np.concatenate([first, f, last])


@dataclass(frozen=True, eq=False)
class Products:
    """Factors of the matrices of integrals of products of B-splines, along u and along v.

    Parameters
    ----------
    sides : tuple of Floats, shape (size, 4)
        Banded Cholesky factors: row i holds the entries ``(i, i - 3) .. (i, i)``.
    shape : tuple of int
        Unknowns along u and v.
    """

    sides: tuple[Floats, Floats]
    shape: tuple[int, int]

    @classmethod
    def of(cls, unknowns: Unknowns) -> Products:
        """Return the factors for a numbering of unknowns."""
        shape = int(unknowns.along_u[-1]) + 1, int(unknowns.along_v[-1]) + 1
        return cls((_factor(unknowns.along_u), _factor(unknowns.along_v)), shape)

    def solve(self, right: Floats) -> Floats:
        """Return the solution, in two sweeps; ``right`` has the shape of the unknowns."""
        x = np.array(right, order="C")
        _solve_product(*self.sides, x)
        return x


def _factor(along: Integers) -> Floats:
    factor = np.zeros((int(along[-1]) + 1, 4))
    _factorize(along, _CELL, factor)
    return factor


_CELL = np.array([[20, 129, 60, 1], [129, 1188, 933, 60], [60, 933, 1188, 129], [1, 60, 129, 20]]) / 5040.0
"""Integrals over one cell of products of its four B-splines."""


@kernel
def _factorize(along, cell, factor):
    for first in range(along.shape[0] - 3):
        for a in range(4):
            for b in range(4):
                i, j = along[first + a], along[first + b]
                if j <= i:
                    factor[i, 3 - i + j] += cell[a, b]
    for i in range(factor.shape[0]):
        factor[i, 3] += 1e-9
        for j in range(max(0, i - 3), i + 1):
            total = factor[i, 3 - i + j]
            for k in range(max(0, i - 3), j):
                total -= factor[i, 3 - i + k] * factor[j, 3 - j + k]
            factor[i, 3 - i + j] = total / factor[j, 3] if j < i else np.sqrt(total)


@kernel
def _solve_product(along_u, along_v, x):
    n, m = x.shape
    for i in range(n):
        for k in range(max(0, i - 3), i):
            x[i] -= along_u[i, 3 - i + k] * x[k]
        x[i] *= 1.0 / along_u[i, 3]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, min(n, i + 4)):
            x[i] -= along_u[k, 3 - k + i] * x[k]
        x[i] *= 1.0 / along_u[i, 3]
    for i in range(n):
        for j in range(m):
            total = x[i, j]
            for k in range(max(0, j - 3), j):
                total -= along_v[j, 3 - j + k] * x[i, k]
            x[i, j] = total / along_v[j, 3]
        for j in range(m - 1, -1, -1):
            total = x[i, j]
            for k in range(j + 1, min(m, j + 4)):
                total -= along_v[k, 3 - k + j] * x[i, k]
            x[i, j] = total / along_v[j, 3]


def conjugate_gradients(rows: Rows, z: Floats, weight: Floats, products: Products, x: Floats, bending: float) -> Floats:
    """Return unknowns near those of least ``sum w (F - z)^2 + bending |D2 b|^2``; the weights add up to 1."""
    unknowns = rows.unknowns
    cells = (len(unknowns.along_u) - 3) * (len(unknowns.along_v) - 3)
    grid = _Grid(unknowns, products.shape)
    x = x.copy()
    left = z - rows.times(x)
    residual = rows.transposed_times(weight * left) - grid.energy(x, bending)
    squares = float(weight @ (left * left))
    step, before = np.zeros(len(x)), 0.0
    for _ in range(MOST_STEPS):
        better = grid.flat(products.solve(grid.square(residual))) * cells
        now = float(residual @ better)
        if not now > 0.0:
            break
        step = better + (now / before) * step if before > 0.0 else better
        before = now
        at_points = rows.times(step)
        image = rows.transposed_times(weight * at_points) + grid.energy(step, bending)
        length = now / float(step @ image)
        x += length * step
        residual -= length * image
        gained = now * length
        squares -= gained
        if gained <= ENOUGH * max(squares, 0.0):
            break
    return x


class _Grid:
    """Unknowns as a grid, along u and v, whatever order they are numbered in; and their energy there."""

    def __init__(self, unknowns: Unknowns, shape: tuple[int, int]) -> None:
        self._unknowns, self._shape, self._turned = unknowns, shape, unknowns.step_u == 1

    def square(self, x: Floats) -> Floats:
        return x.reshape(self._shape[::-1]).T if self._turned else x.reshape(self._shape)

    def flat(self, grid: Floats) -> Floats:
        return np.ascontiguousarray(grid.T if self._turned else grid).ravel()

    def energy(self, x: Floats, bending: float) -> Floats:
        """Return the gradient of half the energy."""
        return np.asarray(STRETCHING * x + bending_times(self._unknowns, x, bending))
