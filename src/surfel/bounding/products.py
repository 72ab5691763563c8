"""A product of two banded matrices, one along u and one along v: what normal equations are where points lie alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfel._numba import inner, kernel
from surfel.bounding.normal import Unknowns
from surfel.core.cast import Floats, Integers


@dataclass(frozen=True, eq=False)
class Products:
    """Factors of the matrices of integrals of products of B-splines, along u and along v.

    Parameters
    ----------
    sides : tuple of Floats, shape (size, 4)
        Banded Cholesky factors: row i holds the entries ``(i, i - 3) .. (i, i)``, the last as its inverse.
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
        """Return the solution; ``right`` has the shape of the unknowns."""
        x = np.array(right, order="C")
        _solve_once(*self.sides, x, np.empty(x.shape[::-1]))
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
            factor[i, 3 - i + j] = total * factor[j, 3] if j < i else 1.0 / np.sqrt(total)


@inner
def _sweeps(factor, x):
    # Down and up the rows; what is done to a row is done to its numbers side by side.
    n, m = x.shape
    for i in range(n):
        for k in range(max(0, i - 3), i):
            f = factor[i, 3 - i + k]
            for j in range(m):
                x[i, j] -= f * x[k, j]
        for j in range(m):
            x[i, j] *= factor[i, 3]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, min(n, i + 4)):
            f = factor[k, 3 - k + i]
            for j in range(m):
                x[i, j] -= f * x[k, j]
        for j in range(m):
            x[i, j] *= factor[i, 3]


@inner
def _turn(x, y):
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            y[j, i] = x[i, j]


@inner
def solve_product(along_u, along_v, x, turned):
    """Solve in place, with factors of both sides."""
    _sweeps(along_u, x)
    _turn(x, turned)
    _sweeps(along_v, turned)
    _turn(turned, x)


@kernel
def _solve_once(along_u, along_v, x, turned):
    solve_product(along_u, along_v, x, turned)
