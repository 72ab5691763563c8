"""Triangles are cast at the door like points: rows of three vertex numbers, all of which exist."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.errors import InputError


def as_triangles(value: ArrayLike, vertices: int) -> NDArray[np.int32]:
    """Return ``value`` as a C-contiguous int32 array of shape (f, 3) of rows of ``vertices`` vertices.

    Raises
    ------
    InputError
        If the shape is not (f, 3), the type is not integer, or a number is not that of a vertex.
    """
    array = np.asarray(value)
    if array.size == 0:
        return np.empty((0, 3), np.int32)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
        raise InputError(f"triangles must be integers of shape (f, 3); got {array.dtype} of shape {array.shape}")
    low, high = int(array.min()), int(array.max())
    if low < 0 or high >= vertices:
        raise InputError(f"triangles must name vertices from 0 to {vertices - 1}; got {low} to {high}")
    if max(vertices, len(array)) >= 2**31:
        raise InputError(f"vertices and triangles must be fewer than 2**31; got {vertices} and {len(array)}")
    return np.ascontiguousarray(array, dtype=np.int32)
