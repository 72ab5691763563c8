"""Columns of a cloud: what its arrays are checked for, and how they change with it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.cast import Floats, as_choice, as_rows
from surfel.core.errors import InputError

UNIT = 1e-15
"""How far rounding may take the square of a length from 1."""


def unit(normals: Floats) -> Floats:
    """Scale to unit length, not by a bit where it is one already; zero where the length is zero or not finite."""
    x, y, z = (np.ascontiguousarray(column) for column in normals.T)
    with np.errstate(over="ignore", invalid="ignore"):
        square = x * x + y * y + z * z
    if not (np.isfinite(square).all() and square.min(initial=1.0) > 1e-200):
        return _unit_with_care(normals, np.abs(square - 1.0) <= UNIT)
    factor = np.where(np.abs(square - 1.0) <= UNIT, 1.0, 1.0 / np.sqrt(square))
    return np.stack([x * factor, y * factor, z * factor], axis=1)


def _unit_with_care(normals: Floats, done: NDArray[np.bool_]) -> Floats:
    """Do the same where squares overflow or vanish, or normals are missing."""
    largest = np.abs(normals).max(axis=1, keepdims=True, initial=0.0)
    known = np.isfinite(largest) & (largest > 0.0)
    scaled = np.divide(normals, largest, out=np.zeros_like(normals), where=known)
    length = np.sqrt(np.einsum("ij,ij->i", scaled, scaled))[:, None]
    unit = np.divide(scaled, length, out=np.zeros_like(scaled), where=length > 0.0)
    return np.asarray(np.where(done[:, None], normals, unit))


def on_one_scale(a: NDArray[Any] | None, b: NDArray[Any] | None) -> tuple[NDArray[Any] | None, NDArray[Any] | None]:
    """Return colors of one scale as they are, of different scales as floats of 0 to 1."""
    if a is None or b is None or full_brightness(a) == full_brightness(b):
        return a, b
    return a / full_brightness(a), b / full_brightness(b)


def full_brightness(colors: NDArray[Any]) -> float:
    """Return what stands for full brightness."""
    if colors.dtype == np.uint16:
        return 65535.0
    return 255.0 if colors.dtype.kind in "iu" else 1.0


def as_radii(value: ArrayLike, rows: int) -> Floats:
    """Return radii, or say what is wrong with them."""
    radii = as_rows(np.reshape(np.asarray(value), (-1, 1)), "radii", rows, 1)[:, 0]
    if not (np.isfinite(radii).all() and (radii >= 0.0).all()):
        raise InputError("radii must be finite and not negative")
    return radii


def as_axes(value: ArrayLike, rows: int) -> Floats:
    """Return half axes of ellipses, or say what is wrong with them."""
    axes = np.asarray(value, np.float64)
    if axes.shape != (rows, 2, 3) or not np.isfinite(axes).all():
        raise InputError(f"axes must be finite, of shape ({rows}, 2, 3); got shape {axes.shape}")
    return axes


def axes_under(axes: Floats, linear: Floats) -> Floats:
    """Return the half axes of the images of ellipses under a linear map."""
    along, lengths, _ = np.linalg.svd(np.swapaxes(axes @ linear.T, 1, 2), full_matrices=False)
    return np.asarray(np.swapaxes(along * lengths[:, None, :], 1, 2))


def as_judge(name: str) -> str:
    """Return the name of a judge, or say which there are."""
    from surfel.inside.decision import SHEETS
    from surfel.inside.judges import NAMES

    return as_choice(name, "judge", ("auto", SHEETS, *NAMES))


def as_column(value: ArrayLike, name: str, rows: int) -> NDArray[Any]:
    """Return an array of numbers or text with a row for each point, or say what is wrong with it."""
    array = np.asarray(value)
    if array.ndim == 0 or len(array) != rows:
        raise InputError(f"{name} must have one row for each of the {rows} points; got shape {array.shape}")
    if array.dtype.kind == "O":
        raise InputError(f"{name} must be numbers or text of fixed length; got Python objects")
    return array
