"""Cylinder and Cone: round solids between two planes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.core.patches import Patches
from surfel.shapes.primitives.faces import choose_face, disk
from surfel.shapes.primitives.primitive import Convex, Primitive
from surfel.shapes.primitives.sizes import as_size, as_size_or_zero

_POINTED = 0.01
"""A cone whose smaller end is below this share of the larger one is described from its apex."""


@dataclass(frozen=True)
class Cylinder(Primitive):
    """A solid cylinder along z, from -height / 2 to height / 2.

    Parameters
    ----------
    radius, height : float
        Positive.

    Raises
    ------
    InputError
        If one of them is not positive and finite.

    Examples
    --------
    >>> import surfel
    >>> round(surfel.Cylinder(radius=10, height=20).volume, 3)
    6283.185
    """

    radius: float
    height: float

    sampled = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", as_size(self.radius, "radius"))
        object.__setattr__(self, "height", as_size(self.height, "height"))

    @property
    def area(self) -> float:
        """The exact area, with both ends."""
        return 2.0 * math.pi * self.radius * (self.radius + self.height)

    @property
    def volume(self) -> float:
        """The exact volume."""
        return math.pi * self.radius**2 * self.height

    @property
    def bounds(self) -> Floats:
        """The lowest and the highest corner of the box round it, shape (2, 3)."""
        return _bounds(self.radius, self.height)

    def _convex(self) -> Convex:
        half = 0.5 * self.height
        slabs = [-np.inf, -np.inf, -half, np.inf, np.inf, half]
        return np.array([*slabs, 1.0, 1.0, 0.0, 0.0, -(self.radius**2)]), np.eye(4)

    def _sample(self, uv: Floats) -> Patches:
        """Share the square out to the side and the two ends; the map keeps areas."""
        return _sample_frustum(self.radius, self.radius, self.height, uv)


@dataclass(frozen=True)
class Cone(Primitive):
    """A solid cone or frustum along z, from -height / 2 to height / 2.

    Parameters
    ----------
    bottom, top : float
        Radii at the lower and the upper end; one of them may be zero.
    height : float
        Positive.

    Raises
    ------
    InputError
        If a size is negative or not finite, the height is zero, or both radii are.

    Examples
    --------
    >>> import surfel
    >>> cone = surfel.Cone(bottom=3, top=0, height=4)
    >>> round(cone.area / 3.141592653589793, 12), round(cone.volume / 3.141592653589793, 12)
    (24.0, 12.0)
    """

    bottom: float
    top: float
    height: float

    sampled = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "bottom", as_size_or_zero(self.bottom, "bottom"))
        object.__setattr__(self, "top", as_size_or_zero(self.top, "top"))
        object.__setattr__(self, "height", as_size(self.height, "height"))
        if self.bottom == 0.0 and self.top == 0.0:
            raise InputError("bottom and top must not both be zero: a cone has at least one end with a radius")

    @property
    def area(self) -> float:
        """The exact area, with both ends."""
        slant = math.hypot(self.height, self.bottom - self.top)
        return math.pi * (self.bottom**2 + self.top**2 + (self.bottom + self.top) * slant)

    @property
    def volume(self) -> float:
        """The exact volume."""
        return math.pi / 3.0 * self.height * (self.bottom**2 + self.bottom * self.top + self.top**2)

    @property
    def bounds(self) -> Floats:
        """The lowest and the highest corner of the box round it, shape (2, 3)."""
        return _bounds(max(self.bottom, self.top), self.height)

    def _convex(self) -> Convex:
        """Return the form x^2 + y^2 <= (m + s z)^2; of a pointed cone from its apex, where m = 0.

        From elsewhere, hits near the apex would lose digits: there the square is small against its terms.
        """
        half = 0.5 * self.height
        mean, slope = 0.5 * (self.bottom + self.top), (self.top - self.bottom) / self.height
        low, high, placement = -half, half, np.eye(4)
        if min(self.bottom, self.top) < _POINTED * max(self.bottom, self.top):
            overhang = min(self.bottom, self.top) / abs(slope)  # from the smaller end to the apex
            upward = 1.0 if self.top < self.bottom else -1.0
            placement[2, 3] = upward * (half + overhang)
            near, far = -upward * overhang, -upward * (overhang + self.height)
            low, high, mean = min(near, far), max(near, far), 0.0
        slabs = [-np.inf, -np.inf, low, np.inf, np.inf, high]
        return np.array([*slabs, 1.0, 1.0, -(slope**2), -2.0 * mean * slope, -(mean**2)]), placement

    def _sample(self, uv: Floats) -> Patches:
        """Share the square out to the side and the two ends; the map keeps areas."""
        return _sample_frustum(self.bottom, self.top, self.height, uv)


def _bounds(radius: float, height: float) -> Floats:
    corner = np.array([radius, radius, 0.5 * height])
    return np.stack([-corner, corner])


def _sample_frustum(bottom: float, top: float, height: float, uv: Floats) -> Patches:
    slant = math.hypot(height, bottom - top)
    areas = math.pi * np.array([(bottom + top) * slant, bottom**2, top**2])
    face, u = choose_face(uv[:, 0], areas)
    points, normals = np.empty((len(uv), 3)), np.zeros((len(uv), 3))
    side = face == 0
    points[side], normals[side] = _side(bottom, top, height, u[side], uv[side, 1])
    for end, radius, z in ((1, bottom, -0.5 * height), (2, top, 0.5 * height)):
        rows = np.flatnonzero(face == end)
        points[rows, 0], points[rows, 1] = disk(radius, u[rows], uv[rows, 1])
        points[rows, 2] = z
        normals[rows, 2] = math.copysign(1.0, z)
    return Patches(points, normals, np.full(len(uv), areas.sum() / max(len(uv), 1)))


def _side(bottom: float, top: float, height: float, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Map evenly to the side: the square of the radius grows evenly; also where the radii are equal, or nearly."""
    radius = np.sqrt(bottom**2 + v * (top - bottom) * (top + bottom))
    share = np.divide(v * (top + bottom), radius + bottom, out=np.zeros_like(v), where=radius + bottom > 0.0)
    angle = 2.0 * np.pi * u
    slant = math.hypot(height, bottom - top)
    out, up = height / slant, (bottom - top) / slant
    cos, sin = np.cos(angle), np.sin(angle)
    points = np.column_stack([radius * cos, radius * sin, height * (share - 0.5)])
    return points, np.column_stack([out * cos, out * sin, np.full(len(u), up)])
