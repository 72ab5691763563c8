"""Strays near a surface: single points off a plane that all their neighbours show, and that none of these needs.

A point of a surface lies off the plane of its neighbours by about as much as they do themselves. One that lies many
times farther off, while they lie flat, is a stray, unless it is the first of a sheet of its own: then some of the
points that count it among their nearest lie off that plane as well.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, kernel, rows, threads_for
from surfel.core.cast import Floats
from surfel.surface.planes import smallest_eigenpair

FEW = 12
"""Nearest neighbours that show the plane."""

HEIGHT = 0.45
"""Points nearer to their neighbours' plane, in spacings, are not looked at: they may be detail."""

ABOVE_FEW, ABOVE_MOST = 5.0, 3.0
"""How many times farther off it strays lie than these neighbours do, as a root mean square, and at most."""

ABOVE_THERE = 6.0
"""And how many times farther than, for three of four of these, their own neighbours lie off theirs."""

LONE = 2.0
"""Points whose sixth neighbour is this many times farther than that of most of their neighbours show no plane."""

SHARED, SEVERAL = 0.5, 3
"""So many points with this share of the height above the plane, that have a stray among their nearest, make it none."""

STRAY = 2
"""What marks a stray among points that count for nothing; 1 marks those that may be surface."""

_GLANCE = 8  # neighbours that tell at a glance which points are worth a closer look
_STANDS_OUT = 20.0  # the square of the height, in mean squares of theirs, from which they are
_THREE_OF_FOUR = 3 * FEW // 4


class OffSurface(NamedTuple):
    """Places off the surface that the points round them show.

    ``rows`` (s,) of the places; ``heights`` (s,) above the plane there; ``normals`` (s, 3) of it, towards the place;
    ``spacings`` (s,) of the points that show it.
    """

    rows: NDArray[np.int64]
    heights: Floats
    normals: Floats
    spacings: Floats

    def where(self, chosen: NDArray[np.bool_]) -> OffSurface:
        """Return some of them."""
        return OffSurface(self.rows[chosen], self.heights[chosen], self.normals[chosen], self.spacings[chosen])

    def joined(self, others: OffSurface) -> OffSurface:
        """Return both."""
        rows, heights, normals, spacings = (np.concatenate(pair) for pair in zip(self, others, strict=True))
        return OffSurface(rows, heights, normals, spacings)


NOTHING_OFF = OffSurface(np.empty(0, np.int64), np.empty(0), np.empty((0, 3)), np.empty(0))
"""Where all places lie on the surface."""


def near_strays(
    points: Floats, squared: Floats, neighbours: NDArray[np.int32], strays: NDArray[np.int64]
) -> OffSurface:
    """Return the points that lie singly off a surface which their neighbours show.

    What two strays near each other hide from one another is seen once the first of them is known.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Without duplicates.
    squared : Floats, shape (n, c)
        Squared distances to the nearest neighbours, ascending, at least six of them.
    neighbours : NDArray[np.int32], shape (n, k)
        The rows of the nearest, ascending by distance.
    strays : NDArray[np.int64], shape (s,)
        Rows that are known to be strays; they may be among those returned.
    """
    n = len(points)
    ignored = np.zeros(n, np.uint8)
    if neighbours.shape[1] >= FEW:
        with threads_for(n):
            _lone(n, np.ascontiguousarray(squared[:, 5]), neighbours, ignored)
    ignored[strays] = STRAY
    first = _unneeded(points, neighbours, ignored)
    if not len(strays) + len(first.rows):
        return first
    ignored[first.rows] = STRAY
    then = _unneeded(points, neighbours, ignored)
    return then.joined(first.where(~np.isin(first.rows, then.rows)))


def _unneeded(points: Floats, neighbours: NDArray[np.int32], ignored: NDArray[np.uint8]) -> OffSurface:
    """Return the points off the surface that are no sheet of their own."""
    found = off_surface(points, points, neighbours, neighbours, ignored)
    return found.where(mates(found, points, neighbours, ignored, np.arange(len(points), dtype=np.int32)) < SEVERAL)


