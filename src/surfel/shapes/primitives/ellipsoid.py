"""Sphere and Ellipsoid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from surfel.core.cast import Floats
from surfel.core.patches import Patches
from surfel.shapes.primitives.primitive import Convex, Primitive
from surfel.shapes.primitives.sizes import as_size, as_sizes


@dataclass(frozen=True)
class Sphere(Primitive):
    """A ball, centred at the origin.

    Parameters
    ----------
    radius : float
        Positive.

    Raises
    ------
    InputError
        If the radius is not positive and finite.

    Examples
    --------
    >>> import surfel
    >>> round(surfel.Sphere(20).area, 2)
    5026.55
    """

    radius: float

    sampled = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", as_size(self.radius, "radius"))

    @property
    def area(self) -> float:
        """The exact area."""
        return 4.0 * math.pi * self.radius**2

    @property
    def volume(self) -> float:
        """The exact volume."""
        return 4.0 / 3.0 * math.pi * self.radius**3

    @property
    def bounds(self) -> Floats:
        """The lowest and the highest corner of the box round it, shape (2, 3)."""
        return np.array([[-self.radius] * 3, [self.radius] * 3])

    def _convex(self) -> Convex:
        return ellipsoid_form(np.full(3, self.radius)), np.eye(4)

    def _sample(self, uv: Floats) -> Patches:
        """Map the square to the sphere; the map keeps areas (Archimedes)."""
        normals = unit_sphere(uv)
        return Patches(self.radius * normals, normals, np.full(len(uv), self.area / max(len(uv), 1)))


@dataclass(frozen=True)
class Ellipsoid(Primitive):
    """An ellipsoid, centred at the origin, with its axes along x, y and z.

    Parameters
    ----------
    radii : float or sequence of three floats
        Semi-axes along x, y and z.

    Raises
    ------
    InputError
        If a radius is not positive and finite.

    Examples
    --------
    >>> import surfel
    >>> egg = surfel.Ellipsoid((1, 1, 2))
    >>> round(egg.area, 6), round(egg.volume, 6)
    (21.478435, 8.37758)
    """

    radii: float | Sequence[float]

    sampled = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "radii", as_sizes(self.radii, "radii"))

    @property
    def _semiaxes(self) -> Floats:
        return np.asarray(self.radii, float)

    @cached_property
    def area(self) -> float:
        """The exact area, by an elliptic integral."""
        return ellipsoid_area(self._semiaxes)

    @property
    def volume(self) -> float:
        """The exact volume."""
        x, y, z = (float(radius) for radius in self._semiaxes)
        return 4.0 / 3.0 * math.pi * x * y * z

    @property
    def bounds(self) -> Floats:
        """The lowest and the highest corner of the box round it, shape (2, 3)."""
        return np.stack([-self._semiaxes, self._semiaxes])

    def _convex(self) -> Convex:
        return ellipsoid_form(self._semiaxes), np.eye(4)

    def _sample(self, uv: Floats) -> Patches:
        """Stretch points of the unit sphere; their areas carry what the stretching does to them."""
        sphere = unit_sphere(uv)
        largest = float(self._semiaxes.max())
        slopes = sphere * (largest / self._semiaxes)
        length = np.sqrt(np.einsum("ij,ij->i", slopes, slopes))
        stretch = 4.0 * math.pi * math.prod(self._semiaxes.tolist()) / largest
        return Patches(sphere * self._semiaxes, slopes / length[:, None], stretch / max(len(uv), 1) * length)


def ellipsoid_area(radii: Floats) -> float:
    """Return the area of an ellipsoid, 4 pi R_G(a^2 b^2, a^2 c^2, b^2 c^2) (DLMF 19.33.1, Carlson's R_G)."""
    from scipy.special import elliprg

    largest = float(radii.max())
    a, b, c = radii / largest
    return float(4.0 * math.pi * largest**2 * elliprg((a * b) ** 2, (a * c) ** 2, (b * c) ** 2))


def ellipsoid_form(radii: Floats) -> Floats:
    """Return the form of an ellipsoid, scaled so that equal spheres have equal bits however they are made."""
    largest = float(radii.max())
    slabs = np.concatenate([np.full(3, -np.inf), np.full(3, np.inf)])
    return np.concatenate([slabs, (largest / radii) ** 2, [0.0, -(largest**2)]])


def unit_sphere(uv: Floats) -> Floats:
    """Map points of the unit square evenly to the unit sphere: angle by u, height by v; shape (n, 3)."""
    angle, z = 2.0 * np.pi * uv[:, 0], 2.0 * uv[:, 1] - 1.0
    out = np.sqrt((1.0 - z) * (1.0 + z))
    return np.column_stack([out * np.cos(angle), out * np.sin(angle), z])
