"""Clouds for pictures."""

from __future__ import annotations

import numpy as np

import surfel


def ball(n: int, radius: float = 1.0, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> surfel.Surfels:
    """Return even points of a sphere with their normals (a spherical Fibonacci set)."""
    i = np.arange(n) + 0.5
    z, angle = 1.0 - 2.0 * i / n, np.pi * (1.0 + np.sqrt(5.0)) * i
    ring = np.sqrt(1.0 - z * z)
    normals = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
    return surfel.Surfels(radius * normals + np.array(centre), normals=normals)


def cube(per_edge: int) -> surfel.Surfels:
    """Return a grid of points on each face of the cube from -1 to 1."""
    u, v = (grid.ravel() for grid in np.meshgrid(*[(np.arange(per_edge) + 0.5) / per_edge * 2.0 - 1.0] * 2))
    points, normals = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            place = np.empty((len(u), 3))
            place[:, axis], place[:, (axis + 1) % 3], place[:, (axis + 2) % 3] = sign, u, v
            points.append(place)
            normals.append(np.tile(sign * np.eye(3)[axis], (len(u), 1)))
    return surfel.Surfels(np.concatenate(points), normals=np.concatenate(normals))