def mates(
    found: OffSurface,
    points: Floats,
    neighbours: NDArray[np.int32],
    ignored: NDArray[np.uint8],
    group: NDArray[np.int32],
) -> NDArray[np.int64]:
    """Return for each point off a surface how many that count it among their nearest lie off that surface as well.

    ``group`` (n,) numbers the points; those of one number do not speak for each other.
    """
    count = np.zeros(len(found.rows), np.int64)
    if len(count):
        place = np.full(len(points), -1, np.int32)
        place[found.rows] = np.arange(len(count), dtype=np.int32)
        _count_mates(points, neighbours, ignored, group, place, found.heights, found.normals, count)
    return count


def off_surface(
    places: Floats, points: Floats, neighbours: NDArray[np.int32], near: NDArray[np.int32], ignored: NDArray[np.uint8]
) -> OffSurface:
    """Return which places lie off the surface that the points round them show.

    Parameters
    ----------
    places : Floats, shape (m, 3)
        Points, or others.
    points : Floats, shape (n, 3)
        Of the surface.
    neighbours : NDArray[np.int32], shape (m, k)
        The rows of the points nearest to the places, these excluded; k of at least 12.
    near : NDArray[np.int32], shape (n, k)
        The rows of the points nearest to each point.
    ignored : NDArray[np.uint8], shape (n,)
        Not 0 for points that count for nothing.
    """
    n, k = neighbours.shape
    worth = np.zeros(n, np.uint8)
    if k >= FEW:
        with threads_for(n):
            _glance(n, places, points, neighbours, ignored, worth)
    chosen = np.flatnonzero(worth)
    heights, normals, spacings = np.zeros(len(chosen)), np.zeros((len(chosen), 3)), np.zeros(len(chosen))
    with threads_for(8 * len(chosen)):
        _look(len(chosen), chosen, places, points, neighbours, near, ignored, heights, normals, spacings)
    return OffSurface(chosen, heights, normals, spacings).where(heights > 0.0)


@rows
def _lone(first, last, sixth, neighbours, lone):
    """Mark points that are sparser than most of their neighbours."""
    for i in range(first, last):
        nearer = 0
        for a in range(6):
            nearer += 1 if sixth[i] > LONE * LONE * sixth[neighbours[i, a]] else 0
        lone[i] = 1 if nearer >= 4 else 0


@rows
def _glance(first, last, places, points, neighbours, ignored, worth):
    """Mark the places that lie far from the middle of their neighbours, by the scatter of these in that direction."""
    for i in range(first, last):
        px, py, pz = places[i, 0], places[i, 1], places[i, 2]
        sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
        m = 0
        for a in range(neighbours.shape[1]):
            j = neighbours[i, a]
            if ignored[j]:
                continue
            x, y, z = points[j, 0] - px, points[j, 1] - py, points[j, 2] - pz
            sx += x
            sy += y
            sz += z
            xx += x * x
            xy += x * y
            xz += x * z
            yy += y * y
            yz += y * z
            zz += z * z
            m += 1
            if m == _GLANCE:
                break
        if m < _GLANCE:
            continue
        share = 1.0 / _GLANCE
        sx, sy, sz = sx * share, sy * share, sz * share
        xx, xy, xz = xx * share - sx * sx, xy * share - sx * sy, xz * share - sx * sz
        yy, yz, zz = yy * share - sy * sy, yz * share - sy * sz, zz * share - sz * sz
        cxx, cxy, cxz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        cyy, cyz, czz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
        trace = xx + yy + zz
        det = max(xx * cxx + xy * cxy + xz * cxz, 1e-14 * trace * trace * trace)
        far = sx * sx * cxx + sy * sy * cyy + sz * sz * czz + 2.0 * (sx * sy * cxy + sx * sz * cxz + sy * sz * cyz)
        worth[i] = 1 if far > _STANDS_OUT * det else 0


