"""Cleaning: duplicates and stray points, found and counted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats

SAME = 1e-12
"""Points nearer than this share of the extent are one point."""

ISOLATED = 3.0
"""A stray's sixth neighbour is this many times farther than its neighbours' own."""

_LISTED = 2  # a stray is among the nearest 12 of at most so many others


def duplicate_rows(points: Floats, normals: Floats | None, squared: Floats) -> NDArray[np.int64]:
    """Return the rows to drop so that every place is kept once.

    Of several points at one place one with a known normal is kept, if there is any, and of these that with the
    lexicographically largest, whatever the normals' signs and the order of the points.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Scaled so that their extent is about 1.
    normals : Floats, shape (n, 3), optional
        Of the points.
    squared : Floats, shape (n, k)
        Squared distances to the nearest neighbours.
    """
    doubled = np.flatnonzero(squared[:, 0] <= SAME * SAME)
    if not len(doubled):
        return doubled
    place = np.round(points[doubled] / (4.0 * SAME))
    if normals is None:
        key = np.zeros((len(doubled), 3))
    else:
        key = normals[doubled]
        pivot = np.take_along_axis(key, np.abs(key).argmax(axis=1)[:, None], axis=1)
        key = key * np.where(pivot < 0.0, -1.0, 1.0)
    unknown = ~key.any(axis=1)
    order = np.lexsort((-key[:, 2], -key[:, 1], -key[:, 0], unknown, place[:, 2], place[:, 1], place[:, 0]))
    place = place[order]
    repeated = np.concatenate([[False], (place[1:] == place[:-1]).all(axis=1)])
    return np.asarray(doubled[order[repeated]])


def stray_rows(squared: Floats, neighbours: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the rows of points that belong to no surface.

    A stray lies far from its neighbours, they lie close to each other, and hardly any point has it among its nearest
    twelve. The last condition spares the sparse side of a sudden change of density.

    Parameters
    ----------
    squared : Floats, shape (n, k)
        Squared distances to the nearest neighbours, ascending, k of at least 12.
    neighbours : NDArray[np.int32], shape (n, k)
        Their rows.
    """
    n, k = neighbours.shape
    if k < 12:
        return np.empty(0, np.int64)
    far = np.zeros(n, np.uint8)
    with threads_for(n):
        _far_from_all(n, squared, neighbours, ISOLATED * ISOLATED, far)
    candidates = np.flatnonzero(far)
    if not len(candidates):
        return candidates
    listed = np.bincount(neighbours[:, :12].ravel(), minlength=n)
    return np.asarray(candidates[listed[candidates] <= _LISTED])


@rows
def _far_from_all(first, last, squared, neighbours, ratio2, far):
    for i in range(first, last):
        nearer = 0
        for a in range(6):
            if squared[i, 5] > ratio2 * squared[neighbours[i, a], 5]:
                nearer += 1
        far[i] = 1 if nearer >= 4 else 0
