"""Points as rows of a matrix: the 16 weights that each has on the coefficients of its cell, and products with them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel
from surfel.bounding.evaluate import cell_of
from surfel.bounding.lanes import row_add, row_times
from surfel.bounding.normal import PAD, Unknowns, add_cell, fill_row
from surfel.bounding.runs import dot_run, gram_into, gram_run
from surfel.core.cast import Floats, Integers


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of A: for each candidate its cell and its 16 weights there; candidates of a cell lie together.

    Parameters
    ----------
    cell : Integers, shape (k, 2)
        Cells (h, k).
    weight : Floats, shape (k, 16)
        Weights on the cell's coefficients.
    unknowns : Unknowns
        How coefficients are numbered.
    """

    cell: Integers
    weight: Floats
    unknowns: Unknowns

    @classmethod
    def of(cls, uv: Floats, unknowns: Unknowns) -> Rows:
        """Return the rows of points in the domain."""
        cell, weight = np.empty((len(uv), 2), np.int64), np.empty((len(uv), 16))
        _fill(uv, len(unknowns.along_u) - 3, len(unknowns.along_v) - 3, cell, weight)
        return cls(cell, weight, unknowns)

    @property
    def place(self) -> Integers:
        """One number for each row that sorts them by cell."""
        return np.asarray(self.cell[:, 0] * len(self.unknowns.along_v) + self.cell[:, 1])

    def chosen(self, which: NDArray[Any]) -> Rows:
        """Return some of the rows, by a mask or by their numbers."""
        return Rows(self.cell[which], self.weight[which], self.unknowns)

    def with_more(self, other: Rows, order: Integers) -> Rows:
        """Return these rows and others in a new order."""
        cell, weight = np.concatenate([self.cell, other.cell]), np.concatenate([self.weight, other.weight])
        return Rows(cell[order], weight[order], self.unknowns)

    def times(self, x: Floats) -> Floats:
        """Return ``A x``."""
        out = np.empty(len(self.cell))
        _times(self.cell, self.weight, self.unknowns.spread(x), out)
        return out

    def transposed_times(self, y: Floats) -> Floats:
        """Return ``A^T y``."""
        shape = len(self.unknowns.along_u), len(self.unknowns.along_v)
        sums = np.zeros(shape)
        _transposed(self.cell, self.weight, y, sums)
        return self.unknowns.collect(sums)

    def add_normal(self, theta: Floats, band: Floats) -> None:
        """Add ``A^T diag(theta) A`` to a band matrix."""
        u = self.unknowns
        _add_normal(self.cell, self.weight, theta, u.along_u, u.along_v, u.step_u, u.step_v, band)


def product(x: Floats, y: Floats) -> float:
    """Return the inner product, in one order on one thread: for long vectors numpy would wake others and wait."""
    return float(_product(x, y))


@kernel
def _product(x, y):
    return dot_run(x, np.int64(0), y, np.int64(0), x.shape[0])


@kernel
def _fill(uv, n, m, cell, weight):
    for i in range(uv.shape[0]):
        h, k = cell_of(uv[i, 0], n), cell_of(uv[i, 1], m)
        cell[i, 0], cell[i, 1] = h, k
        fill_row(uv[i, 0] - h, uv[i, 1] - k, weight[i])


@kernel
def _times(cell, weight, b, out):
    width, flat, along = b.shape[1], b.ravel(), weight.ravel()
    for i in range(out.shape[0]):
        out[i] = row_times(flat, cell[i, 0] * width + cell[i, 1], width, along, 16 * i)


@kernel
def _transposed(cell, weight, y, sums):
    width, flat, along = sums.shape[1], sums.ravel(), weight.ravel()
    for i in range(y.shape[0]):
        row_add(flat, cell[i, 0] * width + cell[i, 1], width, along, 16 * i, y[i])


@kernel
def _add_normal(cell, weight, theta, along_u, along_v, step_u, step_v, band):
    local, flat, into = np.zeros(256), weight.ravel(), band.ravel()
    step = band.shape[1] - 1
    first = 0
    for i in range(1, theta.shape[0] + 1):
        if i == theta.shape[0] or cell[i, 0] != cell[first, 0] or cell[i, 1] != cell[first, 1]:
            h, k = cell[first, 0], cell[first, 1]
            if step_v == 1 and along_u[h + 3] - along_u[h] == 3 and along_v[k + 3] - along_v[k] == 3:
                place = along_u[h] * step_u + along_v[k]
                gram_into(into, place * step + place + step - PAD, step_u, step, theta, flat, first, i - first)
            else:
                gram_run(local, theta, flat, first, i - first)
                add_cell(local, h, k, along_u, along_v, step_u, step_v, band)
            first = i