@rows
def _look(first, last, chosen, places, points, neighbours, near, ignored, heights, normals, spacings):
    """Write the height, the plane and its spacing for those of the chosen places that lie off the surface."""
    there = np.empty(FEW)
    for c in range(first, last):
        i = chosen[c]
        px, py, pz = places[i, 0], places[i, 1], places[i, 2]
        nx, ny, nz, height, rough, count = _plane(
            px, py, pz, points, neighbours, np.int64(i), FEW, ignored, np.int64(-1)
        )
        if count < FEW or height < ABOVE_FEW * rough:
            continue
        most = wide = 0.0
        m = 0
        for a in range(neighbours.shape[1]):
            j = neighbours[i, a]
            if ignored[j]:
                continue
            x, y, z = points[j, 0] - px, points[j, 1] - py, points[j, 2] - pz
            off = nx * x + ny * y + nz * z
            most = max(most, abs(off + height))
            wide = max(wide, x * x + y * y + z * z - off * off)
            m += 1
            if m == FEW:
                break
        spacing = math.sqrt(wide * (math.pi / FEW))
        if height < HEIGHT * spacing or height < ABOVE_MOST * most:
            continue
        m = 0
        for a in range(neighbours.shape[1]):
            j = neighbours[i, a]
            if ignored[j]:
                continue
            x, y, z = points[j, 0], points[j, 1], points[j, 2]
            there[m] = _plane(x, y, z, points, near, np.int64(j), FEW, ignored, np.int64(i))[4]
            m += 1
            if m == FEW:
                break
        if height < ABOVE_THERE * np.sort(there)[_THREE_OF_FOUR]:
            continue
        heights[c], spacings[c] = height, spacing
        normals[c, 0], normals[c, 1], normals[c, 2] = nx, ny, nz


@inner
def _plane(px, py, pz, points, neighbours, row, k, ignored, without):
    """Fit a plane to the first k neighbours of a place that are not ignored, nor the point ``without``.

    Returns the normal towards the place, its height, the root mean square of theirs, and how many there are.
    """
    sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
    m = 0
    for a in range(neighbours.shape[1]):
        j = neighbours[row, a]
        if ignored[j] or j == without:
            continue
        x, y, z = points[j, 0] - px, points[j, 1] - py, points[j, 2] - pz
        sx += x
        sy += y
        sz += z
        xx += x * x
        xy += x * y
        xz += x * z
        yy += y * y
        yz += y * z
        zz += z * z
        m += 1
        if m == k:
            break
    share = 1.0 / max(m, 1)
    low, nx, ny, nz = smallest_eigenpair(
        xx - sx * sx * share, xy - sx * sy * share, xz - sx * sz * share,
        yy - sy * sy * share, yz - sy * sz * share, zz - sz * sz * share,
    )  # fmt: skip
    height = -(nx * sx + ny * sy + nz * sz) * share
    if height < 0.0:
        nx, ny, nz, height = -nx, -ny, -nz, -height
    return nx, ny, nz, height, math.sqrt(max(low, 0.0) / max(m - 3, 1)), m


@kernel
def _count_mates(points, neighbours, ignored, group, place, heights, normals, count):
    """Count for each point off a surface those that have it among their nearest, and lie off that surface as well."""
    for q in range(len(points)):
        if ignored[q] == STRAY:
            continue
        for a in range(neighbours.shape[1]):
            c = place[neighbours[q, a]]
            if c < 0:
                continue
            j = neighbours[q, a]
            if group[j] == group[q]:
                continue
            x, y, z = points[q, 0] - points[j, 0], points[q, 1] - points[j, 1], points[q, 2] - points[j, 2]
            if normals[c, 0] * x + normals[c, 1] * y + normals[c, 2] * z > -(1.0 - SHARED) * heights[c]:
                count[c] += 1
