"""Banded systems of a tensor-product spline: normal equations, bending energy, Cholesky factors.

Unknowns are the coefficients that a boundary rule leaves free: all ``(n + 2)(m + 2)`` of an ``open`` spline, the
``n m`` inner ones of a ``clamped`` one. They are numbered along the shorter side first, which keeps the band narrow.
Row i of a band matrix holds the entries ``(i, i - band) .. (i, i)`` of the lower triangle, and PAD places behind them
that vectors may run over.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfel._numba import inner, kernel
from surfel.bounding.evaluate import cell_of, weights
from surfel.bounding.lanes import add_scaled, subtract_four
from surfel.core.cast import Floats, Integers

PAD = 8


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Which unknown each coefficient is: ``along_u[i] * step_u + along_v[j] * step_v``.

    Parameters
    ----------
    along_u, along_v : Integers, shape (n + 2,) and (m + 2,)
        Number of the row or column among those that are free.
    step_u, step_v : int
        One of them is 1.
    size, band : int
        Number of unknowns, and how far apart two of one cell can be.
    """

    along_u: Integers
    along_v: Integers
    step_u: int
    step_v: int
    size: int
    band: int

    def spread(self, x: Floats) -> Floats:
        """Return all coefficients, shape (n + 2, m + 2), from the unknowns."""
        return np.ascontiguousarray(x[self.along_u[:, None] * self.step_u + self.along_v * self.step_v])

    def gather(self, coefficients: Floats) -> Floats:
        """Return the unknowns of coefficients that obey the boundary rule."""
        x = np.empty(self.size)
        x[self.along_u[:, None] * self.step_u + self.along_v * self.step_v] = coefficients
        return x

    def collect(self, per_coefficient: Floats) -> Floats:
        """Return sums over the coefficients that each unknown stands for."""
        place = self.along_u[:, None] * self.step_u + self.along_v * self.step_v
        return np.asarray(np.bincount(place.ravel(), weights=per_coefficient.ravel(), minlength=self.size), np.float64)


def unknowns_of(shape: tuple[int, int], boundary: str) -> Unknowns:
    """Return the numbering of a spline's unknowns under a boundary rule."""
    along = []
    for n in shape:
        every = np.arange(n + 2)
        along.append(every if boundary == "open" else np.clip(every - 1, 0, n - 1))
    sizes = [int(a[-1]) + 1 for a in along]
    step_u, step_v = (sizes[1], 1) if sizes[1] <= sizes[0] else (1, sizes[0])
    return Unknowns(along[0], along[1], step_u, step_v, sizes[0] * sizes[1], 3 * max(step_u, step_v) + 3)


def energy(unknowns: Unknowns, bending: float, stretching: float) -> Floats:
    """Return the band matrix of a thin plate's and a membrane's energy on the coefficients.

    ``bending * sum(D_uu^2 + 2 D_uv^2 + D_vv^2) + stretching * sum(D_u^2 + D_v^2)`` in differences of unknowns.
    """
    band = np.zeros((unknowns.size, unknowns.band + 1 + PAD))
    rows, columns = int(unknowns.along_u[-1]) + 1, int(unknowns.along_v[-1]) + 1
    _energy(band, rows, columns, unknowns.step_u, unknowns.step_v, float(bending), float(stretching))
    return band


def normal_equations(unknowns: Unknowns, uv: Floats, z: Floats, weight: Floats, band: Floats) -> Floats:
    """Add ``A^T W A`` to the band matrix and return ``A^T W z``; points are best sorted by cell."""
    right = np.zeros(unknowns.size)
    _normal(uv, z, weight, unknowns.along_u, unknowns.along_v, unknowns.step_u, unknowns.step_v, band, right)
    return right


def factorize(band: Floats) -> bool:
    """Replace a band matrix by its Cholesky factor; False where it is not positive definite in double precision."""
    return bool(_cholesky(band))


def solve(factor: Floats, right: Floats) -> None:
    """Solve with a factor, in place."""
    _solve(factor, right)


@inner
def _add(band, i, j, value):
    width = band.shape[1] - 1 - PAD
    if j <= i:
        band[i, j - i + width] += value
    else:
        band[j, i - j + width] += value


@inner
def _stencil(band, places, factors, count, scale):
    for a in range(count):
        for b in range(count):
            if places[b] <= places[a]:
                _add(band, places[a], places[b], scale * factors[a] * factors[b])


@kernel
def _energy(band, rows, columns, step_u, step_v, bending, stretching):
    places, factors = np.empty(4, np.int64), np.empty(4)
    for i in range(rows):
        for j in range(columns):
            here = i * step_u + j * step_v
            for step, room in ((step_u, rows - 1 - i), (step_v, columns - 1 - j)):
                if room >= 1:
                    places[0], places[1] = here, here + step
                    factors[0], factors[1] = 1.0, -1.0
                    _stencil(band, places, factors, 2, stretching)
                if room >= 2:
                    places[2] = here + 2 * step
                    factors[0], factors[1], factors[2] = 1.0, -2.0, 1.0
                    _stencil(band, places, factors, 3, bending)
            if i + 1 < rows and j + 1 < columns:
                places[0], places[1] = here, here + step_u
                places[2], places[3] = here + step_v, here + step_u + step_v
                factors[0], factors[1], factors[2], factors[3] = 1.0, -1.0, -1.0, 1.0
                _stencil(band, places, factors, 4, 2.0 * bending)


