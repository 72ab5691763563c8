"""Verdicts: whether what a line of sight meets on a leaf belongs to the tree, asked at the very place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.sides import FROM_KIND, IN, OPPOSED, OUT, SAME, Sides
from surfel.core.cast import Booleans, Floats
from surfel.rendering.asking import asked
from surfel.rendering.scene import Item, box_of
from surfel.shapes.base import Shape
from surfel.shapes.surfels import Surfels

_BESIDE = 1e-7  # of the scene's reach: how far just above and just below an exact surface are


def kept(item: Item, leaf: int, points: Floats, normals: Floats, reach: float) -> Booleans:
    """Tell which places on the surface of a leaf are seen, by the one rule for trees.

    Parameters
    ----------
    item : Item
        Everything survives of one without a rule.
    leaf : int
        Which of its leaves the places lie on.
    points, normals : Floats, shape (m, 3)
        In the world; the normals outward from the leaf.
    reach : float
        The size of the scene.
    """
    if item.rule is None or not len(points):
        return np.ones(len(points), np.bool_)
    sides: dict[int, Sides] = {}
    for k, other in enumerate(item.leaves):
        if k != leaf and k not in item.rule.sheets:
            found = sides_of(other, points, normals, reach)
            if found.any():
                sides[k] = found
    return np.asarray(item.rule.keeps(leaf, sides, len(points)) != 0)


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
