"""Normals of bare points, unoriented and edge-aware: a sharp edge stays sharp."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats
from surfel.surface.narrow import narrow_rows, on_two_rows
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import SAMPLE, sample_rows
from surfel.surface.planes import plane_of_neighbours
from surfel.surface.projection import project

NEIGHBOURS = 12
"""How many neighbours a plane is fitted to."""

ROUGH = 0.1
"""Residual, in spacings, above which a plane cuts a corner."""

CANDIDATES = 24
"""Among how many neighbours a point near an edge looks for a cleaner plane."""


STEEP = 1.4
"""How far a neighbour may lie off both planes, in its distance: one that lies across them is of another sheet."""

WIDE = 96
"""Among how many neighbours there are three rows, of a grid whose rows lie up to eight steps apart."""


class Planes(NamedTuple):
    """Planes fitted round each point: normal (n, 3) of either sign, residual (n,) in units of length, centre (n, 3)."""

    normal: Floats
    residual: Floats
    centre: Floats

    @classmethod
    def empty(cls, n: int) -> Planes:
        """Return room for n planes."""
        return cls(np.empty((n, 3)), np.empty(n), np.empty((n, 3)))


def fitted_normals(hood: Neighbourhoods) -> Floats:
    """Return edge-aware unit normals of arbitrary sign, shape (n, 3).

    First planes, each point near an edge taking the best of its neighbours' (see :func:`choose_planes`); then the
    slope, at the point, of a quadric over that plane, fitted to those neighbours whose planes are alike. The slope of
    a plane through random neighbours is off by their asymmetry times the curvature; that of a quadric is not. Where
    the nearest lie on two rows, as along the border of a grid whose rows lie apart, more of them are asked.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the points.
    """
    points, near = hood.points, hood.near
    everyone = np.arange(len(points), dtype=np.int32)
    planes = Planes.empty(len(points))
    counts = widths(len(points), NEIGHBOURS, near)
    fit_planes(points, everyone, near, counts, planes)
    narrow = narrow_rows(points, near, NEIGHBOURS, sample_rows(points, SAMPLE))
    wide, enough = _wider(hood, narrow)
    fit_planes(points, narrow, wide, enough, planes)
    chosen = choose_planes(points, near, ROUGH * hood.spacing, planes)
    normals = project(points, chosen, everyone, near, counts, steep=STEEP)[1]
    if len(narrow):
        normals[narrow] = project(points, chosen, narrow, wide, enough, steep=STEEP)[1]
    return normals


def _wider(hood: Neighbourhoods, narrow: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return more neighbours of some points, and how many of them are needed to see more than two rows."""
    if not len(narrow):
        return hood.near[:0], np.empty(0, np.int32)
    wide = hood.index.knn(min(WIDE, len(hood) - 1), narrow)[1]
    enough = widths(len(narrow), CANDIDATES, wide)
    enough[on_two_rows(hood.points, narrow, wide, int(enough[0]))] = wide.shape[1]
    return wide, enough


def widths(rows: int, k: int, neighbours: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the same number of neighbours, k or as many as there are, for every row."""
    return np.full(rows, min(k, neighbours.shape[1]), np.int32)


def fit_planes(
    points: Floats,
    chosen: NDArray[np.int32],
    neighbours: NDArray[np.int32],
    counts: NDArray[np.int32],
    planes: Planes,
) -> None:
    """Fit a plane to each of the chosen points and the first ``counts`` of its neighbours; write it into ``planes``."""
    with threads_for(8 * len(chosen)):
        _fit(len(chosen), points, chosen, neighbours, counts, *planes)


def choose_planes(
    points: Floats,
    neighbours: NDArray[np.int32],
    rough: Floats,
    planes: Planes,
    *,
    better: float = 0.5,
) -> Floats:
    """Give each point near an edge the normal of the neighbour whose plane fits it best.

    Round an edge a least-squares plane cuts the corner. Where the residual exceeds ``rough``, the point takes
    the normal of that neighbour j whose plane has the least ``sqrt(residual_j^2 + distance to plane_j^2)``, if that is
    below ``better`` times its own residual (Kuwahara's filter, on planes).

    Returns
    -------
    Floats, shape (n, 3)
        Unit normals.
    """
    chosen = np.empty((len(points), 3))
    with threads_for(len(points)):
        _choose(
            len(points),
            points,
            neighbours,
            rough,
            min(CANDIDATES, neighbours.shape[1]),
            better,
            *planes,
            chosen,
        )
    return chosen


@rows
def _fit(first, last, points, chosen, neighbours, counts, normal, residual, centre):
    for row in range(first, last):
        i = chosen[row]
        nx, ny, nz, r, cx, cy, cz = plane_of_neighbours(points, i, neighbours, row, np.int64(counts[row]))
        normal[i, 0], normal[i, 1], normal[i, 2] = nx, ny, nz
        centre[i, 0], centre[i, 1], centre[i, 2] = cx, cy, cz
        residual[i] = r


@rows
def _choose(first, last, points, neighbours, rough, candidates, better, normal, residual, centre, chosen):
    for i in range(first, last):
        source = -1
        if residual[i] >= rough[i]:
            best = better * residual[i]
            for a in range(candidates):
                j = neighbours[i, a]
                off = (
                    (points[i, 0] - centre[j, 0]) * normal[j, 0]
                    + (points[i, 1] - centre[j, 1]) * normal[j, 1]
                    + (points[i, 2] - centre[j, 2]) * normal[j, 2]
                )
                r = math.sqrt(residual[j] * residual[j] + off * off)
                if r < best:
                    best = r
                    source = j
        for x in range(3):
            chosen[i, x] = normal[i, x] if source < 0 else normal[source, x]
