"""Gaps that were taken for surface: triangles between points that lie farther apart than chance sets them.

Whether a gap of three spacings is a part that was not scanned, or surface where no point happened to fall, the points
do not tell: a triangle of the surface may be as large as its reach. But it is known how large triangles of random
points are, and what is beyond that is doubtful. Along borders triangles are wide, too, and say nothing.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import rows, threads_for
from surfel.surface.cells import Cells
from surfel.surface.neighbourhoods import Neighbourhoods

WIDE = np.array([1.4, 1.6, 1.8])
"""Circumradii, in spacings, of triangles that are wide where points lie at random."""

CHANCE = np.array([0.1, 0.04, 0.014])
"""Shares of the area that wider triangles have by chance (hardly any calibrating cloud showed more)."""

CHANCE_REGULAR, SMALLER = np.array([0.012, 0.009, 0.007]), 0.84
"""The same for points in good order, and how many times smaller a wide triangle of theirs is."""

_LOW, _STEP = 3, 2  # so many of every second neighbour have a smaller spacing: gaps make that of those nearby larger


def gap_area(hood: Neighbourhoods, cells: Cells) -> float:
    """Return the area of triangles, within the surface, that are wider than chance makes them.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the points.
    cells : Cells
        With stars; without them nothing is known.

    Returns
    -------
    float
        In squares of the unit of the points; 0 where there is nothing to doubt.
    """
    n, columns = cells.star.shape
    if columns == 0 or hood.near.shape[1] <= _STEP * _LOW:
        return 0.0
    regular = float(np.interp(hood.order, [0.6, 0.75], [0.0, 1.0]))
    wide = WIDE * (1.0 + regular * (SMALLER - 1.0))
    chance = CHANCE + regular * (CHANCE_REGULAR - CHANCE)
    usual, found = np.empty(n), np.zeros((n, len(wide)))
    with threads_for(n):
        _write_usual(n, hood.spacing, hood.near, usual)
        _write_wide(n, hood.points, usual, cells.star, cells.joined, cells.closed, wide, found)
    return max(0.0, float((found.sum(axis=0) - chance * cells.area.sum()).max()))


@rows
def _write_usual(first, last, spacing, near, usual):
    """Write a spacing that gaps nearby have not made larger: a low one among those of the neighbours."""
    low = np.empty(_LOW + 1)
    for i in range(first, last):
        low[:] = np.inf
        for a in range(0, near.shape[1], _STEP):
            value = spacing[near[i, a]]
            if value < low[_LOW]:
                place = _LOW
                while place > 0 and low[place - 1] > value:
                    low[place] = low[place - 1]
                    place -= 1
                low[place] = value
        usual[i] = low[_LOW]


@rows
def _write_wide(first, last, points, usual, star, joined, closed, wide, found):
    """Write the point's third of those triangles of its star that are wider than each limit and along no border."""
    for i in range(first, last):
        for c in range(star.shape[1]):
            j = star[i, c]
            if j < 0:
                break
            k = star[i, c + 1] if c + 1 < star.shape[1] and star[i, c + 1] >= 0 else star[i, 0]
            if not (joined[i] >> c) & 1 or closed[i] + closed[j] + closed[k] < 2:
                continue
            ux, uy, uz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            vx, vy, vz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
            wx, wy, wz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            uu, vv, uv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, ux * vx + uy * vy + uz * vz
            double2 = wx * wx + wy * wy + wz * wz
            own = max(usual[i], usual[j], usual[k])
            # R = |u| |v| |u - v| / (2 |u x v|)
            radius2 = uu * vv * (uu + vv - 2.0 * uv) / (4.0 * double2 + 1e-300)
            for a in range(len(wide)):
                if radius2 > (wide[a] * own) ** 2:
                    found[i, a] += np.sqrt(double2) / 6.0
