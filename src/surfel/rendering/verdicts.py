"""Verdicts: whether what a line of sight meets on a leaf belongs to the tree, asked at the very place."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.sides import FROM_KIND, IN, OPPOSED, OUT, SAME, Sides
from surfel.core.cast import Booleans, Floats
from surfel.core.together import together
from surfel.rendering.asking import asked
from surfel.rendering.scene import Item, box_of
from surfel.shapes.base import Shape
from surfel.shapes.surfels import Surfels

_BESIDE = 1e-7  # of the scene's reach: how far just above and just below an exact surface are
_WORK = 20  # what a leaf is asked for a place costs, in the items of kernels


def kept(item: Item, leaf: int | NDArray[np.integer[Any]], points: Floats, normals: Floats, reach: float) -> Booleans:
    """Tell which places on the surfaces of leaves are seen, by the one rule for trees.

    Parameters
    ----------
    item : Item
        Everything survives of one without a rule.
    leaf : int, or NDArray[np.integer], shape (m,)
        Which of its leaves the places lie on.
    points, normals : Floats, shape (m, 3)
        In the world; the normals outward from the leaf.
    reach : float
        The size of the scene.
    """
    rule, count = item.rule, len(points)
    if rule is None or not count:
        return np.ones(count, np.bool_)
    own = np.broadcast_to(leaf, count)

    def beside(k: int) -> NDArray[np.uint8]:
        rows = np.flatnonzero(own != k)
        sides = np.full(count, OUT, np.uint8)
        sides[rows] = sides_of(item.leaves[k], points[rows], normals[rows], reach)
        return sides

    solid = [k for k in range(len(item.leaves)) if k not in rule.sheets]
    sides = dict(zip(solid, together(beside, solid, [_WORK * count] * len(solid)), strict=True))
    good = np.zeros(count, np.bool_)
    for mine in np.unique(own).tolist():
        rows = np.flatnonzero(own == mine)
        around: dict[int, Sides] = {k: found[rows] for k, found in sides.items() if k != mine}
        good[rows] = rule.keeps(mine, around, len(rows)) != 0
    return good


def sides_of(other: Shape, points: Floats, normals: Floats, reach: float) -> NDArray[np.uint8]:
    """Return what lies just below and just above each place: in another leaf or not."""
    sides = np.full(len(points), OUT, np.uint8)
    box = box_of(other)
    if box is None:
        return sides
    margin = 1e-6 * reach
    some = np.flatnonzero(((points >= box[0] - margin) & (points <= box[1] + margin)).all(axis=1))
    if not len(some):
        return sides
    if isinstance(other, Surfels):
        sides[some] = FROM_KIND[asked(other, points[some], normals[some]).kind]
        return sides
    step = _BESIDE * reach * normals[some]
    below, above = other._contains(points[some] - step), other._contains(points[some] + step)
    sides[some] = np.where(below, np.where(above, IN, SAME), np.where(above, OPPOSED, OUT))
    return sides
