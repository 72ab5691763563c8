"""Rigid motions of queries: what is one, and where some rows of a table come to lie."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import kernel
from surfel.core.affine import as_affine
from surfel.core.cast import Floats
from surfel.core.errors import InputError

_RIGID = 1e-6  # how far a rotation may be from orthonormal


def rigid(pose: ArrayLike | None) -> Floats:
    """Return a rigid motion as a 4 x 4 matrix, none as the identity, or say what is wrong with it."""
    if pose is None:
        return np.eye(4)
    given = np.asarray(pose)
    if given.shape == (4, 4) and given.dtype == np.float64 and _is_rigid(np.ascontiguousarray(given)):
        return given
    matrix = as_affine(pose)
    if not _is_rigid(matrix):
        raise InputError(
            "pose must be a rigid motion: its 3 x 3 part a rotation; build a classifier for a scaled cloud"
        )
    return matrix


def moved(points: Floats, chosen: NDArray[np.int64], motion: Floats, shift: float) -> Floats:
    """Return some rows under a motion (3, 4), whose last column counts ``shift`` times: places 1, directions 0."""
    there = np.empty((len(chosen), 3))
    _move(points, chosen, motion, shift, there)
    return there


@kernel
def _move(points, chosen, motion, shift, there):
    for n in range(len(chosen)):
        x, y, z = points[chosen[n], 0], points[chosen[n], 1], points[chosen[n], 2]
        for axis in range(3):
            turned = motion[axis, 0] * x + motion[axis, 1] * y + motion[axis, 2] * z
            there[n, axis] = turned + shift * motion[axis, 3]


@kernel
def _is_rigid(matrix):
    """Tell whether a finite matrix is a rotation, or a reflection, and a shift."""
    off = 0.0
    for i in range(3):
        for j in range(3):
            product = -1.0 if i == j else 0.0
            for axis in range(3):
                product += matrix[i, axis] * matrix[j, axis]
            off = max(off, abs(product))
        if not np.isfinite(matrix[i, 3]) or not np.isfinite(matrix[i, 0] + matrix[i, 1] + matrix[i, 2]):
            return False
    return off <= _RIGID and matrix[3, 0] == matrix[3, 1] == matrix[3, 2] == 0.0 and matrix[3, 3] == 1.0
