"""What a tree keeps of one leaf's surface: a grid of cells over it, those that a cut passes divided further.

A first point in every cell tells where the tree changes its mind. The cells there are cut into smaller ones with two
points each; every other cell gets one point more. Only these fresh points count, so the estimate has no bias whatever
the first ones missed, and the pairs tell its error. The error of a plain low-discrepancy set falls as N^-3/4; this one
falls nearly as N^-1, because only the cells on the cut contribute.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.shapes.base import Shape
from surfel.shapes.elements import elements_of, exact_area, keeps_shape
from surfel.shapes.placed import Placed
from surfel.shapes.primitives.primitive import square_points
from surfel.shapes.tree import Tree

_EXPLORED = 0.125
"""Share of the points that look for the cut; as many look elsewhere afterwards."""

_LEAST_CELLS = 196
_HIDDEN = 0.25
"""Of a cell: what may hide where both of its points agree; nothing else tells of features smaller than a cell."""

_UNEVEN = 0.2
"""Where the map's area differs by more within a cell, or from the next one, a rule with four points will not do."""

_QUADRATURE = 1e-13  # rounding of a sum of cells
_FEW = 64

_MOST_ASPECT = 64.0
_BLOCK = 1 << 19  # points that are judged at a time
_GAUSS = 0.5 / math.sqrt(3.0)
_EVEN = 1e-9


class Kept(NamedTuple):
    """An area, the variance of its estimate and its degrees of freedom, and how many points were asked."""

    area: float
    variance: float
    freedom: float
    points: int


def kept_area(tree: Tree, k: int, box: Floats, points: int, random: np.random.Generator, alone: bool) -> Kept:
    """Estimate the area that a tree keeps of a leaf.

    Parameters
    ----------
    tree : Tree
        Bounded.
    k : int
        The leaf; its surface is the image of the unit square.
    box : Floats, shape (2, 3)
        Of the tree; half-spaces end there.
    points : int
        About how many to spend; fewer where nothing is cut.
    random : numpy.random.Generator
        Places the points in their cells.
    alone : bool
        No other leaf is near, so that all of the surface shares one fate.
    """
    leaf = tree.leaves[k]
    judge = _Judge(tree, k, box)
    exact = exact_area(leaf, box)
    if alone and exact is not None:
        seen, _ = judge(random.random((1, 2)))
        return Kept(exact if seen[0] else 0.0, 0.0, math.inf, judge.asked)
    columns, rows = _grid(leaf, box, max(_LEAST_CELLS, int(points * _EXPLORED)))
    size = np.array([1.0 / columns, 1.0 / rows])
    corner = _corners(columns, rows)
    weight, spread = _cell_areas(leaf, box, corner, size, exact)
    uneven = _beside((weight / weight.mean()).reshape(columns, rows), _UNEVEN).ravel() | (spread > _UNEVEN)
    if exact is not None and not uneven.any():
        weight *= exact / float(weight.sum())
    seen, _ = judge(corner + random.random(corner.shape) * size)
    mixed = _beside(seen.reshape(columns, rows).astype(float), 0.5).ravel() | uneven
    plain = ~mixed
    told, _ = judge(corner[plain] + random.random((int(plain.sum()), 2)) * size)
    surprise = weight[plain] * (told != seen[plain])
    area, variance = float(weight[plain] @ told), float(surprise @ surprise)
    fourth = float((surprise**4).sum())
    if mixed.any():
        spare = max(points - judge.asked, 2)
        fine = max(1, int(math.sqrt(spare / (2.0 * mixed.sum()))))
        one, other = _pairs(judge, corner[mixed], size, fine, random)
        area += 0.5 * float((one + other).sum())
        told_apart = 0.25 * (one - other) ** 2
        variance += float(told_apart.sum())
        fourth += float((told_apart**2).sum())
    if not alone:
        variance += (_HIDDEN * float(weight.mean())) ** 2
    if exact is None:
        variance += _rule_error(leaf, box, corner[plain] + 0.5 * size, weight[plain], len(corner)) ** 2
    freedom = variance**2 / fourth if fourth > 0.0 else math.inf  # few pairs tell little of their variance
    return Kept(area, variance, freedom, judge.asked)


