"""Outvoted surfels: those whose normals contradict most of the surfels that are next in the order, and near."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.core.cast import Booleans
from surfel.inside.operand import Operand

BESIDE = 4
"""So many surfels before one in the order, and as many behind it, have a vote."""

CLOSE = 4.0
"""If they are no farther than this, in spacings."""


def outvoted(operand: Operand, chosen: NDArray[np.int32]) -> Booleans:
    """Tell which of some surfels of an operand are outvoted: scattered flipped ones, not those of a flipped patch."""
    found = np.empty(len(chosen), bool)
    with threads_for(2 * BESIDE * len(chosen)):
        _ask(len(chosen), chosen, operand.points, operand.normals, operand.spacings, found)
    return found


@rows
def _ask(first, last, chosen, points, normals, spacings, found):
    for n in range(first, last):
        i = chosen[n]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        reach = CLOSE * spacings[i]
        votes = 0
        for j in range(max(i - BESIDE, 0), min(i + BESIDE + 1, len(points))):
            dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
            if j == i or dx * dx + dy * dy + dz * dz > reach * reach:
                continue
            cosine = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
            votes += 1 if cosine > 0.0 else (-1 if cosine < 0.0 else 0)
        found[n] = votes < 0
