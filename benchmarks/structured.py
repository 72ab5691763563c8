"""Clean analytic sets: points laid out by rule, as CAD programs and papers do, with a given number of them.

Their truth is a formula. Points on an edge belong to one of its faces, and have that one's normal.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np

from benchmarks.clouds import APART, Cloud, darts
from benchmarks.pieces import Floats, Zone
from benchmarks.shapes import known

Part = tuple[Floats, Floats]


def sphere() -> Cloud:
    """Return 30,096 points of a Fibonacci spiral, each in the middle of its turn."""
    n = 30_096
    height = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angle = np.arange(n) * math.pi * (3.0 - math.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    out = np.c_[across * np.cos(angle), across * np.sin(angle), height]
    return Cloud("sphere", out, out, known("sphere"))


def uneven_sphere() -> Cloud:
    """Return about 30,000 blue-noise points, 16 times as dense at one pole as at the other."""
    n, rng = 30_000, np.random.default_rng(11)
    points, normals = Zone(1.0).draw(15 * n, rng)
    density = 16.0 ** (0.5 * (points[:, 2] + 1.0))
    kept = rng.random(len(points)) * 16.0 < density
    points, normals, density = points[kept], normals[kept], density[kept]
    mean = 15.0 / math.log(16.0)  # of the density over the sphere: heights are uniform
    apart = APART * np.sqrt(4.0 * math.pi / n * mean / density)
    rows = darts(points, apart, rng)
    return Cloud("16x uneven sphere", points[rows], normals[rows], known("sphere"))


def cube() -> Cloud:
    """Return a grid of 104 by 104 squares on each face, 64,898 points."""
    return _cloud("cube", _box(1.0, 104))


def cylinder() -> Cloud:
    """Return rings of points, each turned by half a step against the last."""
    step = 0.01
    parts = [_tube(0.2, -0.4, 0.4, step), *(_disk(0.2, sign * 0.4, sign, step) for sign in (-1.0, 1.0))]
    return _cloud("cylinder", _joined(parts))


def union() -> Cloud:
    """Return the cube of edge 0.5 with the cylinder of radius 0.2 and height 1."""
    step = 0.01
    parts = [_drilled(0.5, 0.2, step)]
    for sign in (-1.0, 1.0):
        low, high = sorted((sign * 0.25, sign * 0.5))
        parts += [_tube(0.2, low, high, step), _disk(0.2, sign * 0.5, sign, step)]
    return _cloud("cube-cylinder union", _joined(parts))


def difference() -> Cloud:
    """Return the cube of edge 0.5 with a hole of radius 0.2."""
    points, normals = _tube(0.2, -0.25, 0.25, 0.01)
    return _cloud("cube-cylinder difference", _joined([_drilled(0.5, 0.2, 0.01), (points, -normals)]))


CLEAN: dict[str, Callable[[], Cloud]] = {
    "sphere": sphere,
    "16x uneven sphere": uneven_sphere,
    "cube": cube,
    "cylinder": cylinder,
    "cube-cylinder union": union,
    "cube-cylinder difference": difference,
}


@cache
def clean(name: str) -> Cloud:
    """Return a clean set by its name."""
    return CLEAN[name]()


def _cloud(name: str, part: Part) -> Cloud:
    return Cloud(name, *part, known(name))


def _joined(parts: list[Part]) -> Part:
    points, normals = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return points, normals


def _box(edge: float, cells: int) -> Part:
    """Return the grid points on the faces of a cube, those of edges and corners once."""
    side = np.arange(cells + 1)
    grid = np.stack(np.meshgrid(side, side, side[[0, -1]], indexing="ij"), axis=-1).reshape(-1, 3)
    facing = np.where(grid[:, 2] > 0, 1.0, -1.0)
    places = np.concatenate([np.roll(grid, axis + 1, axis=1) for axis in range(3)])
    normals = np.concatenate([np.outer(facing, np.eye(3)[axis]) for axis in range(3)])
    _, first = np.unique(places, axis=0, return_index=True)
    return edge * (places[first] / cells - 0.5), normals[first]


def _ring(radius: float, z: float, step: float, turned: float) -> Floats:
    count = max(3, round(2.0 * math.pi * radius / step))
    angle = 2.0 * math.pi * (np.arange(count) + turned) / count
    return np.c_[radius * np.cos(angle), radius * np.sin(angle), np.full(count, z)]


def _tube(radius: float, low: float, high: float, step: float) -> Part:
    """Return the side of a cylinder with its two end rings."""
    rings = round((high - low) / step)
    heights = low + (high - low) * np.arange(rings + 1) / rings
    points = np.concatenate([_ring(radius, z, step, 0.5 * (i % 2)) for i, z in enumerate(heights)])
    return points, points * [1.0, 1.0, 0.0] / radius


def _disk(radius: float, z: float, side: float, step: float) -> Part:
    """Return the inside of a disk with its middle and without its rim."""
    rings = round(radius / step)
    inner = [_ring(radius * i / rings, z, step, 0.5 * (i % 2)) for i in range(1, rings)]
    points = np.concatenate([np.array([[0.0, 0.0, z]]), *inner])
    return points, np.tile([0.0, 0.0, side], (len(points), 1))


def _drilled(edge: float, radius: float, step: float) -> Part:
    """Return a cube's grid without what lies within the radius of the z axis; its rim comes with the tube."""
    points, normals = _box(edge, round(edge / step))
    away = np.hypot(points[:, 0], points[:, 1]) > radius + 0.4 * step
    kept = away | (np.abs(points[:, 2]) < 0.5 * edge - 1e-9)
    return points[kept], normals[kept]
