"""Shapes whose area (and volume and centroid, where closed) is known: from a formula, or as that of a mesh.

TUNING shapes were used to choose the constants of the estimator; JUDGING shapes were not, and the figures of the tables
are about them. HARD ones are sampled too coarsely for their detail at 20k points, and are listed apart.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.pieces import Floats, Parallelogram, Piece, PlateWithHole, Ring, Torus, Tube, Zone

DATA = Path(os.environ.get("SURFEL_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


@dataclass(frozen=True, eq=False)
class KnownShape:
    """A surface to draw points from, with its truth.

    Parameters
    ----------
    name : str
        As in the tables.
    area : float
        Of the surface, each piece once.
    draw : callable
        ``draw(n, rng)`` gives points and unit normals, uniform by area, each (n, 3).
    volume, centroid : float, Floats of shape (3,), optional
        Of the solid, where the surface bounds one.
    """

    name: str
    area: float
    draw: Callable[[int, np.random.Generator], tuple[Floats, Floats]]
    volume: float | None = None
    centroid: Floats | None = None


@dataclass(frozen=True, eq=False)
class Triangles:
    """A mesh to draw points from."""

    vertices: Floats
    triangles: NDArray[np.int32]
    normals: Floats
    areas: Floats = field(init=False)

    def __post_init__(self) -> None:
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        object.__setattr__(self, "areas", 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))

    def draw(self, n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        chosen = rng.choice(len(self.triangles), n, p=self.areas / self.areas.sum())
        corners = self.vertices[self.triangles[chosen]]
        root, share = np.sqrt(rng.random((n, 1))), rng.random((n, 1))
        points = (1.0 - root) * corners[:, 0] + root * (1.0 - share) * corners[:, 1] + root * share * corners[:, 2]
        return points, self.normals[chosen]

    def solid(self) -> tuple[float, Floats]:
        """Return volume and centroid by the divergence theorem, from the middle of the box."""
        middle = 0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0))
        a, b, c = (self.vertices[self.triangles[:, k]] - middle for k in range(3))
        parts = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
        volume = float(parts.sum())
        return abs(volume), (parts[:, None] * (a + b + c)).sum(axis=0) / (4.0 * volume) + middle


def of_pieces(name: str, pieces: list[Piece], volume: float | None = None) -> KnownShape:
    """Return the shape made of pieces; those that bound a solid have their centroid at the origin."""
    areas = np.array([piece.area for piece in pieces])

    def draw(n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        counts = rng.multinomial(n, areas / areas.sum())
        drawn = [piece.draw(int(count), rng) for piece, count in zip(pieces, counts, strict=True)]
        order = rng.permutation(n)
        points, normals = (np.concatenate(arrays)[order] for arrays in zip(*drawn, strict=True))
        return points, normals

    return KnownShape(name, float(areas.sum()), draw, volume, None if volume is None else np.zeros(3))


def box(edge: float, sides: str = "xyz") -> list[Piece]:
    """Return the faces of a cube round the origin, those across the axes in ``sides``."""
    half = 0.5 * edge
    found: list[Piece] = []
    for axis in ("xyz".index(name) for name in sides):
        for sign in (-1.0, 1.0):
            u, v = np.roll([0.0, edge, 0.0], axis), np.roll([0.0, 0.0, sign * edge], axis)
            corner = np.full(3, -half)
            corner[axis] = sign * half
            corner[(axis + 2) % 3] = -sign * half
            found.append(Parallelogram(tuple(corner), tuple(u), tuple(v)))
    return found


def cylinder(radius: float = 0.2, height: float = 0.8) -> list[Piece]:
    half = 0.5 * height
    return [Tube(radius, -half, half), Ring(0.0, radius, half), Ring(0.0, radius, -half, -1.0)]


def cube_and_cylinder() -> list[Piece]:
    """Return the union of a cube of edge 0.5 and a cylinder of radius 0.2 and height 1."""
    plates = [PlateWithHole(0.5, 0.2, 0.25), PlateWithHole(0.5, 0.2, -0.25, -1.0)]
    ends = [Ring(0.0, 0.2, 0.5), Ring(0.0, 0.2, -0.5, -1.0)]
    return [*box(0.5, "xy"), *plates, Tube(0.2, 0.25, 0.5), Tube(0.2, -0.5, -0.25), *ends]


def cube_without_cylinder() -> list[Piece]:
    """Return the cube of edge 0.5 minus the cylinder of radius 0.2."""
    plates = [PlateWithHole(0.5, 0.2, 0.25), PlateWithHole(0.5, 0.2, -0.25, -1.0)]
    return [*box(0.5, "xy"), *plates, Tube(0.2, -0.25, 0.25, -1.0)]


def square(z: float = 0.0) -> Piece:
    return Parallelogram((-0.5, -0.5, z), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


UPRIGHT = Parallelogram((-0.5, 0.0, -0.5), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
SHEETS_APART = 0.01  # 2 spacings of 10,000 points on each of two unit squares: one spacing of 20,000 in all is 0.01

ANALYTIC: dict[str, Callable[[], KnownShape]] = {
    "sphere": lambda: of_pieces("sphere", [Zone(1.0)], 4.0 / 3.0 * math.pi),
    "cube": lambda: of_pieces("cube", box(1.0), 1.0),
    "cylinder": lambda: of_pieces("cylinder", cylinder(), math.pi * 0.2**2 * 0.8),
    "torus": lambda: of_pieces("torus", [Torus(1.0, 0.35)], 2.0 * math.pi**2 * 0.35**2),
    "cube-cylinder union": lambda: of_pieces("cube-cylinder union", cube_and_cylinder(), 0.125 + math.pi * 0.02),
    "cube-cylinder difference": lambda: of_pieces(
        "cube-cylinder difference", cube_without_cylinder(), 0.125 - math.pi * 0.02
    ),
    "square": lambda: of_pieces("square", [square()]),
    "disk": lambda: of_pieces("disk", [Ring(0.0, 1.0, 0.0)]),
    "half-sphere": lambda: of_pieces("half-sphere", [Zone(1.0, 0.0)]),
    "crossing squares": lambda: of_pieces("crossing squares", [square(), UPRIGHT]),
    "two sheets": lambda: of_pieces("two sheets", [square(), square(2.0 * SHEETS_APART)]),
}

MESHES = {
    "bunny": "bun_zipper.ply",
    "armadillo": "armadillo_libigl.obj",
    "fandisk": "fandisk.obj",
    "fertility": "fertility.off",
    "spot": "spot.obj",
    "rocker-arm": "rocker-arm.obj",
    "cow": "cow.obj",
    "horse": "horse.ply",
    "torus mesh": "torus.STL",
    "dragon": "dragon_vrip_res2.ply",
    "112932": "112932.stl",
    "3holes": "3holes.off",
    "igea": "igea.ply",
    "88566": "88566.stl",
    "520644": "520644.stl",
    "lion": "lion.off",
    "teapot": "teapot.obj",
}

TUNING = (
    "sphere", "cylinder", "cube", "torus", "cube-cylinder difference", "square", "disk", "half-sphere", "bunny"
)  # fmt: skip
JUDGING = (
    "armadillo", "fandisk", "fertility", "spot", "rocker-arm", "cow", "horse", "torus mesh", "dragon", "112932"
)  # fmt: skip
HARD = ("3holes", "igea", "88566", "520644")
OPEN = ("square", "half-sphere", "crossing squares")
SHARP = ("fandisk", "112932", "cube", "cylinder", "cube-cylinder union", "cube-cylinder difference", "88566", "520644")
"""Shapes with sharp edges, which noise without normals hides."""

SCANNED = ("armadillo", "horse", "dragon", "igea")
"""Scans whose vertices are what the scanner gave, more or less."""

OVERLAPPING = ("cow",)
"""Meshes that pass through themselves: counted by parity and by winding their volumes differ (the cow's by 0.04 %)."""


class NoDataError(Exception):
    """The file of a mesh is not there."""


@cache
def known(name: str) -> KnownShape:
    """Return a shape by its name.

    Raises
    ------
    NoDataError
        If it is a mesh whose file is absent.
    KeyError
        If there is no such shape.
    """
    if name in ANALYTIC:
        return ANALYTIC[name]()
    mesh = read_mesh(name)
    source = Triangles(mesh.vertices, mesh.triangles, mesh.face_normals)
    volume, centroid = source.solid() if mesh.closed and name not in OVERLAPPING else (None, None)
    return KnownShape(name, float(source.areas.sum()), source.draw, volume, centroid)


@cache
def read_mesh(name: str):
    """Return a mesh of the data folder as a :class:`surfel.Mesh`."""
    import surfel

    path = DATA / "meshes" / MESHES[name]
    if not path.is_file():
        raise NoDataError(f"{name}: {MESHES[name]} is not in the data folder (set SURFEL_DATA)")
    return surfel.read(path, as_="mesh")
