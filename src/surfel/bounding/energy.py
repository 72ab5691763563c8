"""The bending energy of a spline's coefficients, as a band matrix and without one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfel._numba import inner, kernel
from surfel.bounding.normal import PAD, Unknowns
from surfel.core.cast import Floats


def energy(unknowns: Unknowns, bending: float, stretching: float) -> Floats:
    """Return the band matrix of a thin plate's and a membrane's energy on the coefficients.

    ``bending * sum(D_uu^2 + 2 D_uv^2 + D_vv^2) + stretching * sum(D_u^2 + D_v^2)`` in differences of unknowns.
    """
    band = no_matrix(unknowns)
    rows, columns = int(unknowns.along_u[-1]) + 1, int(unknowns.along_v[-1]) + 1
    _energy(band, rows, columns, unknowns.step_u, unknowns.step_v, float(bending), float(stretching))
    return band


def no_matrix(unknowns: Unknowns) -> Floats:
    """Return a band matrix of zeros."""
    return np.zeros((unknowns.size, unknowns.band + 1 + PAD))


def bending_times(unknowns: Unknowns, x: Floats, bending: float) -> Floats:
    """Return the product of the matrix of the bending energy and x, without the matrix."""
    rows, columns = int(unknowns.along_u[-1]) + 1, int(unknowns.along_v[-1]) + 1
    grid = x.reshape((columns, rows) if unknowns.step_u == 1 else (rows, columns))  # it is the same for both sides
    out = np.zeros(grid.shape)
    add_bending(grid, float(bending), out)
    return out.ravel()


@dataclass(frozen=True, eq=False)
class Tether:
    """The energy ``price |x|^2 / 2 - pull.x`` and that of some bending: it keeps unknowns from running off.

    Parameters
    ----------
    unknowns : Unknowns
        What x numbers.
    bending, price : float
        Weights.
    pull : Floats, shape (size,)
        What draws x where it is to stay.
    """

    unknowns: Unknowns
    bending: float
    price: float
    pull: Floats

    def force(self, x: Floats) -> Floats:
        """Return the gradient of the energy at x, turned round."""
        return np.asarray(self.pull - self.price * x - bending_times(self.unknowns, x, self.bending))

    def matrix(self) -> Floats:
        """Return the matrix of the energy as a band matrix."""
        band = energy(self.unknowns, self.bending, 0.0)
        band[:, -1 - PAD] += self.price
        return band

    def loosened(self, factor: float, x: Floats) -> Tether:
        """Return the energy times a factor, drawing to x."""
        loose = Tether(self.unknowns, factor * self.bending, factor * self.price, np.zeros_like(x))
        return Tether(self.unknowns, loose.bending, loose.price, -loose.force(x))


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
                if room >= 1 and stretching != 0.0:
                    places[0], places[1] = here, here + step
                    factors[0], factors[1] = 1.0, -1.0
                    _stencil(band, places, factors, 2, stretching)
                if room >= 2 and bending != 0.0:
                    places[0], places[1] = here, here + step
                    places[2] = here + 2 * step
                    factors[0], factors[1], factors[2] = 1.0, -2.0, 1.0
                    _stencil(band, places, factors, 3, bending)
            if i + 1 < rows and j + 1 < columns and bending != 0.0:
                places[0], places[1] = here, here + step_u
                places[2], places[3] = here + step_v, here + step_u + step_v
                factors[0], factors[1], factors[2], factors[3] = 1.0, -1.0, -1.0, 1.0
                _stencil(band, places, factors, 4, 2.0 * bending)


@kernel
def add_bending(b, bending, out):
    """Add the gradient of half the bending energy of a grid of unknowns."""
    n, m = b.shape
    for i in range(n - 2):
        for j in range(m):
            d = bending * (b[i, j] - 2.0 * b[i + 1, j] + b[i + 2, j])
            out[i, j] += d
            out[i + 1, j] -= 2.0 * d
            out[i + 2, j] += d
    bend = np.zeros(m + 4)  # second differences of a row, with zeros beyond its ends
    for i in range(n):
        for j in range(m - 2):
            bend[j + 2] = bending * (b[i, j] - 2.0 * b[i, j + 1] + b[i, j + 2])
        for j in range(m):
            out[i, j] += bend[j] - 2.0 * bend[j + 1] + bend[j + 2]
    twist = np.zeros(m + 1)
    for i in range(n - 1):
        for j in range(m - 1):
            twist[j + 1] = 2.0 * bending * (b[i, j] - b[i + 1, j] - b[i, j + 1] + b[i + 1, j + 1])
        for j in range(m):
            d = twist[j + 1] - twist[j]
            out[i, j] += d
            out[i + 1, j] -= d
