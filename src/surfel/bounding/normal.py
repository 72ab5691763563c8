"""Banded systems of a tensor-product spline: normal equations and Cholesky factors.

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
from surfel.bounding.runs import add_scaled, dot_run, subtract_four
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

    @property
    def _plain(self) -> bool:
        """Whether the unknowns are the coefficients in their own order."""
        return self.step_v == 1 and self.size == len(self.along_u) * len(self.along_v)

    def spread(self, x: Floats) -> Floats:
        """Return all coefficients, shape (n + 2, m + 2), from the unknowns."""
        if self._plain:
            return x.reshape(len(self.along_u), len(self.along_v)).copy()
        return np.ascontiguousarray(x[self.along_u[:, None] * self.step_u + self.along_v * self.step_v])

    def gather(self, coefficients: Floats) -> Floats:
        """Return the unknowns of coefficients that obey the boundary rule."""
        x = np.empty(self.size)
        x[self.along_u[:, None] * self.step_u + self.along_v * self.step_v] = coefficients
        return x

    def collect(self, per_coefficient: Floats) -> Floats:
        """Return sums over the coefficients that each unknown stands for."""
        if self._plain:
            return per_coefficient.ravel().copy()
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
            if a >= 8:  # the lower triangle will do
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
    """Add the symmetric 16 x 16 matrix of a cell, of which the lower triangle counts, to the band, and clear it."""
    width = band.shape[1] - 1 - PAD
    places = np.empty(16, np.int64)
    for a in range(16):
        places[a] = along_u[h + a // 4] * step_u + along_v[k + a % 4] * step_v
    for a in range(16):
        for b in range(a + 1):
            i, j = max(places[a], places[b]), min(places[a], places[b])
            twice = 2.0 if i == j and a != b else 1.0  # two coefficients that a boundary rule makes one
            band[i, j - i + width] += twice * local[16 * a + b]
    local[:] = 0.0


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
    size, stride = factor.shape
    width = stride - 1 - PAD
    flat = factor.ravel()
    for i in range(size):
        near = min(i, width)
        row = i * stride + width
        right[i] = (right[i] - dot_run(flat, row - near, right, i - near, near)) / flat[row]
    for i in range(size - 1, -1, -1):
        near = min(i, width)
        row = i * stride + width
        value = right[i] / flat[row]
        right[i] = value
        whole = near - near % 8
        for c in range(0, whole, 8):
            add_scaled(right, i - near + c, -value, flat, row - near + c)
        for c in range(whole, near):
            right[i - near + c] -= value * flat[row - near + c]
