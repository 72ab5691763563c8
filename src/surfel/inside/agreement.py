"""Agreement of normals: which share of the surfels lies near sharp edges, and which share is flipped."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from surfel._numba import rows

if TYPE_CHECKING:
    from surfel.inside.operand import Operand

SAMPLE = 1024
"""How many surfels are looked at."""

NEIGHBOURS = 10

EDGE = 0.7
"""Normals whose lines include a larger cosine than this lie on one smooth sheet; below it there is an edge."""


def agreement(operand: Operand) -> tuple[float, float]:
    """Return the shares of surfels near sharp edges and of surfels that contradict most of their neighbours.

    Both are taken from at most :data:`SAMPLE` surfels, evenly along the curve. Lines of normals (without their sign)
    tell an edge, for flipped normals are no edges. A flipped surfel is outvoted by the neighbours on its own sheet:
    those that lie in its plane and whose normals are nearly parallel to its own, in either sense.
    """
    n = len(operand)
    k = min(NEIGHBOURS, n - 1)
    if k < 3:
        return 0.0, 0.0
    chosen = operand.sample(SAMPLE)
    near = operand.index.knn(k, chosen)[1]
    found = np.zeros((len(chosen), 2))
    _compare(len(chosen), operand.points, operand.normals, chosen, near, found)
    sharp, flipped = found.mean(axis=0)
    return float(sharp), float(flipped)


@rows
def _compare(first, last, points, normals, chosen, near, found):
    for row in range(first, last):
        i = chosen[row]
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        across = 0
        agree = oppose = 0
        for c in range(near.shape[1]):
            j = near[row, c]
            cosine = nx * normals[j, 0] + ny * normals[j, 1] + nz * normals[j, 2]
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            step = math.sqrt(dx * dx + dy * dy + dz * dz)
            across += 1 if abs(cosine) < EDGE else 0
            if abs(cosine) >= EDGE and abs(nx * dx + ny * dy + nz * dz) <= 0.35 * step:
                if cosine > 0.0:
                    agree += 1
                else:
                    oppose += 1
        found[row, 0] = 1.0 if across >= 2 else 0.0
        found[row, 1] = 1.0 if oppose > agree else 0.0
