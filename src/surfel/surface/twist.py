"""Twist: how far a neighbour may lie off the arc of a circle that two given normals describe.

On a smooth surface a neighbour lies off both tangent planes by the same, to opposite sides. On a rough one it does not,
and how much so the nearest neighbours tell. What is off far more lies on another sheet: beyond the edge of a wedge,
where two sheets run together, or across a thin plate.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import inlined, rows
from surfel.core.cast import Floats
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import SAMPLE, sample_rows

LOOSE, TIGHT, STRICT = 2.0, 0.35, 0.25
"""Twists that part nothing; the least one that is taken of a smooth surface; and that which parts two sheets half a
spacing apart, where there are known to be such."""

FAR_OFF = 6.0
"""How many times the twist of nine in ten near neighbours another sheet has."""

_NEAR = 6  # neighbours of each point that tell


def largest_twist(hood: Neighbourhoods, normals: Floats) -> float:
    """Return the twist up to which neighbours belong together, from the normals that were given.

    Parameters
    ----------
    hood : Neighbourhoods
        Of clean points.
    normals : Floats, shape (n, 3)
        In the order of ``hood``, of either sign; zero where unknown.
    """
    chosen = sample_rows(hood.points, SAMPLE)
    off = np.empty((len(chosen), min(_NEAR, hood.near.shape[1])))
    _write_twists(len(chosen), hood.points, normals, chosen, hood.near, off)
    off = off[np.isfinite(off)]
    return float(np.clip(FAR_OFF * np.quantile(off, 0.9), TIGHT, LOOSE)) if len(off) else LOOSE


@rows
def _write_twists(first, last, points, normals, chosen, near, off):
    """Write how far each near neighbour lies off the arc, in its distance; NaN where the normals are not alike."""
    for row in range(first, last):
        i = chosen[row]
        for a in range(off.shape[1]):
            cosine, gap, _, square = off_arc(points, normals, i, near[i, a])
            off[row, a] = abs(gap) / np.sqrt(square) if abs(cosine) >= 0.8 and square > 0.0 else np.nan


@inlined
def off_arc(points, normals, i, j):
    """Return the cosine between two normals, how far j lies off the arc that they describe, how far off both planes
    together, and the square of the step between the points.
    """
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    mx, my, mz = normals[j, 0], normals[j, 1], normals[j, 2]
    dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    cosine = nx * mx + ny * my + nz * mz
    own, other = dx * nx + dy * ny + dz * nz, dx * mx + dy * my + dz * mz
    gap = own + other if cosine > 0.0 else own - other
    return cosine, gap, abs(own) + abs(other), dx * dx + dy * dy + dz * dz
