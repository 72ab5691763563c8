"""A spline on a finer grid: its coefficients from those on a coarser one, by its values at the corners."""

from __future__ import annotations

import numpy as np

from surfel._numba import kernel
from surfel.bounding.evaluate import cell_of, weights
from surfel.core.cast import Floats


def refined(coefficients: Floats, shape: tuple[int, int], boundary: str) -> Floats:
    """Return coefficients of a spline of another shape over the same domain that has nearly the same values."""
    small = coefficients.shape[0] - 2, coefficients.shape[1] - 2
    along_u, along_v = (_refinement(n, of, boundary) for n, of in zip(shape, small, strict=True))
    return _between(along_u, coefficients, np.ascontiguousarray(along_v.T))


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
