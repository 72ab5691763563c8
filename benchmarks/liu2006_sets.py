"""The point sets of Liu et al. (2006), as far as they can be had: lattices on simple objects, vertices of scans.

The paper tells sizes, areas and numbers of points, not how the points were laid. Here they lie in rows: square grids on
flat faces, rings on round ones, with a spacing that gives about as many.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from benchmarks.pieces import Floats
from benchmarks.shapes import NoDataError, read_mesh


@dataclass(frozen=True, eq=False)
class PointSet:
    """A point set with its truth, and what the paper says of it.

    Parameters
    ----------
    name, figure : str
        As in the paper.
    points, normals : Floats, shape (n, 3)
        Unit normals that point outward.
    area : float
        Of the object or of the mesh.
    factor : float
        lambda in the paper.
    theirs : int
        How many points the paper had.
    paper : float
        The paper's relative error at 5,000 lines; positive where it does not tell the sign.
    signed : bool
        Whether it tells the sign.
    """

    name: str
    figure: str
    points: Floats
    normals: Floats
    area: float
    factor: float = 1.5
    theirs: int = 0
    paper: float = float("nan")
    signed: bool = False

    def noisy(self, sigma: float, seed: int = 1) -> PointSet:
        """Return the set with Gaussian noise of one standard deviation on positions and normals."""
        rng = np.random.default_rng(seed)
        normals = self.normals + sigma * rng.standard_normal(self.normals.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return replace(self, points=self.points + sigma * rng.standard_normal(self.points.shape), normals=normals)


def sphere(n: int = 30_096, radius: float = 0.4) -> PointSet:
    """Return a spherical Fibonacci lattice."""
    i = np.arange(n) + 0.5
    z, angle = 1.0 - 2.0 * i / n, np.pi * (1.0 + 5.0**0.5) * i
    ring = np.sqrt(1.0 - z * z)
    normals = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
    return PointSet("sphere", "6(b)", radius * normals, normals, 4.0 * np.pi * radius**2, theirs=30_096, paper=0.0019)


def cylinder(spacing: float = 0.01003, radius: float = 0.2, height: float = 0.8) -> PointSet:
    """Return rings on the side and on both ends."""
    half = 0.5 * height
    parts = [_tube(radius, -half, half, spacing), *(_disk(radius, z, spacing) for z in (half, -half))]
    area = 2.0 * np.pi * radius * (height + radius)
    return PointSet("cylinder", "6(a)", *_joined(parts), area, theirs=12_516, paper=0.0015)


def cube(intervals: int = 104, edge: float = 1.0) -> PointSet:
    """Return grids on the faces; a point of an edge is there once, with the normal of one of its faces."""
    parts = [_face(axis, sign, intervals, edge) for axis in range(3) for sign in (-1.0, 1.0)]
    points, normals = _joined(parts)
    _, first = np.unique(np.round(points / edge * 2 * intervals).astype(int), axis=0, return_index=True)
    first.sort()
    return PointSet("cube", "6(c)", points[first], normals[first], 6.0 * edge**2, theirs=65_000, paper=0.004)


def cube_and_cylinder(spacing: float = 0.00985) -> PointSet:
    """Return the union of a cube of 0.5 and a cylinder of radius 0.2 and height 1: it has the paper's 2.1283."""
    block = cube(round(0.5 / spacing), 0.5)
    under = (np.abs(block.normals[:, 2]) > 0.5) & (np.hypot(*block.points[:, :2].T) < 0.2 + 0.4 * spacing)
    parts = [(block.points[~under], block.normals[~under])]
    parts += [_tube(0.2, 0.25, 0.5, spacing), _tube(0.2, -0.5, -0.25, spacing)]
    parts += [_disk(0.2, 0.5, spacing), _disk(0.2, -0.5, spacing)]
    return PointSet("cube + cylinder", "6(d)", *_joined(parts), 1.5 + 0.2 * np.pi, theirs=21_941, paper=0.0036)


