"""Arguments are validated and cast once, at the door; the error says what came, what was expected and what to do."""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


def as_points(value: ArrayLike, name: str = "points", *, finite: bool = True) -> Floats:
    """Return ``value`` as a C-contiguous float64 array of shape (n, 3); not a copy where it already is one.

    Parameters
    ----------
    value : array_like, shape (n, 3)
        Coordinates in any real type; an empty list gives shape (0, 3).
    name : str
        What the error calls the argument.
    finite : bool
        Refuse NaN and infinities.

    Raises
    ------
    InputError
        If the shape is not (n, 3), the type is not real, or a coordinate is not finite.
    """
    array = _as_float_array(value, name)
    if array.size == 0 and array.ndim <= 2 and (array.ndim < 2 or array.shape[1] in (0, 3)):
        return np.empty((0, 3))
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"{name} must have shape (n, 3), one row for each point; got shape {array.shape}")
    if finite and not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        raise InputError(
            f"{name} has {len(bad)} rows that are not finite (the first is row {bad[0]}); "
            f"drop them with {name}[numpy.isfinite({name}).all(axis=1)]"
        )
    return np.ascontiguousarray(array)


def as_rows(value: ArrayLike, name: str, rows: int, columns: int = 3) -> Floats:
    """Return ``value`` as a float64 array of shape (rows, columns)."""
    array = _as_float_array(value, name)
    if array.shape != (rows, columns):
        raise InputError(f"{name} must have shape ({rows}, {columns}); got shape {array.shape}")
    return np.ascontiguousarray(array)


def as_vector(value: ArrayLike, name: str, size: int = 3) -> Floats:
    """Return ``value`` as a finite float64 vector of ``size`` components."""
    array = _as_float_array(value, name)
    if array.shape != (size,):
        raise InputError(f"{name} must be {size} numbers; got shape {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} must be finite; got {array.tolist()}")
    return np.ascontiguousarray(array)


def as_direction(value: ArrayLike, name: str) -> Floats:
    """Return ``value`` as a unit vector of three components."""
    vector = as_vector(value, name)
    largest = float(np.abs(vector).max())
    if largest == 0.0:
        raise InputError(f"{name} must not be the zero vector")
    vector = vector / largest  # first, so that squares neither overflow nor vanish
    return np.asarray(vector / math.sqrt(float(vector @ vector)))


def as_positive(value: Any, name: str) -> float:
    """Return ``value`` as a positive finite float."""
    number = as_number(value, name)
    if not number > 0.0:
        raise InputError(f"{name} must be positive; got {number:g}")
    return number


def as_number(value: Any, name: str) -> float:
    """Return ``value`` as a finite float."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be a number; got {value!r}") from error
    if not math.isfinite(number):
        raise InputError(f"{name} must be finite; got {number}")
    return number


def as_count(value: Any, name: str, least: int = 1, most: int | None = None) -> int:
    """Return ``value`` as an integer of at least ``least`` (and at most ``most``)."""
    try:
        number = operator.index(value)
    except TypeError as error:
        raise InputError(f"{name} must be a whole number; got {value!r}") from error
    if number < least or (most is not None and number > most):
        span = f"at least {least}" if most is None else f"between {least} and {most}"
        raise InputError(f"{name} must be {span}; got {number}")
    return number


def as_choice(value: Any, name: str, choices: tuple[str, ...]) -> str:
    """Return ``value`` if it is one of ``choices``."""
    if value not in choices:
        raise InputError(f"{name} must be one of {', '.join(choices)}; got {value!r}")
    return str(value)


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return ``array`` with its write flag cleared."""
    array.flags.writeable = False
    return array


def _as_float_array(value: ArrayLike, name: str) -> Floats:
    try:
        array = np.asarray(value)
        if array.dtype.kind in "cSUMm":
            raise TypeError(f"type {array.dtype}")
        array = array.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be an array of real numbers; got {type(value).__name__} ({error})") from error
    if isinstance(value, np.ndarray) and hasattr(value, "filled"):  # what a masked array hides is no number
        return np.where(np.ma.getmaskarray(value), np.nan, array)
    return array
