"""Strays that cannot be told: what they are likely to add to the area, judged from those that were found.

Near a surface strays are found in most places, but not close to it, nor beside edges and detail. How much of the space
about this surface that is, is tried out: places at several heights above some of its points are looked at as if they
were strays. Those found near it tell how many lie in the space where they are found, and so in the rest of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.index.neighbours import PointIndex
from surfel.surface.near_strays import FEW, OffSurface, off_surface
from surfel.surface.noise import sample_rows

ZONE = 4.0
"""How far about the surface, in spacings, a stray that is left costs area; farther away it is found."""

STEEP, MOST = 5.0, 4.0
"""What a stray costs, in cells: so many for each spacing of height, at the most so many."""

SURE = 2.0
"""How many standard deviations of their number count."""

LEAST_SHARE = 0.05
"""The least share of the space in which strays are taken to be found."""

_PLACES = 300  # points above which places are tried
_HEIGHTS = (np.arange(8) + 0.5) * (ZONE / 8)


class LeftStrays(NamedTuple):
    """By how much the area is likely to be too large, and at the most, in squared units of the points."""

    expected: float
    half_width: float


NONE_LEFT = LeftStrays(0.0, 0.0)
"""Where no strays were found."""


def left_strays(
    index: PointIndex, near: NDArray[np.int32], spacing: Floats, dropped: NDArray[np.uint8], found: OffSurface
) -> LeftStrays:
    """Return what strays that were not found are likely to add to the area.

    Parameters
    ----------
    index : PointIndex
        Of all points.
    near : NDArray[np.int32], shape (n, k)
        The nearest neighbours of each.
    spacing : Floats, shape (n,)
        Local spacing.
    dropped : NDArray[np.uint8], shape (n,)
        1 for the strays that were found.
    found : OffSurface
        Those of them that lie off a surface near them.
    """
    kept = np.flatnonzero(dropped == 0)
    if near.shape[1] < FEW or len(kept) <= near.shape[1]:
        return NONE_LEFT
    chosen = kept[sample_rows(index.points[kept], _PLACES)]
    h = spacing[chosen]
    height = np.tile(np.concatenate([-_HEIGHTS, _HEIGHTS]), (len(chosen), 1))
    normals = _normals(index.points, near, chosen)
    places = (index.points[chosen, None] + (height * h[:, None])[:, :, None] * normals[:, None]).reshape(-1, 3)
    neighbours = index.knn_of(places + index.origin, near.shape[1])[1]
    told = np.zeros(height.size, np.bool_)
    told[off_surface(places, index.points, neighbours, near, dropped).rows] = True
    # each of them stands for a part of the space about so many points
    space = np.repeat(h**3, height.shape[1]) * (2.0 * ZONE / height.shape[1]) * (len(kept) / len(chosen))
    cost = (np.minimum(STEEP * np.abs(height), MOST) * h[:, None] ** 2).ravel()
    count, density = _crowd(np.abs(height).ravel(), space, told, found)
    expected = density * float((space * cost)[~told].sum())
    square = density * float((space * cost * cost)[~told].sum())
    return LeftStrays(expected, expected + SURE * float(np.sqrt(square + expected**2 / count)))


def _crowd(height: Floats, space: Floats, told: NDArray[np.bool_], found: OffSurface) -> tuple[float, float]:
    """Return how many strays were found near the surface, and how many there are in a unit of space.

    Where they crowd at the surface, those in the lower half of the zone say so.
    """
    crowds = []
    for zone in (0.5 * ZONE, ZONE):
        inside = height < zone
        room = max(float(space[told & inside].sum()), LEAST_SHARE * float(space[inside].sum()))
        count = 0.5 + float((found.heights < zone * found.spacings).sum())
        crowds.append((count / room, count))
    density, count = max(crowds)
    return count, density


def _normals(points: Floats, near: NDArray[np.int32], chosen: NDArray[np.int64]) -> Floats:
    """Return the normals of the planes of each chosen point's neighbours."""
    offset = points[near[chosen, :FEW]] - points[chosen, None]
    offset -= offset.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.einsum("iax,iay->ixy", offset, offset))[1][:, :, 0])
