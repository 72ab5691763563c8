"""Resampling: points inserted where a cloud is sparse, so that one radius suits it everywhere.

Liu et al. (2006, section 5.1) name resampling as the simplest answer to uneven sampling, and its price: more points.
A point is put midway between neighbours that lie too far apart, on the curved surface that their normals describe.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.index.neighbours import PointIndex

ROUNDS = 6
"""Each one halves gaps; six reach a density 4,000 times that of the sparsest part."""

FAR = 1.5
"""Neighbours farther apart than so many mean distances get a point between them."""

APART = 0.7
"""No inserted point is nearer to another than so many mean distances."""

_NEIGHBOURS = 6
_ALIKE = 0.5  # least cosine between the normals of two points of one piece of surface
_MOST = 16  # times as many points as before are the most


def resample(points: Floats, normals: Floats, spacing: float) -> tuple[Floats, Floats]:
    """Insert points until neighbours lie no farther apart than about 1.5 times a spacing.

    Parameters
    ----------
    points, normals : Floats, shape (n, 3)
        At least two points, unit normals.
    spacing : float
        The distance between neighbours that is aimed at, in the units of the points.

    Returns
    -------
    points, normals : Floats, shape (m, 3)
        The given ones first, then the inserted ones.
    """
    most = _MOST * len(points)
    for _ in range(ROUNDS):
        new, sides = _between(points, normals, spacing)
        if not len(new) or len(points) + len(new) > most:
            break
        points, normals = np.concatenate([points, new]), np.concatenate([normals, sides])
    return points, normals


def _between(points: Floats, normals: Floats, spacing: float) -> tuple[Floats, Floats]:
    """Return new points midway between neighbours that lie too far apart."""
    index = PointIndex(points)
    k = min(_NEIGHBOURS, len(points) - 1)
    squared, near = index.knn(k)
    one, column = np.nonzero(squared > (FAR * spacing) ** 2)
    two = near[one, column]
    a, b = index.order[np.minimum(one, two)], index.order[np.maximum(one, two)]
    pairs = np.unique(np.stack([a, b], axis=1), axis=0)
    a, b = pairs[:, 0], pairs[:, 1]
    cosine = np.einsum("ij,ij->i", normals[a], normals[b])
    a, b = a[cosine > _ALIKE], b[cosine > _ALIKE]
    if not len(a):
        return np.empty((0, 3)), np.empty((0, 3))
    side = normals[a] + normals[b]
    side /= np.sqrt(np.square(side).sum(axis=1, keepdims=True))
    step = points[b] - points[a]
    bulge = -0.125 * np.einsum("ij,ij->i", step, normals[b] - normals[a])  # of the arc between two tangents
    new = 0.5 * (points[a] + points[b]) - bulge[:, None] * side
    kept = _apart(index, new, APART * spacing)
    return new[kept], side[kept]


def _apart(index: PointIndex, new: Floats, distance: float) -> NDArray[np.int64]:
    """Return which of the new points keep the distance from the given ones, and from those of them that come first."""
    free = np.flatnonzero(index.knn_of(new, 1)[0][:, 0] >= distance * distance)
    if len(free) < 2:
        return free
    others = PointIndex(new[free])
    offsets, rows = others.radius(distance)
    alive = np.ones(len(free), bool)
    for row in range(len(free)):
        if alive[row]:
            close = rows[offsets[row] : offsets[row + 1]]
            alive[close[close > row]] = False
    return np.asarray(free[others.order[alive]])