class _Judge:
    """Asks the tree at points of the unit square, and counts them."""

    def __init__(self, tree: Tree, k: int, box: Floats) -> None:
        self.tree, self.k, self.box, self.asked = tree, k, box, 0

    def __call__(self, uv: Floats) -> tuple[NDArray[np.bool_], Floats]:
        """Return whether the tree keeps each point, and the area that the whole square would have there."""
        kept, density = [], []
        for start in range(0, len(uv), _BLOCK):
            part = uv[start : start + _BLOCK]
            found = elements_of(self.tree.leaves[self.k], part, self.box)
            kept.append(self.tree.program.keeps(found.points, found.normals, self.k) != 0)
            density.append(found.areas * len(part))
        self.asked += len(uv)
        return (np.concatenate(kept), np.concatenate(density)) if kept else (np.zeros(0, bool), np.zeros(0))


def _pairs(
    judge: _Judge, corner: Floats, size: Floats, fine: int, random: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return two independent estimates of the kept area of each of the smaller cells that cells are cut into."""
    small = size / fine
    places = (corner[:, None] + _corners(fine, fine)[None] * size).reshape(-1, 2)
    share = float(small.prod())
    told = [judge(places + random.random(places.shape) * small) for _ in range(2)]
    one, other = (kept * density * share for kept, density in told)
    return one, other


def _grid(leaf: Shape, box: Floats, cells: int) -> tuple[int, int]:
    """Return how many columns and rows make so many cells that are about square on the surface."""
    aspect = _aspect(leaf.shape) if isinstance(leaf, Placed) and leaf.sampled else _aspect_in(leaf, box)
    columns = max(1, min(cells, round(math.sqrt(cells * aspect))))
    return columns, max(1, round(cells / columns))


@lru_cache(maxsize=1024)
def _aspect(primitive: Shape) -> float:
    return _aspect_in(primitive, np.array([[-1.0] * 3, [1.0] * 3]))


def _aspect_in(leaf: Shape, box: Floats) -> float:
    """Return how much longer the surface is along u than along v, seen from small steps at a few places."""
    uv = 1e-4 + 0.9998 * square_points(64)
    here = elements_of(leaf, uv, box).points
    if len(here) == 0:
        return 1.0
    steps = [elements_of(leaf, uv + step, box).points - here for step in ([1e-5, 0.0], [0.0, 1e-5])]
    along_u, along_v = (float(np.median(np.linalg.norm(step, axis=1))) for step in steps)
    return min(max(along_u / max(along_v, 1e-300), 1.0 / _MOST_ASPECT), _MOST_ASPECT)


def _corners(columns: int, rows: int) -> Floats:
    """Return the low corner of each cell of the unit square, column by column, shape (columns rows, 2)."""
    u, v = np.meshgrid(np.arange(columns) / columns, np.arange(rows) / rows, indexing="ij")
    return np.column_stack([u.ravel(), v.ravel()])


def _cell_areas(leaf: Shape, box: Floats, corner: Floats, size: Floats, exact: float | None) -> tuple[Floats, Floats]:
    """Return the area of the surface over each cell by Gauss' rule with four points, and the spread of the four."""
    if exact is not None and keeps_shape(leaf):
        few = elements_of(leaf, square_points(_FEW), box).areas
        if np.ptp(few) <= _EVEN * few.mean():  # the map keeps areas
            return np.full(len(corner), exact / len(corner)), np.zeros(len(corner))
    told = []
    for u in (0.5 - _GAUSS, 0.5 + _GAUSS):
        for v in (0.5 - _GAUSS, 0.5 + _GAUSS):
            told.append(elements_of(leaf, corner + np.array([u, v]) * size, box).areas)
    total = 0.25 * np.sum(told, axis=0)
    return total, np.ptp(told, axis=0) / np.maximum(total, 1e-300)


def _rule_error(leaf: Shape, box: Floats, middle: Floats, weight: Floats, cells: int) -> float:
    """Return how far Gauss' rule over some of the cells is from the midpoint rule, which is poorer."""
    if len(middle) == 0:
        return 0.0
    whole = float(weight.sum())
    return abs(float(elements_of(leaf, middle, box).areas.sum()) * len(middle) / cells - whole) + _QUADRATURE * whole


def _beside(values: Floats, step: float) -> NDArray[np.bool_]:
    """Tell which cells differ by more than a step from one of their four neighbours; the square closes to a torus."""
    differs = np.zeros(values.shape, np.bool_)
    for axis in (0, 1):
        if values.shape[axis] > 1:
            change = np.abs(values - np.roll(values, 1, axis)) > step
            differs |= change | np.roll(change, -1, axis)
    return differs
