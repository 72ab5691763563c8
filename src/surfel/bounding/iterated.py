"""The reference spline of large grids, without factors: a coarse fit, then conjugate gradients, level by level.

Where points lie everywhere alike, ``A^T W A`` is nearly a product of two small banded matrices, one along u and one
along v: the integrals of products of B-splines. Solving with these, scaled by the diagonal, takes as long as there are
coefficients, and a handful of steps does. Where there are no points the coarse fit, whose energy fills holes, stays as
it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfel._numba import inlined, inner, kernel
from surfel.bounding.candidates import Rows
from surfel.bounding.energy import add_bending
from surfel.bounding.evaluate import cell_of, values, weights
from surfel.bounding.lanes import there_and_back
from surfel.bounding.normal import Unknowns, unknowns_of
from surfel.bounding.products import Products, solve_product
from surfel.bounding.reference import STRETCHING, least_squares
from surfel.bounding.refinement import refined
from surfel.core.cast import Floats, Integers

COARSER = 4.0
"""Cells of the grid along a side of a cell of the coarse grid."""

SMALL = 60
"""Systems of no broader band are solved by factors."""

PER_CELL = 8
"""Points a coefficient for a coarse fit."""

MOST_STEPS = 40
ENOUGH = 0.01
"""The steps end when one gains less than this share of what is left of the sum of squares."""

ROUGHLY = 0.1
"""The same where it is only asked which points lie above the fit."""


def upper_by_steps(uv: Floats, z: Floats, unknowns: Unknowns, boundary: str, bending: float, below: float) -> Floats:
    """Return what :func:`surfel.bounding.fast.upper_spline` does, without factors."""
    steps = Steps.of(uv, z, unknowns, bending)
    x = start_coarse(uv, z, unknowns, boundary, bending)
    x = steps.from_(x, np.full(len(z), 1.0 / len(z)), ROUGHLY)
    weight = np.where(z > values(unknowns.spread(x), uv), 1.0, below)
    x = steps.from_(x, weight / weight.sum())
    return unknowns.spread(np.clip(np.where(np.isfinite(x), x, 0.0), -5.0, 5.0))


def start_coarse(uv: Floats, z: Floats, unknowns: Unknowns, boundary: str, bending: float) -> Floats:
    """Return the unknowns of a spline near the least-squares fit on a coarser grid, to begin with."""
    shape = len(unknowns.along_u) - 2, len(unknowns.along_v) - 2
    small = max(4, int(np.ceil((shape[0] - 1) / COARSER)) + 1), max(4, int(np.ceil((shape[1] - 1) / COARSER)) + 1)
    fewer = unknowns_of(small, boundary)
    some = slice(None, None, max(1, len(z) // (PER_CELL * fewer.size)))
    ends = np.array(small) - 1.0
    uv, z = np.minimum(uv[some] * (ends / (np.array(shape) - 1.0)), ends), z[some]
    if fewer.band <= SMALL:
        x = least_squares(Rows.of(uv, fewer), z, bending=bending)
    else:
        x = start_coarse(uv, z, fewer, boundary, bending)
        x = Steps.of(uv, z, fewer, bending).from_(x, np.full(len(z), 1.0 / len(z)))
    return unknowns.gather(refined(fewer.spread(x), shape, boundary))


@dataclass(frozen=True, eq=False)
class Steps:
    """Conjugate gradients towards the least ``sum w (F - z)^2 + bending |D2 b|^2`` over points sorted by cell.

    Parameters
    ----------
    place : Integers, shape (k, 2)
        The first coefficient of each point's cell, and the first of its sums.
    weights, z : Floats, shape (k, 8) and (k,)
        Weights of the points along u and along v, and their heights.
    unknowns : Unknowns
        How coefficients are numbered.
    products : Products
        What the steps are preconditioned with.
    bending : float
        Weight of the energy.
    """

    place: Integers
    weights: Floats
    z: Floats
    unknowns: Unknowns
    products: Products
    bending: float

    @classmethod
    def of(cls, uv: Floats, z: Floats, unknowns: Unknowns, bending: float) -> Steps:
        """Find the cells of points in the domain."""
        place, weights = np.empty((len(uv), 2), np.int64), np.empty((len(uv), 8))
        _place(uv, len(unknowns.along_u), len(unknowns.along_v), place, weights)
        return cls(place, weights, z, unknowns, Products.of(unknowns), bending)

    def from_(self, x: Floats, weight: Floats, enough: float = ENOUGH) -> Floats:
        """Return unknowns near the best ones for weights that add up to 1, from some to begin with."""
        turned, shape = self.unknowns.step_u == 1, self.products.shape
        found = np.array(x.reshape(shape[::-1]).T if turned else x.reshape(shape), order="C")
        _conjugate_gradients(
            self.place,
            self.weights,
            self.z,
            weight,
            self.unknowns.along_u,
            self.unknowns.along_v,
            *self.products.sides,
            float(self.bending),
            float(enough),
            found,
        )
        return np.ascontiguousarray(found.T if turned else found).ravel()


@kernel
def _place(uv, n, m, place, along):
    step = side_of(m)
    for i in range(uv.shape[0]):
        h, k = cell_of(uv[i, 0], n - 3), cell_of(uv[i, 1], m - 3)
        place[i, 0], place[i, 1] = h * m + k, (k % 4 * n + h) * step + k // 4 * 4
        a0, a1, a2, a3 = weights(uv[i, 0] - h)
        along[i, 0], along[i, 1], along[i, 2], along[i, 3] = a0 / 6.0, a1 / 6.0, a2 / 6.0, a3 / 6.0
        a0, a1, a2, a3 = weights(uv[i, 1] - k)
        along[i, 4], along[i, 5], along[i, 6], along[i, 7] = a0 / 6.0, a1 / 6.0, a2 / 6.0, a3 / 6.0


@inlined
def side_of(width):
    """Return how long rows of sums are for rows of coefficients of a width: a multiple of four."""
    return (width + 3) // 4 * 4


@inner
def _there_and_back(place, weights, factor, z, along_u, along_v, x, full, sums, out):
    # A^T W (A x - z), and the sum of squares. Under a boundary rule unknowns are spread to coefficients before, and
    # sums over these collected. Grid g of the sums holds what cells in columns k with k % 4 = g give: so no block lies
    # across another's border.
    n, m, step = full.shape[0], full.shape[1], sums.shape[2]
    if x.shape == full.shape:
        flat = x.ravel()
    else:
        for i in range(n):
            for j in range(m):
                full[i, j] = x[along_u[i], along_v[j]]
        flat = full.ravel()
    sums[:] = 0.0
    into, along, squares = sums.ravel(), weights.ravel(), 0.0
    for i in range(factor.shape[0]):
        value = there_and_back(flat, place[i, 0], m, along, 8 * i, z[i], factor[i], into, place[i, 1], step)
        squares += factor[i] * value * value
    total = out if x.shape == full.shape else full
    for i in range(n):
        for j in range(m):
            total[i, j] = sums[0, i, j]
        for g in range(1, 4):
            for j in range(m - g):
                total[i, j + g] += sums[g, i, j]
    if x.shape != full.shape:
        out[:] = 0.0
        for i in range(n):
            for j in range(m):
                out[along_u[i], along_v[j]] += full[i, j]
    return squares


@kernel
def _conjugate_gradients(place, weights, z, weight, along_u, along_v, side_u, side_v, bending, enough, x):
    n, m = x.shape
    cells = float((along_u.shape[0] - 3) * (along_v.shape[0] - 3))
    full = np.empty((along_u.shape[0], along_v.shape[0]))
    sums = np.empty((4, full.shape[0], side_of(full.shape[1])))
    residual, better, image, step = np.empty((n, m)), np.empty((n, m)), np.empty((n, m)), np.zeros((n, m))
    turned, nothing = np.empty((m, n)), np.zeros(z.shape[0])
    squares = _there_and_back(place, weights, weight, z, along_u, along_v, x, full, sums, image)
    add_bending(x, bending, image)
    for i in range(n):
        for j in range(m):
            residual[i, j] = -(image[i, j] + STRETCHING * x[i, j])
    before = 0.0
    for _ in range(MOST_STEPS):
        better[:] = residual
        solve_product(side_u, side_v, better, turned)
        now = 0.0
        for i in range(n):
            for j in range(m):
                better[i, j] *= cells
                now += residual[i, j] * better[i, j]
        if not now > 0.0:
            break
        share = now / before if before > 0.0 else 0.0
        before = now
        for i in range(n):
            for j in range(m):
                step[i, j] = better[i, j] + share * step[i, j]
        _there_and_back(place, weights, weight, nothing, along_u, along_v, step, full, sums, image)
        add_bending(step, bending, image)
        bent = 0.0
        for i in range(n):
            for j in range(m):
                image[i, j] += STRETCHING * step[i, j]
                bent += step[i, j] * image[i, j]
        length = now / bent
        for i in range(n):
            for j in range(m):
                x[i, j] += length * step[i, j]
                residual[i, j] -= length * image[i, j]
        gained = now * length
        squares -= gained
        if gained <= enough * max(squares, 0.0):
            break
