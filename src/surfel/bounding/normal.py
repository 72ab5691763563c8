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
from surfel.bounding.evaluate import weights
from surfel.bounding.runs import add_scaled, dot_run, subtract_panel
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


def factorize(band: Floats) -> bool:
    """Replace a band matrix by its Cholesky factor; False where it is not positive definite in double precision."""
    return bool(_cholesky(band))


def solve(factor: Floats, right: Floats) -> None:
    """Solve with a factor, in place."""
    _solve(factor, right)


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
def add_cell(local, h, k, along_u, along_v, step_u, step_v, band):
    """Add the symmetric 16 x 16 matrix of a cell, of which the lower triangle counts, to the band."""
    size, stride = band.shape
    width = stride - 1 - PAD
    if step_v == 1 and size == along_u.shape[0] * along_v.shape[0]:  # four coefficients along v lie side by side
        flat = band.ravel()
        for a in range(16):
            i = (h + a // 4) * step_u + k + a % 4
            for c in range(a // 4 + 1):  # on the diagonal the last of them may fall into the pad
                row = i * stride + (h + c) * step_u + k - i + width
                for b in range(4):
                    flat[row + b] += local[16 * a + 4 * c + b]
        return
    places = np.empty(16, np.int64)
    for a in range(16):
        places[a] = along_u[h + a // 4] * step_u + along_v[k + a % 4] * step_v
    for a in range(16):
        for b in range(a + 1):
            i, j = max(places[a], places[b]), min(places[a], places[b])
            twice = 2.0 if i == j and a != b else 1.0  # two coefficients that a boundary rule makes one
            band[i, j - i + width] += twice * local[16 * a + b]


@kernel
def _cholesky(band):
    # Eight columns at a time: each is made final, then all are taken from the rows below them, two rows in a sweep.
    size, stride = band.shape
    width = stride - 1 - PAD
    flat = band.ravel()
    length = width + 8 + 3 * PAD
    panel = np.zeros(8 * length)
    for j in range(0, size, 8):
        count = min(8, size - j)
        high = min(size - j, count + width)  # rows that the columns reach
        panel[:] = 0.0
        for i in range(high):
            row = (i + j) * stride + width - i
            if 8 <= i <= width:  # all eight columns: a loop that is unrolled
                for q in range(8):
                    panel[q * length + i] = flat[row + q]
            else:
                for q in range(max(0, i - width), min(count, i + 1)):
                    panel[q * length + i] = flat[row + q]
        for q in range(count):
            value = panel[q * length + q]
            if not value > 0.0:
                return False
            scale = 1.0 / np.sqrt(value)
            for i in range(q, high):
                panel[q * length + i] *= scale
            for r in range(q + 1, count):
                factor = -panel[q * length + r]
                for start in range(r, high, 8):
                    add_scaled(panel, r * length + start, factor, panel, q * length + start)
        for i in range(high):
            row = (i + j) * stride + width - i
            if 8 <= i <= width:
                for q in range(8):
                    flat[row + q] = panel[q * length + i]
            else:
                for q in range(max(0, i - width), min(count, i + 1)):
                    flat[row + q] = panel[q * length + i]
        for here in range(count, high, 2):
            first = (here + j) * stride + width - here
            second = first + stride - 1 if here + 1 < high else first
            subtract_panel(flat, first, second, panel, here, count, length, (here + 1 - count) // 8 + 1)
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
