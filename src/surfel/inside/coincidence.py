"""Coincidence: is a surfel on the surface of another cloud, and does its normal agree?"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, rows, threads_for
from surfel.core.cast import Floats
from surfel.inside.classes import ON_OPPOSED, ON_SAME
from surfel.inside.falloff import falloff
from surfel.inside.operand import Operand

DISTANCE = 0.2
"""A surfel is on the surface if that is nearer than this, in spacings."""

ALIGNED = 0.95
"""And if the cosine of the angle between its normal and the surface's is larger than this."""

NEIGHBOURS = 10

WIDER, LEAST = 6.0, 6e-4
"""Surfaces that lie at a larger angle than that cross, and do not coincide: by 1 - cosine, ``WIDER`` times what the
normals of neighbours differ by, and about 2 degrees. So clean clouds are cut where they cross, however flatly; what
curvature or noise makes of one and the same surface is no crossing."""

_SHEET = 0.8  # neighbours whose normals make at least this cosine belong to the sheet in question
_REACH = 1.5  # the nearest of them is no farther than this, in spacings: beyond it the sheet has ended
_SAME_PLACE = 1e-6  # in spacings


def on_surface(operand: Operand, places: Floats, normals: Floats) -> NDArray[np.int8]:
    """Return ON_SAME or ON_OPPOSED for surfels that lie on the surface of a cloud, else 0.

    ``f`` and its gradient are taken from the sheet that lies as the surfel does: from those of the nearest surfels
    whose normals are nearly parallel to its own. So surfels near edges, and those on thin plates, are found as well.

    Parameters
    ----------
    operand : Operand
        The cloud.
    places, normals : Floats, shape (q, 3)
        Surfels in the coordinates of the cloud.
    """
    k = min(NEIGHBOURS, len(operand))
    if not len(places) or not k:
        return np.zeros(len(places), np.int8)
    near = operand.index.knn_of(places, k)
    return on_sheets(operand, operand.local(places), normals, *near, np.arange(len(places)))


def on_sheets(
    operand: Operand, places: Floats, normals: Floats, squares: Floats, near: NDArray[np.int32],
    chosen: NDArray[np.int64],
) -> NDArray[np.int8]:  # fmt: skip
    """Do the same for some of the local places of which the nearest surfels are known: for the rows ``chosen``."""
    on = np.zeros(len(chosen), np.int8)
    with threads_for(16 * len(chosen)):
        _compare(
            len(chosen), chosen, places, normals, operand.points, operand.normals, operand.spacings, squares, near, on
        )  # fmt: skip
    return on


@rows
def _compare(first, last, chosen, places, upright, points, normals, spacings, squares, near, on):
    k = near.shape[1]
    for item in range(first, last):
        row = chosen[item]
        nx, ny, nz = upright[row, 0], upright[row, 1], upright[row, 2]
        spacing = spacings[near[row, 0]]
        inverse = 1.0 / (0.35 * squares[row, k - 1]) if squares[row, k - 1] > 0.0 else 0.0
        least = DISTANCE * spacing
        for kind in range(ON_SAME, ON_OPPOSED + 1):
            sign = 1.0 if kind == ON_SAME else -1.0
            total = height = gx = gy = gz = 0.0
            closest = np.inf
            for a in range(k):
                j = near[row, a]
                if sign * (nx * normals[j, 0] + ny * normals[j, 1] + nz * normals[j, 2]) < _SHEET:
                    continue
                if math.sqrt(closest) <= _SAME_PLACE * spacing:
                    break  # a surfel at the very place says it all
                closest = min(closest, squares[row, a])
                weight = falloff((squares[row, a] - squares[row, 0]) * inverse)
                dx, dy, dz = places[row, 0] - points[j, 0], places[row, 1] - points[j, 1], places[row, 2] - points[j, 2]
                height += weight * (normals[j, 0] * dx + normals[j, 1] * dy + normals[j, 2] * dz)
                gx, gy, gz = gx + weight * normals[j, 0], gy + weight * normals[j, 1], gz + weight * normals[j, 2]
                total += weight
            if total == 0.0 or math.sqrt(closest) > _REACH * spacing:
                continue
            length = math.sqrt(gx * gx + gy * gy + gz * gz)
            cosine = sign * (nx * gx + ny * gy + nz * gz) / length if length > 0.0 else 0.0
            aligned = cosine > ALIGNED
            if aligned and math.sqrt(closest) > _SAME_PLACE * spacing:
                aligned = lies_along(normals, near[row], gx / length, gy / length, gz / length, cosine)
            if aligned and (abs(height) < least * total or (on[item] == 0 and abs(height) == 0.0)):
                least = abs(height) / total
                on[item] = kind


@inner
def lies_along(normals, near, x, y, z, cosine):
    """Tell whether a plane at this cosine with a sheet may be one with it: neighbours on the sheet differ as much."""
    count, spread = 0, 0.0
    for a in range(len(near)):
        j = near[a]
        c = normals[j, 0] * x + normals[j, 1] * y + normals[j, 2] * z
        if c > _SHEET:
            count += 1
            spread += 1.0 - c
    return count > 0 and 1.0 - cosine <= WIDER * spread / count + LEAST
