"""Torus and Cyclide: rings with a round tube, of constant or of varying width."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from surfel.core.cast import Floats, read_only
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.core.patches import Patches
from surfel.shapes.primitives.primitive import Primitive
from surfel.shapes.primitives.sizes import as_size


class _Ring(Primitive):
    """What torus and cyclide share: the union of balls round (a cos q, b sin q, 0) with radii d - c cos q."""

    sampled = True

    @property
    def _ring(self) -> tuple[float, float, float]:
        """The numbers a, b and d of the cyclide."""
        raise NotImplementedError

    @cached_property
    def bounds(self) -> Floats:
        """The lowest and the highest corner of the box round it, shape (2, 3)."""
        return read_only(self._bounds_under(np.eye(4)))

    def _bounds_under(self, matrix: Floats) -> Floats:
        """Return the box round it under a map: the farthest ball along a direction n is where q has its maximum of
        a n_x cos q + b n_y sin q + (d - c cos q) |n|.
        """
        a, b, d = self._ring
        c = math.sqrt((a - b) * (a + b))
        sides = []
        for sign in (-1.0, 1.0):
            n = sign * matrix[:3, :3]
            length = np.sqrt((n**2).sum(axis=1))
            reach = np.hypot(a * n[:, 0] - c * length, b * n[:, 1]) + d * length
            sides.append(matrix[:3, 3] + sign * reach)
        return np.stack(sides)

    def _cross_placed(self, lines: Lines, inverse: Floats) -> Crossings:
        from surfel.shapes.primitives.cyclide_cross import cross_cyclide

        return cross_cyclide(lines, inverse, *self._ring)

    def _sample(self, uv: Floats) -> Patches:
        """Map the square to the surface: round the ring by u, round the tube by v."""
        from surfel.shapes.primitives.cyclide_sample import sample_cyclide

        return Patches(*sample_cyclide(uv, *self._ring))


@dataclass(frozen=True)
class Torus(_Ring):
    """A solid ring torus round the z axis.

    Parameters
    ----------
    major : float
        Radius of the circle on which the tube is centred.
    minor : float
        Radius of the tube, smaller than ``major``: a torus that meets itself is refused.

    Raises
    ------
    InputError
        If a radius is not positive and finite, or ``minor`` is not smaller than ``major``.

    Examples
    --------
    >>> import surfel
    >>> ring = surfel.Torus(major=3, minor=1)
    >>> round(ring.area, 6), round(ring.volume, 6)
    (118.435253, 59.217626)
    """

    major: float
    minor: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "major", as_size(self.major, "major"))
        object.__setattr__(self, "minor", as_size(self.minor, "minor"))
        if not self.minor < self.major:
            raise InputError(
                f"minor must be smaller than major, else the torus meets itself; got {self.minor:g} and {self.major:g}"
            )

    @property
    def _ring(self) -> tuple[float, float, float]:
        return self.major, self.major, self.minor

    @property
    def area(self) -> float:
        """The exact area."""
        return 4.0 * math.pi**2 * self.major * self.minor

    @property
    def volume(self) -> float:
        """The exact volume."""
        return 2.0 * math.pi**2 * self.major * self.minor * self.minor


@dataclass(frozen=True)
class Cyclide(_Ring):
    """A solid Dupin ring cyclide: a torus whose tube is thinner on one side than on the other.

    With c^2 = a^2 - b^2, inside is where ::

        (x^2 + y^2 + z^2 + b^2 - d^2)^2 <= 4 (a x - c d)^2 + 4 b^2 y^2.

    It is the union of the balls round (a cos q, b sin q, 0) with radii d - c cos q: thinnest at +x, thickest at -x.

    Parameters
    ----------
    a, b : float
        Half-axes of the ellipse on which the tube is centred, 0 < b <= a; with b = a it is a torus.
    d : float
        Mean radius of the tube, c < d < a: below c the tube has no thickness on one side, above a it fills the hole.

    Raises
    ------
    InputError
        If a number is not positive and finite, or they are not in that range.

    Examples
    --------
    >>> import surfel
    >>> ring = surfel.Cyclide(a=3, b=2.9, d=1)
    >>> round(ring.area, 4), round(ring.volume, 4)
    (120.3844, 77.517)
    """

    a: float
    b: float
    d: float

    def __post_init__(self) -> None:
        for name in ("a", "b", "d"):
            object.__setattr__(self, name, as_size(getattr(self, name), name))
        if self.b > self.a:
            raise InputError(
                f"b must not be larger than a; got a = {self.a:g} and b = {self.b:g}; turn the shape round z"
            )
        if not self.c < self.d < self.a:
            raise InputError(
                f"d must lie between c = sqrt(a^2 - b^2) = {self.c:g} and a = {self.a:g}, "
                f"else the cyclide meets itself; got {self.d:g}"
            )

    @property
    def c(self) -> float:
        """Half the distance of the foci of the ellipse, sqrt(a^2 - b^2)."""
        return math.sqrt((self.a - self.b) * (self.a + self.b))

    @property
    def _ring(self) -> tuple[float, float, float]:
        return self.a, self.b, self.d

    @cached_property
    def area(self) -> float:
        """The exact area, 8 pi a d (2 E - (1 - m) K) with complete elliptic integrals of m = c^2 / a^2.

        The element of area between lines of curvature, integrated round the tube and then along it.
        """
        from scipy.special import ellipe, ellipkm1

        m, rest = self._parameter
        return float(8.0 * math.pi * self.a * self.d * (2.0 * ellipe(m) - rest * ellipkm1(rest)))

    @cached_property
    def volume(self) -> float:
        """The exact volume, a d^2 4 pi (2 E - (1 - m) K) + a^3 4 pi / 3 ((1 + m) E - (1 - m) K), m = c^2 / a^2.

        The second bracket is written as m (E + K - R_D(0, 1 - m, 1) / 3), which does not cancel (DLMF 19.25.1).
        """
        from scipy.special import ellipe, ellipkm1, elliprd

        m, rest = self._parameter
        e, k = ellipe(m), ellipkm1(rest)
        moving = 2.0 * e - rest * k
        staying = m * (e + k - elliprd(0.0, rest, 1.0) / 3.0)
        return float(4.0 * math.pi * self.a * (self.d * self.d * moving + self.a * self.a * staying / 3.0))

    @property
    def _parameter(self) -> tuple[float, float]:
        """The parameter m = c^2 / a^2 of the elliptic integrals, and 1 - m."""
        ratio = self.b / self.a
        return (1.0 - ratio) * (1.0 + ratio), ratio * ratio
