"""Sizes of primitives, cast at the door."""

from __future__ import annotations

from typing import Any

import numpy as np

from surfel.core.cast import as_number, as_positive
from surfel.core.errors import InputError

_LARGEST = 1e100
"""Beyond it, and below its inverse, squares and volumes leave the range of floats."""


def as_size(value: Any, name: str) -> float:
    """Return ``value`` as a positive finite float.

    Raises
    ------
    InputError
        If it is not, or so large or small that its powers are not.
    """
    size = as_positive(value, name)
    if not 1.0 / _LARGEST <= size <= _LARGEST:
        raise InputError(
            f"{name} must lie between {1.0 / _LARGEST:g} and {_LARGEST:g}; got {size:g}; take another unit"
        )
    return size


def as_size_or_zero(value: Any, name: str) -> float:
    """Return ``value`` as a size that may be zero."""
    number = as_number(value, name)
    if number < 0.0:
        raise InputError(f"{name} must not be negative; got {number:g}")
    return number if number == 0.0 else as_size(number, name)


def as_sizes(value: Any, name: str) -> tuple[float, float, float]:
    """Return one size, or three, as three floats."""
    if np.ndim(value) == 0:
        one = as_size(value, name)
        return one, one, one
    if np.shape(value) != (3,):
        raise InputError(f"{name} must be one number or three; got shape {np.shape(value)}")
    x, y, z = (as_size(number, name) for number in value)
    return x, y, z
