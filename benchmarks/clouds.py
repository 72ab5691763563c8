"""Clouds drawn from known shapes: at random, evenly apart, with uneven density, with noise, and a mesh's vertices."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.pieces import Floats
from benchmarks.shapes import KnownShape, known, read_mesh

APART = 0.72  # of sqrt(area / n): dart throwing from five candidates a point then gives about n


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points and normals with the truth that they were drawn from."""

    name: str
    points: Floats
    normals: Floats | None
    shape: KnownShape

    def bare(self) -> Cloud:
        """Return the cloud without its normals."""
        return replace(self, normals=None)


def generator(*key: object) -> np.random.Generator:
    """Return random numbers that depend on the key alone, on every machine."""
    return np.random.default_rng(zlib.crc32("/".join(map(str, key)).encode()))


def random_cloud(name: str, n: int, seed: int = 0) -> Cloud:
    """Return ``n`` independent points, uniform by area."""
    shape = known(name)
    return Cloud(name, *shape.draw(n, generator("random", name, n, seed)), shape)


def blue_cloud(name: str, n: int, seed: int = 0) -> Cloud:
    """Return about ``n`` points, none nearer to another than 0.72 spacings."""
    shape, rng = known(name), generator("blue", name, n, seed)
    points, normals = shape.draw(5 * n, rng)
    rows = darts(points, np.full(len(points), APART * math.sqrt(shape.area / n)), rng)
    return Cloud(name, points[rows], normals[rows], shape)


def uneven_cloud(name: str, n: int, seed: int = 0, ratio: float = 16.0) -> Cloud:
    """Return ``n`` random points whose density grows by ``ratio`` along the longest side of the shape's box."""
    shape, rng = known(name), generator("uneven", name, n, seed)
    points, normals = shape.draw(8 * n, rng)
    axis = int(np.argmax(np.ptp(points, axis=0)))
    height = (points[:, axis] - points[:, axis].min()) / np.ptp(points[:, axis])
    rows = np.flatnonzero(rng.random(len(points)) < ratio ** (height - 1.0))[:n]
    return Cloud(name, points[rows], normals[rows], shape)


def noisy_cloud(name: str, n: int, seed: int = 0, *, spacings: float = 0.0, diagonal: float = 0.0) -> Cloud:
    """Return a random cloud without normals, with Gaussian noise in all directions.

    Its standard deviation is given in spacings ``sqrt(area / n)`` or as a share of the diagonal of the box.
    """
    cloud, rng = random_cloud(name, n, seed), generator("noise", name, n, seed)
    spacing = math.sqrt(cloud.shape.area / n)
    sigma = spacings * spacing + diagonal * float(np.linalg.norm(np.ptp(cloud.points, axis=0)))
    return replace(cloud, points=cloud.points + sigma * rng.standard_normal(cloud.points.shape), normals=None)


def vertex_cloud(name: str) -> Cloud:
    """Return a mesh's used vertices, equal ones once, with the area-weighted normals."""
    return Cloud(name, *read_mesh(name).vertex_points(), known(name))


def darts(points: Floats, apart: Floats, rng: np.random.Generator) -> NDArray[np.int64]:
    """Take points in random order; each keeps away those that come later and lie nearer than its own distance."""
    from scipy.spatial import cKDTree

    order = rng.permutation(len(points))
    place = points[order]
    near = cKDTree(place).query_ball_point(place, apart[order])
    alive = np.ones(len(points), bool)
    for i in range(len(points)):
        if alive[i]:
            alive[[j for j in near[i] if j > i]] = False
    return order[alive]
