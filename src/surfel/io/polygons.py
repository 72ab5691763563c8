"""Polygons and strips as triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Integers


def fans(items: Integers, lengths: Integers) -> Integers:
    """Return the triangles of polygons laid end to end, each cut into a fan at its first corner.

    Parameters
    ----------
    items : ndarray of int64, shape (k,)
        The corners of all polygons.
    lengths : ndarray of int64, shape (m,)
        How many corners each has; fewer than three make no triangle.

    Returns
    -------
    ndarray of int64, shape (sum(max(lengths - 2, 0)), 3)

    Examples
    --------
    >>> import numpy as np
    >>> fans(np.array([0, 1, 2, 3, 4, 5, 6]), np.array([4, 3])).tolist()
    [[0, 1, 2], [0, 2, 3], [4, 5, 6]]
    """
    if len(lengths) and (lengths == 3).all():
        return items.reshape(-1, 3).astype(np.int64, copy=False)
    starts = np.cumsum(lengths) - lengths
    counts = np.maximum(lengths - 2, 0)
    first = np.repeat(starts, counts)
    step = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.stack([items[first], items[first + step + 1], items[first + step + 2]], axis=1)


def strips(items: Integers, lengths: Integers) -> Integers:
    """Return the triangles of strips laid end to end; -1 starts a strip anew, every second triangle is turned.

    Triangles with two equal corners only join parts of a strip and are left out.

    Examples
    --------
    >>> import numpy as np
    >>> strips(np.array([0, 1, 2, 3, -1, 4, 5, 6]), np.array([8])).tolist()
    [[0, 1, 2], [2, 1, 3], [4, 5, 6]]
    """
    k = len(items)
    if k < 3:
        return np.empty((0, 3), np.int64)
    begins: NDArray[np.bool_] = np.zeros(k, bool)
    starts = np.cumsum(lengths) - lengths
    begins[starts[lengths > 0]] = True
    begins[1:] |= items[:-1] < 0
    start = np.maximum.accumulate(np.where(begins, np.arange(k), 0))
    a, b, c = items[:-2], items[1:-1], items[2:]
    inside = (start[2:] == start[:-2]) & (a >= 0) & (b >= 0) & (c >= 0) & (a != b) & (b != c) & (a != c)
    odd = (np.arange(k - 2) - start[:-2]) % 2 == 1
    turned = np.stack([np.where(odd, b, a), np.where(odd, a, b), c], axis=1)
    kept: Integers = turned[inside].astype(np.int64, copy=False)
    return kept