def square(side: int = 100) -> PointSet:
    """Return the open unit square of section 5.3."""
    points, normals = _face(2, 1.0, side - 1, 1.0)
    return PointSet("open square", "5.3", points, normals, 1.0, theirs=10_000, paper=0.0179)


def two_squares(crossing: bool) -> PointSet:
    """Return two unit squares: crossing in their middle lines, or half a side apart (Fig. 12 is lost)."""
    one, up = _face(2, 1.0, 70, 1.0), np.array([0.0, 0.0, 0.5])
    flat = one[0] - up
    if crossing:
        turned = flat[:, [0, 2, 1]] + [0.0, 0.0031, 0.0017]  # so that no points coincide
        parts, name = [(flat, one[1]), (turned, one[1][:, [0, 2, 1]])], "two squares, crossing"
    else:
        parts, name = [(flat, one[1]), (flat + up, one[1])], "two squares, apart"
    return PointSet(name, "12", *_joined(parts), 2.0, paper=0.00128, signed=True)


@cache
def scan(name: str) -> PointSet:
    """Return the used vertices of a scanned mesh with area-weighted normals.

    Raises
    ------
    NoDataError
        If the mesh is absent.
    """
    mesh = read_mesh(name)
    points, normals = mesh.vertex_points()
    corners = mesh.vertices[mesh.triangles]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * float(np.linalg.norm(doubled, axis=1).sum())
    theirs, paper, figure = {"bunny": (35_947, 0.008699, "11(a)"), "dragon": (437_645, 0.018527, "11(b)")}[name]
    return PointSet(name, figure, points, normals, area, 3.0, theirs, paper, signed=True)


SIMPLE: tuple[Callable[[], PointSet], ...] = (cylinder, sphere, cube, cube_and_cylinder)


def available(*names: str) -> list[PointSet]:
    """Return those scans whose meshes are there."""
    found = []
    for name in names:
        try:
            found.append(scan(name))
        except NoDataError as problem:
            print(f"left out: {problem}")
    return found


def _joined(parts: list[tuple[Floats, Floats]]) -> tuple[Floats, Floats]:
    return np.concatenate([p for p, _ in parts]), np.concatenate([n for _, n in parts])


def _face(axis: int, sign: float, intervals: int, edge: float) -> tuple[Floats, Floats]:
    step = np.arange(intervals + 1) / intervals - 0.5
    points, normals = np.empty(((intervals + 1) ** 2, 3)), np.zeros(((intervals + 1) ** 2, 3))
    u, v = np.meshgrid(step, step, indexing="ij")
    points[:, axis], points[:, (axis + 1) % 3], points[:, (axis + 2) % 3] = 0.5 * sign, u.ravel(), v.ravel()
    normals[:, axis] = sign
    return edge * points, normals


def _ring(radius: float, z: float, spacing: float, turned: bool) -> Floats:
    number = max(3, round(2.0 * np.pi * radius / spacing))
    angle = 2.0 * np.pi * (np.arange(number) + 0.5 * turned) / number
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(number, z)])


def _tube(radius: float, low: float, high: float, spacing: float) -> tuple[Floats, Floats]:
    """Return rings from end to end, every other one turned by half a step."""
    number = round((high - low) / spacing)
    rings = [_ring(radius, low + (high - low) * k / number, spacing, k % 2 == 1) for k in range(number + 1)]
    points = np.concatenate(rings)
    return points, points * [1.0 / radius, 1.0 / radius, 0.0]


def _disk(radius: float, z: float, spacing: float) -> tuple[Floats, Floats]:
    """Return a point in the middle and rings round it, without the rim, which belongs to the tube."""
    number = round(radius / spacing)
    rings = [_ring(radius * k / number, z, spacing, k % 2 == 1) for k in range(1, number)]
    points = np.concatenate([np.array([[0.0, 0.0, z]]), *rings])
    return points, np.tile([0.0, 0.0, np.sign(z)], (len(points), 1))
