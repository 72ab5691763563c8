"""Slabs: two planes round the surfels of a cell, beyond which it is one colour; only where the surface is nearly flat.

Unguarded, as Adams and Dutre describe them, slabs are wrong at edges. Here a cell has one only if it holds surfels and
all normals in the 3 x 3 x 3 cells round it lie in a narrow cone about their mean.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, kernel
from surfel.core.cast import Floats
from surfel.inside.grid import bit_of
from surfel.inside.looks import FIRST, OWNED
from surfel.inside.owners import Owners, owner_of

CONE = 0.85
"""Cosine of the widest angle between the mean normal of a cell and any normal round it."""

SAFE, UNSAFE = np.uint8(1), np.uint8(2)


class Slabs(NamedTuple):
    """What settles places in border cells without a judge.

    Parameters
    ----------
    planes : Floats, shape (cells, 6)
        Normal, lower and upper plane, and cone of each cell that holds surfels; no rows where none is to be trusted.
    safe : NDArray[np.uint8], shape (cells,)
        Whether all normals round the cell lie in a cone: :data:`SAFE`, :data:`UNSAFE`, or 0 where nobody asked yet. It
        is looked at, and written, when a place first needs it.
    """

    planes: Floats
    safe: NDArray[np.uint8]

    @classmethod
    def of(cls, owners: Owners, points: Floats, normals: Floats, radii: Floats, margin: float) -> Slabs:
        """Lay slabs round the disks of the surfels that each cell holds; ``margin`` is added to either side."""
        planes = np.empty((len(owners.normals), 6))
        _span(owners.of_surfel, owners.normals, points, normals, radii, margin, planes)
        return cls(planes, np.zeros(len(planes), np.uint8))

    @classmethod
    def none(cls) -> Slabs:
        """Return that there are none."""
        return cls(np.empty((0, 6)), np.empty(0, np.uint8))

    def without_planes(self) -> Slabs:
        """Return slabs that settle nothing."""
        return self._replace(planes=self.planes[:0])

    def with_cells(
        self, owners: Owners, chosen: NDArray[np.int64], points: Floats, normals: Floats, radii: Floats, margin: float
    ) -> Slabs:
        """Return the slabs with those of new cells added, given the surfels that these hold."""
        known = len(self.planes)
        fresh = np.empty((len(owners.normals) - known, 6))
        held = owners.of_surfel[chosen] - known
        _span(held, owners.normals[known:], points[chosen], normals[chosen], radii[chosen], margin, fresh)
        planes = np.concatenate([self.planes, fresh])
        return Slabs(planes, np.zeros(len(planes), np.uint8))


@kernel
def _span(of_surfel, means, points, normals, radii, margin, slabs):
    """Write the unit mean normals, the reach of the disks along them, and the smallest cosine with a normal."""
    for cell in range(len(slabs)):
        length = math.sqrt(means[cell, 0] ** 2 + means[cell, 1] ** 2 + means[cell, 2] ** 2)
        for axis in range(3):
            slabs[cell, axis] = means[cell, axis] / length if length > 1e-9 else 0.0
        slabs[cell, 3], slabs[cell, 4] = np.inf, -np.inf
        slabs[cell, 5] = 1.0
    for n in range(len(of_surfel)):
        cell = of_surfel[n]
        ax, ay, az = slabs[cell, 0], slabs[cell, 1], slabs[cell, 2]
        cosine = ax * normals[n, 0] + ay * normals[n, 1] + az * normals[n, 2]
        reach = radii[n] * math.sqrt(max(0.0, 1.0 - cosine * cosine)) + margin
        along = ax * points[n, 0] + ay * points[n, 1] + az * points[n, 2]
        slabs[cell, 3] = min(slabs[cell, 3], along - reach)
        slabs[cell, 4] = max(slabs[cell, 4], along + reach)
        slabs[cell, 5] = min(slabs[cell, 5], cosine)


@inner
def guard(i, j, k, cell, table, words, slabs):
    """Return SAFE where all normals in the cells round one lie in its cone, else UNSAFE.

    ``table`` and ``words`` are those of :class:`surfel.inside.looks.Looks`.
    """
    if slabs[cell, 5] < CONE:
        return UNSAFE
    nx, ny, nz = slabs[cell, 0], slabs[cell, 1], slabs[cell, 2]
    for u in range(i - 1, i + 2):
        for v in range(j - 1, j + 2):
            for w in range(k - 1, k + 2):
                brick = table[u >> 3, v >> 3, w >> 3]
                if brick < 0:
                    continue
                row = 8 * brick + (u & 7)
                other = owner_of(words[row, OWNED], np.int64(words[row, FIRST]), bit_of(v & 7, w & 7))
                if other < 0:
                    continue
                cosine = min(nx * slabs[other, 0] + ny * slabs[other, 1] + nz * slabs[other, 2], 1.0)
                spread = min(slabs[other, 5], 1.0)
                if spread <= 0.0 or cosine <= 0.0:
                    return UNSAFE
                # the cosine of the sum of the angle between the means and the angle of the other cell's own cone
                both = cosine * spread - math.sqrt((1.0 - cosine * cosine) * (1.0 - spread * spread))
                if both < CONE:
                    return UNSAFE
    return SAFE
