"""Pieces of surface that are sampled exactly: every shape with a formula for its area is made of them.

A piece knows its area and gives random points, uniform by area, with the normals on its outer side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Piece(Protocol):
    @property
    def area(self) -> float: ...

    def draw(self, n: int, rng: np.random.Generator) -> tuple[Floats, Floats]: ...


@dataclass(frozen=True)
class Parallelogram:
    """``corner + a u + b v`` with a, b in 0..1; the normal is along u x v. Tuples of three."""

    corner: tuple[float, float, float]
    u: tuple[float, float, float]
    v: tuple[float, float, float]

    @property
    def area(self) -> float:
        return float(np.linalg.norm(np.cross(self.u, self.v)))

    def draw(self, n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        a, b = rng.random((2, n, 1))
        points = np.asarray(self.corner) + a * np.asarray(self.u) + b * np.asarray(self.v)
        return points, np.tile(np.cross(self.u, self.v) / self.area, (n, 1))


@dataclass(frozen=True)
class Ring:
    """The flat ring between two radii at height z, facing up or down (``side`` 1 or -1); a disk for ``inner`` 0."""

    inner: float
    outer: float
    z: float
    side: float = 1.0

    @property
    def area(self) -> float:
        return math.pi * (self.outer**2 - self.inner**2)

    def draw(self, n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        radius = np.sqrt(self.inner**2 + rng.random(n) * (self.outer**2 - self.inner**2))
        angle = 2.0 * math.pi * rng.random(n)
        points = np.c_[radius * np.cos(angle), radius * np.sin(angle), np.full(n, self.z)]
        return points, np.tile([0.0, 0.0, self.side], (n, 1))


@dataclass(frozen=True)
class Tube:
    """The side of a cylinder round the z axis, facing out or in."""

    radius: float
    low: float
    high: float
    side: float = 1.0

    @property
    def area(self) -> float:
        return 2.0 * math.pi * self.radius * (self.high - self.low)

    def draw(self, n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        angle = 2.0 * math.pi * rng.random(n)
        out = np.c_[np.cos(angle), np.sin(angle), np.zeros(n)]
        points = self.radius * out
        points[:, 2] = self.low + (self.high - self.low) * rng.random(n)
        return points, self.side * out


@dataclass(frozen=True)
class Zone:
    """The zone of a sphere round the origin between two heights, given in radii (-1 to 1)."""

    radius: float
    low: float = -1.0
    high: float = 1.0

    @property
    def area(self) -> float:
        return 2.0 * math.pi * self.radius**2 * (self.high - self.low)

    def draw(self, n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        height = self.low + (self.high - self.low) * rng.random(n)
        angle = 2.0 * math.pi * rng.random(n)
        across = np.sqrt(1.0 - height * height)
        out = np.c_[across * np.cos(angle), across * np.sin(angle), height]
        return self.radius * out, out


@dataclass(frozen=True)
class Torus:
    """The torus round the z axis."""

    major: float
    minor: float

    @property
    def area(self) -> float:
        return 4.0 * math.pi**2 * self.major * self.minor

    def draw(self, n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        around = 2.0 * math.pi * rng.random(n)
        across = np.empty(0)
        while len(across) < n:  # the outer side has more area: reject by the radius
            angle = 2.0 * math.pi * rng.random(2 * n)
            kept = rng.random(2 * n) * (self.major + self.minor) < self.major + self.minor * np.cos(angle)
            across = np.concatenate([across, angle[kept]])
        across = across[:n]
        out = np.c_[np.cos(around) * np.cos(across), np.sin(around) * np.cos(across), np.sin(across)]
        axis = np.c_[np.cos(around), np.sin(around), np.zeros(n)]
        return self.major * axis + self.minor * out, out


@dataclass(frozen=True)
class PlateWithHole:
    """A square of a given side at height z round the z axis, without the disk of a given radius."""

    edge: float
    hole: float
    z: float
    side: float = 1.0

    @property
    def area(self) -> float:
        return self.edge**2 - math.pi * self.hole**2

    def draw(self, n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        places = np.empty((0, 2))
        while len(places) < n:
            tried = self.edge * (rng.random((2 * n + 8, 2)) - 0.5)
            places = np.concatenate([places, tried[np.hypot(tried[:, 0], tried[:, 1]) >= self.hole]])
        return np.c_[places[:n], np.full(n, self.z)], np.tile([0.0, 0.0, self.side], (n, 1))
