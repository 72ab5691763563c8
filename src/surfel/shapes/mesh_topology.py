"""What a triangle soup is made of once equal vertices are one: its vertices, and whether its edges close."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel
from surfel.core.cast import Floats


def merge_equal(vertices: Floats) -> NDArray[np.int32]:
    """Return the first row with equal coordinates, for each vertex.

    Parameters
    ----------
    vertices : Floats, shape (v, 3)
        Finite; 0 and -0 are equal.

    Returns
    -------
    NDArray[np.int32], shape (v,)
        ``merged[i] <= i``, with equality for the first of its kind.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.shapes.mesh_topology import merge_equal
    >>> merge_equal(np.array([[1.0, 0, 0], [0, 0, 0], [1, 0, -0.0]])).tolist()
    [0, 1, 0]
    """
    rows = np.ascontiguousarray(vertices + 0.0)  # -0 becomes 0
    first: NDArray[np.int32] = _merge(rows.view(np.int64), max(16, 1 << (2 * len(rows)).bit_length()))
    return first


def is_closed(triangles: NDArray[np.int32]) -> bool:
    """Tell whether every edge is passed as often in one direction as in the other, and there is at least one triangle.

    Edges where more than two triangles meet are closed if these pair off; an edge of a triangle with two equal
    corners closes with itself.

    Parameters
    ----------
    triangles : NDArray[np.int32], shape (f, 3)
        Rows of vertices, equal ones merged.
    """
    if len(triangles) == 0:
        return False
    start = triangles.T.ravel().astype(np.int64)
    stop = np.roll(triangles, -1, axis=1).T.ravel().astype(np.int64)
    forward = np.sort(start << 32 | stop)
    backward = np.sort(stop << 32 | start)
    return bool(np.array_equal(forward, backward))


@kernel
def _merge(rows, size):
    """Find equal rows with a hash table of ``size`` places, a power of two above twice the number of rows."""
    table = np.full(size, np.int32(-1))
    merged = np.empty(len(rows), np.int32)
    for i in range(len(rows)):
        x, y, z = rows[i, 0], rows[i, 1], rows[i, 2]
        mixed = ((x * 0x1E3779B97F4A7C15 ^ y) * 0x3F58476D1CE4E5B9 ^ (x >> 31) ^ z) * 0x14D049BB133111EB
        place = (mixed ^ (mixed >> 29)) & (size - 1)
        while True:
            j = table[place]
            if j < 0:
                table[place] = i
                merged[i] = i
                break
            if rows[j, 0] == x and rows[j, 1] == y and rows[j, 2] == z:
                merged[i] = j
                break
            place = (place + 1) & (size - 1)
    return merged