@kernel
def _normal(uv, z, weight, along_u, along_v, step_u, step_v, band, right):
    # Points of one cell are summed in a small dense matrix, which is added to the band when the cell changes.
    n, m = along_u.shape[0] - 3, along_v.shape[0] - 3
    local, side, row = np.zeros(256), np.zeros(16), np.empty(16)
    cell_u = cell_v = -1
    for i in range(uv.shape[0]):
        h, k = cell_of(uv[i, 0], n), cell_of(uv[i, 1], m)
        if h != cell_u or k != cell_v:
            if cell_u >= 0:
                _scatter_side(side, cell_u, cell_v, along_u, along_v, step_u, step_v, right)
                scatter_cell(local, cell_u, cell_v, along_u, along_v, step_u, step_v, band)
            cell_u, cell_v = h, k
        fill_row(uv[i, 0] - h, uv[i, 1] - k, row)
        for a in range(16):
            share = weight[i] * row[a]
            side[a] += share * z[i]
            add_scaled(local, 16 * a, share, row, 0)
            add_scaled(local, 16 * a + 8, share, row, 8)
    if cell_u >= 0:
        _scatter_side(side, cell_u, cell_v, along_u, along_v, step_u, step_v, right)
        scatter_cell(local, cell_u, cell_v, along_u, along_v, step_u, step_v, band)


@inner
def fill_row(s, t, row):
    """Write the 16 weights at local coordinates (s, t)."""
    u0, u1, u2, u3 = weights(s)
    v0, v1, v2, v3 = weights(t)
    v0, v1, v2, v3 = v0 / 36.0, v1 / 36.0, v2 / 36.0, v3 / 36.0
    row[0], row[1], row[2], row[3] = u0 * v0, u0 * v1, u0 * v2, u0 * v3
    row[4], row[5], row[6], row[7] = u1 * v0, u1 * v1, u1 * v2, u1 * v3
    row[8], row[9], row[10], row[11] = u2 * v0, u2 * v1, u2 * v2, u2 * v3
    row[12], row[13], row[14], row[15] = u3 * v0, u3 * v1, u3 * v2, u3 * v3


@inner
def _scatter_side(side, h, k, along_u, along_v, step_u, step_v, right):
    for a in range(16):
        right[along_u[h + a // 4] * step_u + along_v[k + a % 4] * step_v] += side[a]
        side[a] = 0.0


@inner
def scatter_cell(local, h, k, along_u, along_v, step_u, step_v, band):
    """Add the dense 16 x 16 matrix of a cell to the band, and clear it."""
    width = band.shape[1] - 1 - PAD
    places = np.empty(16, np.int64)
    for a in range(16):
        places[a] = along_u[h + a // 4] * step_u + along_v[k + a % 4] * step_v
    for a in range(16):
        i = places[a]
        for b in range(16):
            if places[b] <= i:
                band[i, places[b] - i + width] += local[16 * a + b]
            local[16 * a + b] = 0.0


@kernel
def fill_row_of(uv, n, m, cell, weight):
    """Write the cells and the 16 weights of points in the domain of n x m cells."""
    for i in range(uv.shape[0]):
        h, k = cell_of(uv[i, 0], n), cell_of(uv[i, 1], m)
        cell[i, 0], cell[i, 1] = h, k
        fill_row(uv[i, 0] - h, uv[i, 1] - k, weight[i])


@kernel
def _cholesky(band):
    # Four columns at a time: each is made final, then all four are taken from the rows below them in one sweep.
    size, stride = band.shape
    width = stride - 1 - PAD
    flat = band.ravel()
    length = width + 4 + PAD
    panel = np.zeros(4 * length)
    for j in range(0, size, 4):
        count = min(4, size - j)
        last = min(size - 1, j + count - 1 + width)
        panel[:] = 0.0
        for i in range(j, last + 1):
            for q in range(min(count, i - j + 1)):
                offset = j + q - i + width
                if offset < 0:
                    continue
                value = flat[i * stride + offset]
                for r in range(q):
                    value -= panel[r * length + i - j] * panel[r * length + q]
                if i == j + q:
                    if not value > 0.0:
                        return False
                    value = np.sqrt(value)
                else:
                    value /= panel[q * length + q]
                panel[q * length + i - j] = value
                flat[i * stride + offset] = value
        for i in range(j + count, last + 1):
            here = i - j
            a, b = panel[here], panel[length + here]
            c, d = panel[2 * length + here], panel[3 * length + here]
            row = i * stride + width - here
            for start in range(count, here + 1, 8):
                subtract_four(flat, row + start, a, b, c, d, panel, start, length)
    return True


@kernel
def _solve(factor, right):
    size, width = factor.shape[0], factor.shape[1] - 1 - PAD
    for i in range(size):
        total = right[i]
        for c in range(max(0, width - i), width):
            total -= factor[i, c] * right[i - width + c]
        right[i] = total / factor[i, width]
    for i in range(size - 1, -1, -1):
        right[i] /= factor[i, width]
        value = right[i]
        for c in range(max(0, width - i), width):
            right[i - width + c] -= factor[i, c] * value
