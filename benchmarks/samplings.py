"""How clouds are drawn for the coverage of their intervals: at random, evenly, along scan lines, or unevenly."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.clouds import APART
from benchmarks.pieces import Floats
from benchmarks.shapes import KnownShape

Draw = Callable[[KnownShape, int, np.random.Generator], tuple[Floats, Floats]]
"""Points and normals of a shape: about so many, with such random numbers."""

STRETCH = 3.0
"""How much nearer than across points lie along a scan line."""


def _random(known: KnownShape, n: int, random: np.random.Generator) -> tuple[Floats, Floats]:
    return known.draw(n, random)


def _even(known: KnownShape, n: int, random: np.random.Generator) -> tuple[Floats, Floats]:
    points, normals = known.draw(5 * n, random)
    rows = _darts(points, normals, APART * math.sqrt(known.area / n), 1.0, random)
    return points[rows], normals[rows]


def _scan_lines(known: KnownShape, n: int, random: np.random.Generator) -> tuple[Floats, Floats]:
    """Darts whose distance is longer along the lines: where the surface crosses planes through a random axis."""
    points, normals = known.draw(5 * n, random)
    axis = random.standard_normal(3)
    along = np.cross(normals, axis / np.linalg.norm(axis))
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-12
    rows = _darts(points, along, APART * math.sqrt(known.area / n), STRETCH, random)
    return points[rows], normals[rows]


def _darts(
    points: Floats, along: Floats, apart: float, stretch: float, random: np.random.Generator
) -> NDArray[np.int64]:
    """Take points in random order; each keeps away later ones, the farther across its direction the more stretch."""
    from scipy.spatial import cKDTree

    order = random.permutation(len(points))
    place, way = points[order], along[order]
    pairs = cKDTree(place).query_pairs(apart * math.sqrt(stretch), output_type="ndarray")
    offset = place[pairs[:, 1]] - place[pairs[:, 0]]
    on_line = np.einsum("ij,ij->i", offset, way[pairs[:, 0]]) ** 2
    off_line = np.einsum("ij,ij->i", offset, offset) - on_line
    pairs = np.sort(pairs[on_line * stretch + off_line / stretch < apart * apart], axis=1)
    earlier, later = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].T
    starts = np.searchsorted(earlier, np.arange(len(points) + 1))
    alive = np.ones(len(points), bool)
    for i in range(len(points)):
        if alive[i]:
            alive[later[starts[i] : starts[i + 1]]] = False
    return order[alive]


def _uneven(ratio: float) -> Draw:
    def draw(known: KnownShape, n: int, random: np.random.Generator) -> tuple[Floats, Floats]:
        points, normals = known.draw(int(8 * n * math.sqrt(ratio / 16.0) * 1.5), random)
        axis = int(np.argmax(np.ptp(points, axis=0)))
        height = (points[:, axis] - points[:, axis].min()) / np.ptp(points[:, axis])
        rows = np.flatnonzero(random.random(len(points)) < ratio ** (height - 1.0))[:n]
        return points[rows], normals[rows]

    return draw


SAMPLINGS: dict[str, Draw] = {
    "random": _random,
    "even": _even,
    "scan lines": _scan_lines,
    "16x": _uneven(16.0),
    "30x": _uneven(30.0),
}
