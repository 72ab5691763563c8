"""Meshes of surfaces that are given by formulas, fine enough to stand for them; and random relief."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.pieces import Floats
from benchmarks.shapes import KnownShape, Triangles

Place = Callable[[Floats, Floats], Floats]
"""Where the points of the unit square lie in space."""

_ACROSS = 700  # quads along each side of a surface that is given by a formula


def of_triangles(name: str, vertices: Floats, triangles: NDArray[np.int32]) -> KnownShape:
    """Return the shape that is these triangles; those without an area are left out."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    real = np.linalg.norm(across, axis=1) > 1e-14
    triangles, across = triangles[real], across[real]
    source = Triangles(vertices, triangles, across / np.linalg.norm(across, axis=1, keepdims=True))
    return KnownShape(name, float(source.areas.sum()), source.draw, volume_within(vertices, triangles))


def volume_within(vertices: Floats, triangles: NDArray[np.int32]) -> float | None:
    """Return the volume that triangles bound, or None where they have a border or are not turned one way.

    Vertices at one place, as at the seams of a grid, are one vertex.
    """
    size = float(np.ptp(vertices, axis=0).max())
    _, vertex = np.unique(np.round(vertices / (1e-9 * size)), axis=0, return_inverse=True)
    corners = vertex.reshape(-1)[triangles]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]).astype(np.int64)
    edges = edges[edges[:, 0] != edges[:, 1]]
    there, back = (np.sort(edges[:, k] * len(vertices) + edges[:, 1 - k]) for k in (0, 1))
    if not np.array_equal(there, back):
        return None
    a, b, c = (vertices[triangles[:, k]] - vertices[0] for k in range(3))
    return abs(float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum())) / 6.0


def of_grid(name: str, place: Place) -> KnownShape:
    """Return the mesh of a surface over the unit square, fine enough to stand for it."""
    side = np.linspace(0.0, 1.0, _ACROSS + 1)
    vertices = place(*np.meshgrid(side, side, indexing="ij")).reshape(-1, 3)
    corner = (np.arange(_ACROSS)[:, None] * (_ACROSS + 1) + np.arange(_ACROSS)).ravel()
    right, up = corner + _ACROSS + 1, corner + 1
    triangles = np.concatenate([np.c_[corner, right, up], np.c_[right, right + 1, up]]).astype(np.int32)
    return of_triangles(name, vertices, triangles)


def on_sphere(u: Floats, v: Floats) -> Floats:
    """Return the places of latitude u and longitude v, each from 0 to 1."""
    height, angle = np.cos(math.pi * u), 2.0 * math.pi * v
    across = np.sin(math.pi * u)
    return np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=-1)


def waves(
    place: Floats, random: np.random.Generator, lowest: float, highest: float, count: int = 40, fall: float = 1.0
) -> Floats:
    """Return a random field of about unit size: plane waves of random direction, the shorter the lower."""
    out = np.zeros(place.shape[:-1])
    for _ in range(count):
        frequency = lowest * (highest / lowest) ** random.random()
        along = random.standard_normal(3)
        wave = place @ (along / np.linalg.norm(along) * 2.0 * math.pi * frequency)
        out += (lowest / frequency) ** fall * np.sin(wave + random.uniform(0.0, 2.0 * math.pi))
    return out * math.sqrt(2.0 / count)


def tube(name: str, line: Callable[[Floats], Floats], radius: float) -> KnownShape:
    """Return the tube round a line that is given for t from 0 to 1."""

    def place(u: Floats, v: Floats) -> Floats:
        along = line(u + 1e-6) - line(u - 1e-6)
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        side = np.cross(along, [0.0, 0.0, 1.0])
        side /= np.linalg.norm(side, axis=-1, keepdims=True)
        angle = 2.0 * math.pi * v[..., None]
        return line(u) + radius * (np.cos(angle) * side + np.sin(angle) * np.cross(side, along))

    return of_grid(name, place)


def sides(points: Floats, triangles: NDArray[np.int32]) -> tuple[Floats, Floats]:
    """Return the two sides from the first corner of each triangle."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return b - a, c - a
