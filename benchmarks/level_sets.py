"""Closed meshes of level sets: cubes of a grid, each cut in six tetrahedra."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.grids import of_triangles, sides
from benchmarks.pieces import Floats
from benchmarks.shapes import KnownShape

Field = Callable[[Floats], Floats]

_CELLS = 100  # of the grid, along each side


def blob(number: int) -> KnownShape:
    """Return a level set of a sum of bells: smooth, with necks and handles."""
    random = np.random.default_rng((32, number))
    middles, widths = random.uniform(-0.55, 0.55, (9, 3)), random.uniform(0.18, 0.32, 9)

    def field(place: Floats) -> Floats:
        out: Floats = np.full(place.shape[:-1], -0.6)
        for middle, width in zip(middles, widths, strict=True):
            out += np.exp(-0.5 * np.square(place - middle).sum(axis=-1) / width**2)
        return out

    vertices, triangles = _level_set(field, 1.7)
    return of_triangles(f"blob {number}", vertices, triangles)


def quartic(number: int) -> KnownShape:
    """Return a tangle: a smooth quartic that is a ball with many holes, with random coefficients."""
    random = np.random.default_rng((34, number))
    pull, level = random.uniform(4.2, 5.2, 3), random.uniform(10.5, 11.8)

    def field(place: Floats) -> Floats:
        squares = np.square(place)
        return np.asarray((pull * squares - np.square(squares)).sum(axis=-1) - level)

    return of_triangles(f"quartic {number}", *_level_set(field, 2.7))


def _level_set(field: Field, reach: float) -> tuple[Floats, NDArray[np.int32]]:
    """Return the triangles where a field is zero: cubes cut in six tetrahedra, corners then moved onto the zero."""
    side = np.linspace(-reach, reach, _CELLS + 1)
    grid = np.stack(np.meshgrid(side, side, side, indexing="ij"), axis=-1)
    value = field(grid)
    positive = value > 0.0
    inside = np.zeros((_CELLS,) * 3, int)
    steps = [(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)]
    for a, b, c in steps:
        inside += positive[a : a + _CELLS, b : b + _CELLS, c : c + _CELLS]
    cells = np.argwhere((inside > 0) & (inside < 8))
    pieces = []
    for first in range(3):
        for second in {0, 1, 2} - {first}:
            walk = np.zeros((4, 3), int)
            walk[1:, first], walk[2:, second], walk[3] = 1, 1, 1
            at = cells[:, None] + walk
            index = np.ravel_multi_index(tuple(np.moveaxis(at, -1, 0)), value.shape)
            pieces.append(_cut_tetrahedra(index, positive.ravel()))
    ends = np.concatenate(pieces)  # of the edge that each corner lies on
    edges, triangles = np.unique(np.sort(ends.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    low, high = grid.reshape(-1, 3)[edges[:, 0]], grid.reshape(-1, 3)[edges[:, 1]]
    at_low = value.ravel()[edges[:, 0]] > 0.0
    for _ in range(40):  # halving
        middle = 0.5 * (low + high)
        same = (field(middle) > 0.0) == at_low
        low, high = np.where(same[:, None], middle, low), np.where(same[:, None], high, middle)
    return 0.5 * (low + high), _outward(field, 0.5 * (low + high), triangles.reshape(-1, 3).astype(np.int32))


def _cut_tetrahedra(corners: NDArray[np.int64], positive: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the triangles in which tetrahedra are cut, as three pairs of corners of the grid each."""
    sign = positive[corners]
    order = np.argsort(~sign, axis=1, kind="stable")  # those above zero first
    corners, count = np.take_along_axis(corners, order, axis=1), sign.sum(axis=1)
    a, b, c, d = (corners[:, k] for k in range(4))
    found = []
    for number, triples in (
        (1, [((a, b), (a, c), (a, d))]),
        (2, [((a, c), (a, d), (b, d)), ((a, c), (b, d), (b, c))]),
        (3, [((a, d), (b, d), (c, d))]),
    ):
        chosen = count == number
        for triple in triples:
            found.append(np.stack([np.stack([p[chosen], q[chosen]], axis=-1) for p, q in triple], axis=1))
    return np.concatenate(found)


def _outward(field: Field, vertices: Floats, triangles: NDArray[np.int32]) -> NDArray[np.int32]:
    """Turn the triangles so that the field falls along their normals."""
    normal = np.cross(*sides(vertices, triangles))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-300
    middle = vertices[triangles].mean(axis=1)
    rises = field(middle + 1e-4 * normal) > field(middle - 1e-4 * normal)
    return np.where(rises[:, None], triangles[:, ::-1], triangles)
