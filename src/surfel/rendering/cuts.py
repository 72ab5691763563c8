"""Cuts: where the surface of another cloud passes a disk, so nearly flat that few pixels have to ask for themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.rendering.splats import Splats

CORNERS = 6
RING = 1.16
"""A polygon of so many corners on a circle of this many radii holds the disk."""

_OFF = 3.0  # times what the ring is off the plane, places of the disk may be
_LEAST = 0.02  # of the radius
_STEEP = 0.2  # sine of the least angle between the surfaces; where they meet at less they may coincide

FAR = 1e30
"""How far the plane may be off where nothing is known."""


def ring(splats: Splats, rows: NDArray[np.int64]) -> list[Floats]:
    """Return places round disks, one of each at every angle, in the world."""
    u, v = frames(splats.upright(rows))
    points, wide = splats.places(rows), RING * splats.radii[rows, None]
    return [points + wide * (np.cos(angle) * u + np.sin(angle) * v) for angle in _ANGLES]


def cut_planes(splats: Splats, rows: NDArray[np.int64], other: Splats, sign: Floats) -> Floats:
    """Return the planes that take the surface's place on some disks, shape (m, 5).

    In the coordinates of the disks, from their centres: ``a x + b y + c z + d`` is about the distance from the other
    surface, positive on the side that is kept. The fifth number is how far that may be off: by as much as the distances
    of a ring of places from the nearest surfels' planes are not those from one plane.

    Parameters
    ----------
    splats : Splats
        The cloud with the disks.
    rows : NDArray[np.int64], shape (m,)
        Which disks.
    other : Splats
        The cloud whose surface passes them.
    sign : Floats, shape (m,)
        1 where what lies inside the other cloud is kept, -1 where what lies outside.
    """
    heights = np.stack([_heights(other, places) for places in [splats.places(rows), *ring(splats, rows)]])
    wide = RING * splats.radii[rows]
    cosines, sines = np.cos(_ANGLES), np.sin(_ANGLES)
    along, across = cosines @ heights[1:] * (2.0 / CORNERS), sines @ heights[1:] * (2.0 / CORNERS)
    middle = heights.mean(axis=0)
    flat = middle + np.concatenate([np.zeros((1, len(rows))), np.outer(cosines, along) + np.outer(sines, across)])
    off = np.abs(heights - flat).max(axis=0)
    u, v = frames(splats.upright(rows))  # as the ring lies, in the world
    slope = ((along / wide)[:, None] * u + (across / wide)[:, None] * v) @ splats.pose[:, :3]
    steep = np.hypot(along, across) > _STEEP * wide
    off = np.where(steep, _OFF * off + _LEAST * splats.radii[rows], FAR)
    return np.column_stack([-sign[:, None] * slope, -sign * middle, off])


def _heights(other: Splats, places: Floats) -> Floats:
    """Return how high over the plane of the nearest surfel places lie; positive outside."""
    near = other.near(places, 1)[1][:, 0]
    return np.asarray(((places - other.places(near)) * other.upright(near)).sum(axis=1))


_ANGLES = 2.0 * np.pi / CORNERS * np.arange(CORNERS)


def frames(normals: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors across each normal (Duff et al., as in :func:`surfel._vec.tangent_frame`)."""
    x, y, z = normals.T
    sign = np.where(z >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.column_stack([1.0 + sign * x * x * a, sign * b, -sign * x])
    return first, np.column_stack([b, sign + y * y * a, -y])
