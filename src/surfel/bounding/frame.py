"""The frame of a safe spline: where a point of space lies over the grid of cells, and how high along the direction."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import inlined, rows, threads_for
from surfel.core.cast import Floats, Integers, as_points, read_only
from surfel.core.errors import InputError


@dataclass(frozen=True, eq=False)
class Frame:
    """A rotation, and a uniform grid of cells in the plane across its third row.

    A point p has the domain coordinates ``u = (rotation[0] . p - low[0]) * scale[0] + origin[0]`` and likewise v, in
    cells, and the height ``rotation[2] . p`` in the units of the points. Along a coordinate axis the height is that
    coordinate itself, unrounded. A grid that grows keeps low and scale and adds whole cells: so coordinates are rounded
    alike before the origin is added, and never over the border of a cell after that.

    Parameters
    ----------
    rotation : Floats, shape (3, 3)
        Orthonormal rows; the third is the direction.
    low : Floats, shape (2,)
        Where the grid of the fit starts, along the first two rows.
    scale : Floats, shape (2,)
        Cells a unit of length.
    cells : Integers, shape (2,)
        Cells along u and v: one less than ``shape``.
    origin : Integers, shape (2,)
        Cells before ``low``: zero until the grid has grown.
    """

    rotation: Floats
    low: Floats
    scale: Floats
    cells: Integers
    origin: Integers = field(default_factory=lambda: np.zeros(2, np.int64))

    def __post_init__(self) -> None:
        for name in ("rotation", "low", "scale", "cells", "origin"):
            kind = np.int64 if name in ("cells", "origin") else np.float64
            object.__setattr__(self, name, read_only(np.array(getattr(self, name), dtype=kind, order="C")))

    @property
    def direction(self) -> Floats:
        """The unit vector along which heights are measured."""
        return np.asarray(self.rotation[2])

    @property
    def shape(self) -> tuple[int, int]:
        """Coefficients a direction of the clamped form: one more than the cells."""
        return int(self.cells[0]) + 1, int(self.cells[1]) + 1

    def to_domain(self, points: ArrayLike) -> tuple[Floats, Floats]:
        """Return the domain coordinates and the heights of points of space.

        Parameters
        ----------
        points : array_like, shape (k, 3)
            World coordinates.

        Returns
        -------
        uv : Floats, shape (k, 2)
            In cells; outside the grid where below 0 or above ``cells``.
        heights : Floats, shape (k,)
            Along the direction, in the units of the points.

        Raises
        ------
        InputError
            If the shape is not (k, 3).
        """
        p = as_points(points, finite=False)
        uv, heights = np.empty((len(p), 2)), np.empty(len(p))
        with threads_for(len(p)):
            _to_domain(len(p), p, self.numbers(), uv, heights)
        return uv, heights

    def to_world(self, uv: ArrayLike, heights: ArrayLike) -> Floats:
        """Return the points of space over domain coordinates, at given heights: shape (k, 3)."""
        place = as_domain(uv)
        z = np.broadcast_to(np.asarray(heights, dtype=np.float64), (len(place),))
        plane = (place - self.origin) / self.scale + self.low
        return np.ascontiguousarray(np.column_stack([plane, z]) @ self.rotation)

    def numbers(self) -> Floats:
        """Return all that :func:`project` needs as one array of 17 numbers: rotation, low, scale, cells, origin."""
        whole = np.concatenate([self.cells, self.origin]).astype(np.float64)
        return np.concatenate([self.rotation.ravel(), self.low, self.scale, whole])

    def signed_numbers(self, sign: float) -> Floats:
        """Return the numbers with heights multiplied by a sign."""
        numbers = self.numbers()
        numbers[6:9] *= sign
        return numbers


def rotation_onto(direction: Floats) -> Floats:
    """Return the rotation whose third row is a unit direction; for (0, 0, 1) it is the identity.

    The first row is the coordinate axis that lies most nearly across the direction, made orthogonal to it.
    """
    x = direction.tolist()
    axis = min(range(3), key=lambda i: abs(x[i]))
    first = [(1.0 if i == axis else 0.0) - x[axis] * x[i] for i in range(3)]
    length = math.hypot(*first)
    a = [number / length for number in first]
    b = [x[1] * a[2] - x[2] * a[1], x[2] * a[0] - x[0] * a[2], x[0] * a[1] - x[1] * a[0]]
    length = math.hypot(*b)
    return np.array([a, [number / length for number in b], x]) + 0.0  # no negative zeros


def frame_over(rotation: Floats, lowest: Floats, highest: Floats, shape: tuple[int, int]) -> Frame:
    """Return the frame whose grid just covers the box ``lowest .. highest`` of rotated coordinates (two or three each).

    A box without width gets one (that of its other side, or a length that the coordinates resolve), with the data
    in the middle. The scale is rounded so that the far end of the box never lies beyond the last cell.
    """
    cells = np.array(shape, dtype=np.int64) - 1
    low, width = lowest[:2].copy(), highest[:2] - lowest[:2]
    for side in range(2):
        least = max(float(np.abs(low[side])) * 1e-9, 1e-290)
        if not width[side] > least * 1e-6:
            wide = max(width[1 - side], least) if width[1 - side] > 0.0 else max(1.0, least)
            low[side] -= 0.5 * wide
            width[side] = wide
            while highest[side] - low[side] > width[side]:
                width[side] *= 2.0
    scale = cells / width
    for side in range(2):
        while (highest[side] - low[side]) * scale[side] > cells[side]:
            scale[side] = np.nextafter(scale[side], 0.0)
    return Frame(rotation, low, scale, cells)


def as_domain(uv: ArrayLike) -> Floats:
    """Return ``uv`` as a contiguous float64 array of shape (k, 2)."""
    try:
        array = np.ascontiguousarray(np.asarray(uv, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise InputError(f"uv must be an array of real numbers; got {type(uv).__name__} ({error})") from error
    if array.size == 0 and array.ndim < 2:
        return np.empty((0, 2))
    if array.ndim != 2 or array.shape[1] != 2:
        raise InputError(f"uv must have shape (k, 2), one row of domain coordinates a place; got {array.shape}")
    return array


@inlined
def project(f, x, y, z):
    """Return u, v in cells and the height of a point, by the numbers of a frame."""
    u = ((f[0] * x + f[1] * y + f[2] * z) - f[9]) * f[11] + f[15]
    v = ((f[3] * x + f[4] * y + f[5] * z) - f[10]) * f[12] + f[16]
    return u, v, f[6] * x + f[7] * y + f[8] * z


@rows
def _to_domain(first, last, p, f, uv, heights):
    for i in range(first, last):
        uv[i, 0], uv[i, 1], heights[i] = project(f, p[i, 0], p[i, 1], p[i, 2])
