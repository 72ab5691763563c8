"""How much volume lies between the flat triangles of a cloud and the curved surface through their corners."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats
from surfel.shapes.sheets import FACING, rise
from surfel.surface.fans import Fans

_EDGE = 0.85  # cosine with a corner's normal below which a triangle lies over an edge


class Bulge(NamedTuple):
    """Volumes, each without regard to side: over smooth parts, where it is well known, and over edges."""

    smooth: float
    edges: float


def bulge_of(fans: Fans, normals: Floats) -> Bulge:
    """Return the volume between triangles and the surface that :func:`surfel.shapes.sheets.crossings_of` bends them to.

    Parameters
    ----------
    fans : Fans
        The triangles.
    normals : Floats, shape (v, 3)
        At their corners, of either sign.
    """
    volumes, sharp = np.empty(len(fans.triangles)), np.empty(len(fans.triangles), bool)
    with threads_for(len(volumes)):
        _rise_all(len(volumes), fans.vertices, fans.triangles, fans.votes, normals, volumes, sharp)
    return Bulge(float(volumes[~sharp].sum()), float(volumes[sharp].sum()))


@rows
def _rise_all(first, last, vertices, triangles, votes, normals, volumes, sharp):
    """Find the area of each triangle times the mean height over it: w_i w_j is a twelfth in the mean."""
    for f in range(first, last):
        a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
        vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        double = np.sqrt(nx * nx + ny * ny + nz * nz)
        side_a = nx * normals[a, 0] + ny * normals[a, 1] + nz * normals[a, 2]
        side_b = nx * normals[b, 0] + ny * normals[b, 1] + nz * normals[b, 2]
        side_c = nx * normals[c, 0] + ny * normals[c, 1] + nz * normals[c, 2]
        least = min(abs(side_a), abs(side_b), abs(side_c))
        volumes[f], sharp[f] = 0.0, least <= _EDGE * double
        if least <= FACING * double:
            continue
        sa, sb, sc = np.sign(side_a), np.sign(side_b), np.sign(side_c)
        ax, ay, az = sa * normals[a, 0], sa * normals[a, 1], sa * normals[a, 2]
        bx, by, bz = sb * normals[b, 0], sb * normals[b, 1], sb * normals[b, 2]
        cx, cy, cz = sc * normals[c, 0], sc * normals[c, 1], sc * normals[c, 2]
        total = rise(ux, uy, uz, ax, ay, az, bx, by, bz) + rise(vx, vy, vz, ax, ay, az, cx, cy, cz)
        total += rise(vx - ux, vy - uy, vz - uz, bx, by, bz, cx, cy, cz)
        volumes[f] = votes[f] / 3.0 * 0.5 * double * abs(total) / 12.0
