"""Slabs: two planes round the surfels of a cell, beyond which it is one colour; only where the surface is nearly flat.

Unguarded, as Adams and Dutre describe them, slabs are wrong at edges. Here a cell has one only if it holds surfels and
all normals in the 3 x 3 x 3 cells round it lie in a narrow cone about their mean.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, kernel, rows, threads_for
from surfel.core.cast import Floats
from surfel.inside.grid import bit_of
from surfel.inside.owners import Owners, owner_of

CONE = 0.85
"""Cosine of the widest angle between the mean normal of a cell and any normal round it."""


def guarded_slabs(
    table: NDArray[np.int32], owners: Owners, points: Floats, normals: Floats, radii: Floats, margin: float
) -> Floats:
    """Return normal, lower and upper plane, and cone of each owning cell, shape (cells, 6).

    The slab is endless where none is safe. ``margin`` is added to either side. ``table`` numbers the bricks as the
    owners' words are.
    """
    slabs = np.empty((len(owners.normals), 6))
    _span(owners.of_surfel, owners.normals, points, normals, radii, margin, slabs)
    place = np.argwhere(table >= 0).astype(np.int32)
    guard(table, place, owners, slabs)
    return slabs


def more_slabs(
    table: NDArray[np.int32], place: NDArray[np.int32], owners: Owners, slabs: Floats, chosen: NDArray[np.int64],
    points: Floats, normals: Floats, radii: Floats, margin: float,
) -> Floats:  # fmt: skip
    """Return the slabs with those of new owning cells added, given the surfels that these hold and their bricks."""
    known = len(slabs)
    fresh = np.empty((len(owners.normals) - known, 6))
    held = owners.of_surfel[chosen] - known
    _span(held, owners.normals[known:], points[chosen], normals[chosen], radii[chosen], margin, fresh)
    together = np.concatenate([slabs, fresh])
    guard(table, place, owners, together)
    return together


def guard(table: NDArray[np.int32], place: NDArray[np.int32], owners: Owners, slabs: Floats) -> None:
    """Make the slabs of unsafe cells of some bricks endless."""
    place = place[table[tuple(place.T)] < len(owners.base)]
    safe = np.ones(len(slabs), np.uint8)
    with threads_for(512 * len(place)):
        _guard(len(place), place, table, owners.base, owners.owned, slabs, safe)
    slabs[safe == 0, 3], slabs[safe == 0, 4] = -np.inf, np.inf


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


@rows
def _guard(first, last, place, table, base, owned, slabs, safe):
    for row in range(first, last):
        p, q, s = place[row, 0], place[row, 1], place[row, 2]
        brick = table[p, q, s]
        for layer in range(8):
            word = owned[brick, layer]
            cell = base[brick, layer]
            for bit in range(64):
                if word >> np.uint64(bit) & np.uint64(1):
                    safe[cell] = _is_safe(
                        8 * p + layer, 8 * q + (bit >> 3), 8 * s + (bit & 7), cell, table, base, owned, slabs
                    )
                    cell += 1


@inner
def _is_safe(i, j, k, cell, table, base, owned, slabs):
    """Tell whether all normals in the cells round one lie in its cone."""
    if slabs[cell, 5] < CONE:
        return 0
    nx, ny, nz = slabs[cell, 0], slabs[cell, 1], slabs[cell, 2]
    for u in range(i - 1, i + 2):
        for v in range(j - 1, j + 2):
            for w in range(k - 1, k + 2):
                brick = table[u >> 3, v >> 3, w >> 3]
                if brick < 0 or brick >= len(base):
                    continue
                other = owner_of(owned[brick, u & 7], base[brick, u & 7], bit_of(v & 7, w & 7))
                if other < 0:
                    continue
                cosine = min(nx * slabs[other, 0] + ny * slabs[other, 1] + nz * slabs[other, 2], 1.0)
                spread = min(slabs[other, 5], 1.0)
                if spread <= 0.0 or cosine <= 0.0:
                    return 0
                # the cosine of the sum of the angle between the means and the angle of the other cell's own cone
                both = cosine * spread - math.sqrt((1.0 - cosine * cosine) * (1.0 - spread * spread))
                if both < CONE:
                    return 0
    return 1
