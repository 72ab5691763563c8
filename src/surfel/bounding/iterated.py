"""The reference spline of large grids, without factors: a coarse fit, then conjugate gradients, level by level.

Where points lie everywhere alike, ``A^T W A`` is nearly a product of two small banded matrices, one along u and one
along v: the integrals of products of B-splines. Solving with these, scaled by the diagonal, takes as long as there are
coefficients, and a handful of steps does. Where there are no points the coarse fit, whose energy fills holes, stays as
it is.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import inner, kernel
from surfel.bounding.candidates import Rows
from surfel.bounding.energy import add_bending
from surfel.bounding.evaluate import cell_of, weights
from surfel.bounding.lanes import row_add, row_times
from surfel.bounding.normal import Unknowns, unknowns_of
from surfel.bounding.products import Products, solve_product
from surfel.bounding.reference import STRETCHING, least_squares
from surfel.core.cast import Floats

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
    rows, products = Rows.of(uv, unknowns), Products.of(unknowns)
    x = start_coarse(uv, z, unknowns, boundary, bending)
    x = conjugate_gradients(rows, z, np.full(len(z), 1.0 / len(z)), products, x, bending, ROUGHLY)
    weight = np.where(z > rows.times(x), 1.0, below)
    x = conjugate_gradients(rows, z, weight / weight.sum(), products, x, bending)
    return unknowns.spread(np.clip(np.where(np.isfinite(x), x, 0.0), -5.0, 5.0))


def start_coarse(uv: Floats, z: Floats, unknowns: Unknowns, boundary: str, bending: float) -> Floats:
    """Return the unknowns of a spline near the least-squares fit on a coarser grid, to begin with."""
    shape = len(unknowns.along_u) - 2, len(unknowns.along_v) - 2
    small = max(4, int(np.ceil((shape[0] - 1) / COARSER)) + 1), max(4, int(np.ceil((shape[1] - 1) / COARSER)) + 1)
    fewer = unknowns_of(small, boundary)
    some = slice(None, None, max(1, len(z) // (PER_CELL * fewer.size)))
    ends = np.array(small) - 1.0
    uv, z = np.minimum(uv[some] * (ends / (np.array(shape) - 1.0)), ends), z[some]
    rows = Rows.of(uv, fewer)
    if fewer.band <= SMALL:
        x = least_squares(rows, z, bending=bending)
    else:
        x = start_coarse(uv, z, fewer, boundary, bending)
        x = conjugate_gradients(rows, z, np.full(len(z), 1.0 / len(z)), Products.of(fewer), x, bending)
    along_u, along_v = (_refinement(n, of, boundary) for n, of in zip(shape, small, strict=True))
    return unknowns.gather(_between(along_u, fewer.spread(x), np.ascontiguousarray(along_v.T)))


def _between(left: Floats, x: Floats, right: Floats) -> Floats:
    """Return the product of three small matrices: on one thread, where numpy would wake others."""
    half, out = np.zeros((len(left), x.shape[1])), np.zeros((len(left), right.shape[1]))
    _add_product(left, x, half)
    _add_product(half, right, out)
    return out


def _refinement(n: int, small: int, boundary: str) -> Floats:
    """Return the matrix that makes coefficients along a side of n from those along a side of fewer."""
    place = np.minimum(np.arange(float(n)) * ((small - 1) / (n - 1)), small - 1.0)
    f = np.zeros((n, small + 2))
    _weigh_places(place, f)
    wide = _longer(f)
    f = (8.0 * f - wide[:-2] - wide[2:]) / 6.0  # the coefficients of a cubic from its values
    return np.concatenate([f[:1], f, f[-1:]]) if boundary == "clamped" else _longer(f)


def _longer(f: Floats) -> Floats:
    """Return rows with one more at each end, as a parabola goes on: a cubic would make more of noise."""
    first = 3.0 * f[:1] - 3.0 * f[1:2] + f[2:3]
    last = 3.0 * f[-1:] - 3.0 * f[-2:-1] + f[-3:-2]
    return np.concatenate([first, f, last])


def conjugate_gradients(
    rows: Rows, z: Floats, weight: Floats, products: Products, x: Floats, bending: float, enough: float = ENOUGH
) -> Floats:
    """Return unknowns near those of least ``sum w (F - z)^2 + bending |D2 b|^2``; the weights add up to 1."""
    unknowns = rows.unknowns
    turned = unknowns.step_u == 1
    square = x.reshape(products.shape[::-1]).T if turned else x.reshape(products.shape)
    found = np.array(square, order="C")
    _conjugate_gradients(
        rows.cell,
        rows.weight,
        z,
        weight,
        unknowns.along_u,
        unknowns.along_v,
        *products.sides,
        float(bending),
        float(enough),
        found,
    )
    return np.ascontiguousarray(found.T if turned else found).ravel()


@kernel
def _weigh_places(place, f):
    for i in range(place.shape[0]):
        cell = cell_of(place[i], f.shape[1] - 3)
        row = weights(place[i] - cell)
        for k in range(4):
            f[i, cell + k] = row[k] / 6.0


@kernel
def _add_product(a, b, out):
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            if a[i, k] != 0.0:
                for j in range(b.shape[1]):
                    out[i, j] += a[i, k] * b[k, j]


@inner
def _spread_and_collect(cell, rows, weight, z, along_u, along_v, x, full, sums, out):
    # A^T W (A x - z), and the sum of squares. Unknowns are spread to coefficients, sums over these collected again.
    n, m = full.shape
    for i in range(n):
        for j in range(m):
            full[i, j] = x[along_u[i], along_v[j]]
    sums[:], out[:] = 0.0, 0.0
    flat, into, along, squares = full.ravel(), sums.ravel(), rows.ravel(), 0.0
    for i in range(weight.shape[0]):
        place = cell[i, 0] * m + cell[i, 1]
        value = row_times(flat, place, m, along, 16 * i) - z[i]
        squares += weight[i] * value * value
        row_add(into, place, m, along, 16 * i, weight[i] * value)
    for i in range(n):
        for j in range(m):
            out[along_u[i], along_v[j]] += sums[i, j]
    return squares


@kernel
def _conjugate_gradients(cell, rows, z, weight, along_u, along_v, side_u, side_v, bending, enough, x):
    n, m = x.shape
    cells = float((along_u.shape[0] - 3) * (along_v.shape[0] - 3))
    full, sums = np.empty((along_u.shape[0], along_v.shape[0])), np.empty((along_u.shape[0], along_v.shape[0]))
    residual, better, image, step = np.empty((n, m)), np.empty((n, m)), np.empty((n, m)), np.zeros((n, m))
    turned, energy, nothing = np.empty((m, n)), np.empty((n, m)), np.zeros(z.shape[0])
    squares = _spread_and_collect(cell, rows, weight, z, along_u, along_v, x, full, sums, image)
    energy[:] = 0.0
    add_bending(x, bending, energy)
    for i in range(n):
        for j in range(m):
            residual[i, j] = -(image[i, j] + energy[i, j] + STRETCHING * x[i, j])
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
        _spread_and_collect(cell, rows, weight, nothing, along_u, along_v, step, full, sums, image)
        energy[:] = 0.0
        add_bending(step, bending, energy)
        bent = 0.0
        for i in range(n):
            for j in range(m):
                image[i, j] += energy[i, j] + STRETCHING * step[i, j]
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
