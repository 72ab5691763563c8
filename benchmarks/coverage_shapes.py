"""Two families of shapes for the coverage of intervals of clouds: one to calibrate the interval, one to judge it.

The constants of :mod:`surfel.surface.sampling_error` were fitted to clouds of the CALIBRATING family alone. What the
coverage table says is about the FRESH family. Meshes stand for themselves: their truth is the sum of their triangles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np

from benchmarks.pieces import Floats
from benchmarks.shapes import KnownShape, Triangles, known

CALIBRATING = (
    "sphere", "cylinder", "cube", "torus", "cube-cylinder difference", "cube-cylinder union", "square", "disk",
    "half-sphere", "bunny", "igea", "lion", "teapot", "88566", "horse", "3holes", "bumps 1", "bumps 2", "bumps 3",
    "bumps 4", "ripples 1", "ripples 2", "knot 3", "tree 3", "tree 8", "tree 21", "tree 25",
)  # fmt: skip
"""Shapes behind the constants of the interval."""

FRESH = (
    "armadillo", "fandisk", "fertility", "spot", "rocker-arm", "cow", "torus mesh", "dragon", "112932", "520644",
    "crossing squares", "ellipsoid", "bumps 5", "bumps 6", "bumps 7", "ripples 3", "ripples 4", "knot 5", "tree 7",
    "tree 11", "tree 17", "tree 20", "tree 22", "tree 27", "tree 30",
)  # fmt: skip
"""Shapes that judge it, and nothing else."""

_ACROSS = 700  # quads along each side of a surface that is given by a formula


@cache
def shape(name: str) -> KnownShape:
    """Return a shape of either family.

    Raises
    ------
    NoDataError
        If it is a mesh whose file is absent.
    KeyError
        If there is no such shape.
    """
    kind, _, number = name.partition(" ")
    if kind in _FAMILIES and (number.isdigit() or not number):
        return _FAMILIES[kind](int(number or 0))
    return known(name)


def _of_grid(name: str, place: Callable[[Floats, Floats], Floats]) -> KnownShape:
    """Return the mesh of a surface over the unit square, fine enough to stand for it."""
    side = np.linspace(0.0, 1.0, _ACROSS + 1)
    vertices = place(*np.meshgrid(side, side, indexing="ij")).reshape(-1, 3)
    corner = (np.arange(_ACROSS)[:, None] * (_ACROSS + 1) + np.arange(_ACROSS)).ravel()
    right, up = corner + _ACROSS + 1, corner + 1
    triangles = np.concatenate([np.c_[corner, right, up], np.c_[right, right + 1, up]]).astype(np.int32)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    real = np.linalg.norm(across, axis=1) > 1e-14  # those at a pole have no area
    triangles, across = triangles[real], across[real]
    source = Triangles(vertices, triangles, across / np.linalg.norm(across, axis=1, keepdims=True))
    return KnownShape(name, float(source.areas.sum()), source.draw)


def _on_sphere(u: Floats, v: Floats) -> Floats:
    height, angle = np.cos(math.pi * u), 2.0 * math.pi * v
    across = np.sin(math.pi * u)
    return np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=-1)


def _waves(place: Floats, random: np.random.Generator, lowest: float, highest: float, count: int = 40) -> Floats:
    """Return a random field of about unit size: plane waves of random direction, the shorter the lower."""
    out = np.zeros(place.shape[:-1])
    for _ in range(count):
        frequency = lowest * (highest / lowest) ** random.random()
        along = random.standard_normal(3)
        wave = place @ (along / np.linalg.norm(along) * 2.0 * math.pi * frequency)
        out += lowest / frequency * np.sin(wave + random.uniform(0.0, 2.0 * math.pi))
    return out * math.sqrt(2.0 / count)


def _bumps(number: int) -> KnownShape:
    """Return a sphere with relief: every number has another depth and another least length of wave."""
    random = np.random.default_rng((7, number))
    depth, highest = random.uniform(0.02, 0.06), random.uniform(3.0, 9.0)

    def place(u: Floats, v: Floats) -> Floats:
        sphere = _on_sphere(u, v)
        return sphere * (1.0 + depth * _waves(sphere, random, 0.8, highest))[..., None]

    return _of_grid(f"bumps {number}", place)


def _ripples(number: int) -> KnownShape:
    """Return an open sheet with relief."""
    random = np.random.default_rng((8, number))
    depth, highest = random.uniform(0.02, 0.05), random.uniform(3.0, 12.0)

    def place(u: Floats, v: Floats) -> Floats:
        sheet = np.stack([u, v * random.uniform(0.5, 1.0), np.zeros_like(u)], axis=-1)
        sheet[..., 2] = depth * _waves(sheet, random, 1.0, highest)
        return sheet

    return _of_grid(f"ripples {number}", place)


def _knot(turns: int) -> KnownShape:
    """Return a tube round a torus knot that goes round twice while it winds ``turns`` times."""

    def place(u: Floats, v: Floats) -> Floats:
        t, angle = 2.0 * math.pi * u, 2.0 * math.pi * v

        def line(t: Floats) -> Floats:
            out = 2.0 + 0.8 * np.cos(turns * t)
            return np.stack([out * np.cos(2.0 * t), out * np.sin(2.0 * t), 0.8 * np.sin(turns * t)], axis=-1)

        along = line(t + 1e-5) - line(t - 1e-5)
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        side = np.cross(along, [0.0, 0.0, 1.0])
        side /= np.linalg.norm(side, axis=-1, keepdims=True)
        up = np.cross(side, along)
        return line(t) + 0.25 * (np.cos(angle)[..., None] * side + np.sin(angle)[..., None] * up)

    return _of_grid(f"knot {turns}", place)


def _ellipsoid(_: int) -> KnownShape:
    return _of_grid("ellipsoid", lambda u, v: _on_sphere(u, v) * np.array([1.0, 0.6, 0.3]))


def _tree(number: int) -> KnownShape:
    """Return a Boolean tree of exact solids; its area is that of a million elements, to about 1e-5."""
    import surfel
    from benchmarks.random_trees import random_tree

    tree = random_tree(number)
    area = float(surfel.measure(tree, lines=1 << 20, seed=3).area.value)

    def draw(n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        found = surfel.sample(tree, n, seed=int(rng.integers(1 << 31)))
        return found.points, found.normals

    return KnownShape(f"tree {number}", area, draw)


_FAMILIES: dict[str, Callable[[int], KnownShape]] = {
    "bumps": _bumps,
    "ripples": _ripples,
    "knot": _knot,
    "ellipsoid": _ellipsoid,
    "tree": _tree,
}
