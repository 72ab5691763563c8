"""Affine maps as 4 x 4 matrices: built here, checked here."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from surfel.core.cast import Floats, as_direction, as_number, as_positive, as_rows, as_vector
from surfel.core.errors import InputError

_FLAT = 1e-13
"""A map that squeezes one direction by this share of the most stretched one is called singular."""

_RIGID = 1e-12  # how far the square of a rotation may be off the identity, by rounding


def as_affine(matrix: ArrayLike) -> Floats:
    """Return a 4 x 4 affine matrix, or say what is wrong with it."""
    array = as_rows(matrix, "matrix", 4, 4)
    if not np.isfinite(array).all():
        raise InputError("matrix must be finite")
    if not np.array_equal(array[3], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(f"the last row of matrix must be 0 0 0 1 (an affine map); got {array[3].tolist()}")
    largest = float(np.abs(array[:3, :3]).max())
    stretch = np.linalg.svd(array[:3, :3] / largest, compute_uv=False) if largest else np.zeros(3)
    if stretch[-1] <= _FLAT * stretch[0]:
        raise InputError("matrix must not be singular: it would flatten the shape")
    return array


def translation(vector: ArrayLike) -> Floats:
    """Return the map that moves by ``vector``."""
    matrix = np.eye(4)
    matrix[:3, 3] = as_vector(vector, "vector")
    return matrix


def rotation(axis: ArrayLike, degrees: float) -> Floats:
    """Return the rotation about an axis through the origin, counterclockwise seen from its tip (Rodrigues).

    Multiples of 90 degrees about a coordinate axis are exact.
    """
    along = as_direction(axis, "axis")
    angle = math.fmod(as_number(degrees, "degrees"), 360.0)
    quarters, rest = divmod(angle, 90.0)
    if rest == 0.0:
        cos, sin = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarters) % 4]
    else:
        cos, sin = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    x, y, z = along
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix = np.eye(4)
    matrix[:3, :3] = cos * np.eye(3) + sin * cross + (1.0 - cos) * np.outer(along, along)
    return matrix


def scaling(factors: ArrayLike) -> Floats:
    """Return the map that stretches by one positive factor, or by one along each axis."""
    one = np.ndim(factors) == 0
    each = np.full(3, as_positive(factors, "factor")) if one else as_vector(factors, "factors")
    if not (each > 0.0).all():
        raise InputError(f"factors must be positive; got {each.tolist()}; a reflection is mirrored(normal)")
    return np.diag([*each, 1.0])


def reflection(normal: ArrayLike) -> Floats:
    """Return the reflection in the plane through the origin across ``normal`` (Householder)."""
    across = as_direction(normal, "normal")
    matrix = np.eye(4)
    matrix[:3, :3] -= 2.0 * np.outer(across, across)
    return matrix


def inverse(matrix: Floats) -> Floats:
    """Return the upper three rows of the inverse of an affine matrix, shape (3, 4)."""
    linear = np.linalg.inv(matrix[:3, :3])
    return np.concatenate([linear, -(linear @ matrix[:3, 3])[:, None]], axis=1)


def is_motion(matrix: Floats) -> bool:
    """Tell whether an affine matrix, shape (4, 4), turns and shifts alone, within rounding."""
    linear = matrix[:3, :3]
    return float(np.abs(linear @ linear.T - np.eye(3)).max()) <= _RIGID and float(np.linalg.det(linear)) > 0.0


def box_under(matrix: Floats, box: Floats) -> Floats:
    """Return the axis-aligned box round the image of a box, shape (2, 3); sides of it may be infinite."""
    low, high = np.empty(3), np.empty(3)
    for row in range(3):
        ends = [
            (m * box[0, column], m * box[1, column]) if m > 0.0 else (m * box[1, column], m * box[0, column])
            for column, m in enumerate(matrix[row, :3])
            if m != 0.0
        ]
        low[row] = matrix[row, 3] + sum(end[0] for end in ends)
        high[row] = matrix[row, 3] + sum(end[1] for end in ends)
    return np.stack([low, high])
