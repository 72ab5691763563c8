"""Two families of shapes for the coverage of intervals of clouds: one to calibrate the interval, one to judge it.

The constants of :mod:`surfel.surface.sampling_error` were fitted to clouds of the CALIBRATING family alone. What the
coverage table says is about the JUDGING family. Meshes stand for themselves: their truth is the sum of their triangles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np

from benchmarks import judging_shapes
from benchmarks.grids import of_grid, on_sphere, tube, waves
from benchmarks.pieces import Floats
from benchmarks.shapes import KnownShape, known

CALIBRATING = (
    "sphere", "cylinder", "cube", "torus", "cube-cylinder difference", "cube-cylinder union", "square", "disk",
    "half-sphere", "crossing squares", "ellipsoid", "bunny", "igea", "lion", "teapot", "88566", "horse", "3holes",
    "armadillo", "fandisk", "fertility", "spot", "rocker-arm", "cow", "torus mesh", "dragon", "112932", "520644",
    "bumps 1", "bumps 2", "bumps 3", "bumps 4", "bumps 5", "bumps 6", "bumps 7", "ripples 1", "ripples 2",
    "ripples 3", "ripples 4", "knot 3", "knot 5", "tree 3", "tree 7", "tree 8", "tree 11", "tree 17", "tree 20",
    "tree 21", "tree 22", "tree 25", "tree 27", "tree 30", "tree 101", "tree 102", "tree 104", "tree 105", "tree 106",
    "tree 107", "superquadric 1", "superquadric 2", "superquadric 3", "supershape 1", "supershape 2", "cyclide 1",
    "cyclide 2", "spring 1", "shell 1", "twisted prism 1", "twisted prism 2", "hull 1", "hull 2", "rock 1", "rock 2",
    "rock 3", "rock 4", "terrain 1", "terrain 2", "moebius 1", "helicoid 1", "blob 1", "blob 2",
)  # fmt: skip
"""Shapes behind the constants of the interval."""

JUDGING = (
    "tree 201", "tree 202", "tree 203", "tree 204", "tree 205", "tree 206", "superquadric 11", "superquadric 12",
    "superquadric 13", "supershape 11", "supershape 12", "cyclide 11", "spring 11", "shell 11", "twisted prism 11",
    "twisted prism 12", "hull 11", "hull 12", "rock 11", "rock 12", "rock 13", "terrain 11", "terrain 12",
    "moebius 11", "helicoid 11", "blob 11", "blob 12", "vase 1", "vase 2", "quartic 1",
)  # fmt: skip
"""Shapes that judge it, and nothing else."""


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
    kind, _, number = name.rpartition(" ") if name[-1].isdigit() else (name, "", "")
    if kind in _FAMILIES:
        return _FAMILIES[kind](int(number or 0))
    return known(name)


def _bumps(number: int) -> KnownShape:
    """Return a sphere with relief: every number has another depth and another least length of wave."""
    random = np.random.default_rng((7, number))
    depth, highest = random.uniform(0.02, 0.06), random.uniform(3.0, 9.0)

    def place(u: Floats, v: Floats) -> Floats:
        sphere = on_sphere(u, v)
        return sphere * (1.0 + depth * waves(sphere, random, 0.8, highest))[..., None]

    return of_grid(f"bumps {number}", place)


def _ripples(number: int) -> KnownShape:
    """Return an open sheet with relief."""
    random = np.random.default_rng((8, number))
    depth, highest = random.uniform(0.02, 0.05), random.uniform(3.0, 12.0)

    def place(u: Floats, v: Floats) -> Floats:
        sheet = np.stack([u, v * random.uniform(0.5, 1.0), np.zeros_like(u)], axis=-1)
        sheet[..., 2] = depth * waves(sheet, random, 1.0, highest)
        return sheet

    return of_grid(f"ripples {number}", place)


def _knot(turns: int) -> KnownShape:
    """Return a tube round a torus knot that goes round twice while it winds ``turns`` times."""

    def line(t: Floats) -> Floats:
        around, angle = 4.0 * math.pi * t, 2.0 * math.pi * turns * t
        out = 2.0 + 0.8 * np.cos(angle)
        return np.stack([out * np.cos(around), out * np.sin(around), 0.8 * np.sin(angle)], axis=-1)

    return tube(f"knot {turns}", line, 0.25)


def _ellipsoid(_: int) -> KnownShape:
    return of_grid("ellipsoid", lambda u, v: on_sphere(u, v) * np.array([1.0, 0.6, 0.3]))


def _tree(number: int) -> KnownShape:
    """Return a Boolean tree of exact solids; area and volume are those of a million elements and lines, to 1e-5."""
    import surfel
    from benchmarks.random_trees import random_tree

    tree = random_tree(number)
    exact = surfel.measure(tree, lines=1 << 20, seed=3)

    def draw(n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        found = surfel.sample(tree, n, seed=int(rng.integers(1 << 31)))
        return found.points, found.normals

    return KnownShape(f"tree {number}", float(exact.area.value), draw, float(exact.volume.value))


_FAMILIES: dict[str, Callable[[int], KnownShape]] = {
    "bumps": _bumps,
    "ripples": _ripples,
    "knot": _knot,
    "ellipsoid": _ellipsoid,
    "tree": _tree,
    **judging_shapes.FAMILIES,
}
