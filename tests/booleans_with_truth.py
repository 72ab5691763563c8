"""Clouds of solids for Boolean operations, and what is asked of every result."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

import surfel

Floats = NDArray[np.float64]
PI = math.pi


def sampled(shape: surfel.Union, n: int, seed: int = 0, kind: str = "blue", **more: object) -> surfel.Surfels:
    """Return a cloud of n points of a shape, with exact normals."""
    found = surfel.sample(shape, n, kind=kind, seed=seed)
    return surfel.Surfels(found.points, found.normals, **more)


@cache
def ball(n: int = 5000, seed: int = 0, radius: float = 1.0, x: float = 0.0) -> surfel.Surfels:
    return sampled(surfel.Sphere(radius).translated((x, 0.0, 0.0)), n, seed)


@cache
def cube(n: int = 6000, seed: int = 0, size: float = 2.0, x: float = 0.0) -> surfel.Surfels:
    return sampled(surfel.Box(size).translated((x, 0.0, 0.0)), n, seed)


def area(result: surfel.Combination) -> float:
    """Return the sum of what the surfels of a result stand for."""
    clips = result.surfels.clips
    assert clips is not None
    assert clips.areas is not None
    return float(clips.areas.sum())


def rows(cloud: surfel.Surfels) -> Floats:
    """Return the points and normals of a cloud in an order of their own, to compare sets."""
    table = np.concatenate([cloud.points, cloud.normals], axis=1)
    return table[np.lexsort(table.T)]


def within_disks(cloud: surfel.Surfels, chosen: NDArray[np.int64], n: int = 100) -> tuple[Floats, NDArray[np.bool_]]:
    """Return places in the disks of some surfels, shape (m, n, 3), and which of them the clips leave."""
    rng = np.random.default_rng(7)
    normals, radii = cloud.normals[chosen], cloud.radii[chosen]
    across = np.cross(normals, [0.3, 0.5, 0.8])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(normals, across)
    out, turn = np.sqrt(rng.random((len(chosen), n))), rng.random((len(chosen), n)) * 2.0 * PI
    u, v = radii[:, None] * out * np.cos(turn), radii[:, None] * out * np.sin(turn)
    offset = u[..., None] * across[:, None] + v[..., None] * along[:, None]
    which = np.repeat(np.arange(len(chosen)), n)
    left = cloud.clips[chosen].leaves(which, offset.reshape(-1, 3)).reshape(len(chosen), n)
    return cloud.points[chosen][:, None] + offset, left
