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
from surfel.bounding.runs import add_scaled, dot_run, dot_tile
from surfel.core.cast import Floats, Integers

PAD = 16


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
    width = band.shape[1] - 1 - PAD
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
    # Four rows by four columns at a time: products of rows, which lie in memory from end to end, then a small solution.
    # Before its first entry a row reads zeros from the pad of the row above it.
    size, stride = band.shape
    width, step = stride - 1 - PAD, stride - 1
    band[:, width + 1 :] = 0.0
    flat, inverse, s = band.ravel(), np.empty(size), np.empty(16)
    whole = size - size % 4
    for i in range(0, whole, 4):
        first = max(0, i - width)
        for j in range(first // 4 * 4, i + 4, 4):
            eights = max(0, j - first + 7) // 8
            before, at = j - 8 * eights + width, i * step + j + width
            dot_tile(flat, i * step + before, j * step + before, step, eights, s)
            if j < i:
                low = j * step + j + width
                l10, l20, l21 = flat[low + step], flat[low + 2 * step], flat[low + 2 * step + 1]
                l30, l31, l32 = flat[low + 3 * step], flat[low + 3 * step + 1], flat[low + 3 * step + 2]
                d0, d1, d2, d3 = inverse[j], inverse[j + 1], inverse[j + 2], inverse[j + 3]
                for a in range(4):
                    x0 = (flat[at] - s[4 * a]) * d0
                    x1 = (flat[at + 1] - s[4 * a + 1] - l10 * x0) * d1
                    x2 = (flat[at + 2] - s[4 * a + 2] - l20 * x0 - l21 * x1) * d2
                    x3 = (flat[at + 3] - s[4 * a + 3] - l30 * x0 - l31 * x1 - l32 * x2) * d3
                    flat[at], flat[at + 1], flat[at + 2], flat[at + 3] = x0, x1, x2, x3
                    at += step
                continue
            for a in range(4):
                for c in range(a + 1):
                    value = flat[at + a * step + c] - s[4 * a + c]
                    for d in range(c):
                        value -= flat[at + a * step + d] * flat[at + c * step + d]
                    if c < a:
                        flat[at + a * step + c] = value * inverse[i + c]
                    elif value > 0.0:
                        flat[at + a * step + c] = np.sqrt(value)
                        inverse[i + a] = 1.0 / np.sqrt(value)
                    else:
                        return False
    for i in range(whole, size):
        for j in range(max(0, i - width), i + 1):
            first = max(0, i - width)
            row, other = i * step + width, j * step + width
            value = flat[row + j] - dot_run(flat, row + first, flat, other + first, j - first)
            if j < i:
                flat[row + j] = value * inverse[j]
            elif value > 0.0:
                flat[row + j] = np.sqrt(value)
                inverse[j] = 1.0 / np.sqrt(value)
            else:
                return False
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
