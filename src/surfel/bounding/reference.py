"""The reference spline of mode ``fast``: least squares through the highest points of the micro-cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel
from surfel.bounding.candidates import Rows
from surfel.bounding.energy import energy
from surfel.bounding.normal import factorize, solve
from surfel.core.cast import Floats

BENDING = 1e-7
"""Weight of the bending energy beside a mean square of one range: it decides only where there are no points."""

STRETCHING = 1e-12


@dataclass(frozen=True)
class Scale:
    """Heights as fits see them: ``(z - middle) / half``, from -1 to 1."""

    middle: float
    half: float

    @classmethod
    def of(cls, low: float, high: float) -> Scale:
        """Return the scale of heights from ``low`` to ``high``; halves are taken first, so that nothing overflows."""
        return cls(0.5 * low + 0.5 * high, max(0.5 * high - 0.5 * low, 0.0))

    def inward(self, z: Floats) -> Floats:
        """Return heights in units of the scale; zero where all heights are equal."""
        return np.asarray((z - self.middle) / self.half if self.half > 0.0 else np.zeros_like(z))

    def outward(self, z: Floats) -> Floats:
        """Return heights in the units of the points."""
        return np.asarray(self.middle + self.half * z)


def by_cells(uv: Floats, height: Floats, split: int) -> tuple[Floats, Floats]:
    """Return the points of filled micro-cells as rows, those of one cell together: ``uv (k, 2)``, ``height (k,)``."""
    a, b = height.shape
    out_uv, out_z = np.empty((a * b, 2)), np.empty(a * b)
    count = int(_by_cells(uv, height, np.int64(split), out_uv, out_z))
    return out_uv[:count].copy(), out_z[:count].copy()


def least_squares(rows: Rows, z: Floats, weight: Floats | None = None, bending: float = BENDING) -> Floats:
    """Return the unknowns of the smoothing spline through points; z from -1 to 1.

    Minimizes ``sum w (F - z)^2 + bending |D2 b|^2``; the weights are scaled to the sum 1. Where the system is not
    positive definite in double precision the unknowns are zero. They are kept within five.
    """
    weights = np.full(len(z), 1.0 / max(len(z), 1)) if weight is None else weight / weight.sum()
    band = energy(rows.unknowns, bending, STRETCHING)
    rows.add_normal(weights, band)
    x = rows.transposed_times(weights * z)
    if factorize(band):
        solve(band, x)
    else:
        x[:] = 0.0
    inside: NDArray[np.bool_] = np.isfinite(x)
    return np.clip(np.where(inside, x, 0.0), -5.0, 5.0)


@kernel
def _by_cells(uv, height, split, out_uv, out_z):
    n, m = height.shape[0] // split, height.shape[1] // split
    count = 0
    for h in range(n):
        for k in range(m):
            for a in range(h * split, (h + 1) * split):
                for b in range(k * split, (k + 1) * split):
                    if height[a, b] > -np.inf:
                        out_uv[count, 0], out_uv[count, 1] = uv[a, b, 0], uv[a, b, 1]
                        out_z[count] = height[a, b]
                        count += 1
    return count
