"""Cleaning: points that repeat a place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats

SAME = 1e-12
"""Points nearer than this share of the extent are one point."""


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
