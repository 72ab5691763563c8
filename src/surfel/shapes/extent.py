"""How far a tree reaches: boxes combined from the leaves up, and half-spaces by a linear program."""

from __future__ import annotations

import numpy as np

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.shapes.base import CORNERS, MARGIN, Shape
from surfel.shapes.placed import Placed
from surfel.shapes.primitives.half_space import HalfSpace
from surfel.shapes.tree import Difference, Intersection, Tree, postorder

EMPTY = np.array([[np.inf] * 3, [-np.inf] * 3])


def extent_of(tree: Tree) -> Floats:
    """Return the box round a tree, shape (2, 3): infinite where it is unbounded, zeros where it is empty."""
    box = boxes_of(tree)[id(tree)]
    return np.zeros((2, 3)) if is_empty(box) else box


def bounded(tree: Tree) -> Floats:
    """Return the box round a tree that has to have one.

    Raises
    ------
    InputError
        If the tree is unbounded.
    """
    box = tree.bounds
    if not np.isfinite(box).all():
        axes = " and ".join(name for k, name in enumerate("xyz") if not np.isfinite(box[:, k]).all())
        raise InputError(
            f"the tree has no end along {axes}: a half-space or an open quadric is not cut off there; "
            "intersect it with a bounded shape, as in tree & surfel.Box(size)"
        )
    return box


def hull_of(tree: Tree) -> tuple[Floats, float]:
    """Return points whose convex hull, grown by a margin, holds a bounded tree: those of what is not subtracted.

    Of an intersection the smallest operand will do; the box round the node is taken where that is smaller still.
    """
    boxes = boxes_of(tree)
    hulls: dict[int, tuple[Floats, float]] = {}
    for node in _kept_nodes(tree):
        box = boxes[id(node)]
        corners = box[CORNERS, range(3)]
        choices = [(corners, MARGIN * float(np.abs(corners).max()))] if np.isfinite(box).all() else []
        if not isinstance(node, Tree):
            if choices:
                choices.append(node._hull())
        elif node.operation == "union":
            parts = [hulls[id(child)] for child in node.children if not is_empty(boxes[id(child)])]
            if parts and all(len(points) for points, _ in parts):
                choices.append((np.concatenate([points for points, _ in parts]), max(margin for _, margin in parts)))
        else:
            inputs = node.children if node.operation == "intersection" else node.children[:1]
            choices += [hulls[id(child)] for child in inputs if len(hulls[id(child)][0])]
        hulls[id(node)] = min(choices, key=_spread_of) if choices else (np.empty((0, 3)), 0.0)
    return hulls[id(tree)]


def _kept_nodes(tree: Tree) -> list[Shape]:
    """Return the nodes that are not within anything subtracted, children first."""
    kept: set[int] = {id(tree)}
    order = postorder(tree)
    for node in reversed(order):
        if isinstance(node, Tree) and id(node) in kept:
            kept.update(id(child) for child in (node.children[:1] if node.operation == "difference" else node.children))
    return [node for node in order if id(node) in kept]


def _spread_of(hull: tuple[Floats, float]) -> float:
    """Return the sum of squares of the distances from the mean, a cheap measure of how much room a hull takes."""
    points, margin = hull
    return float(((points - points.mean(axis=0)) ** 2).sum(axis=1).max()) + margin * margin


def is_empty(box: Floats) -> bool:
    """Tell whether nothing lies in a box, not even a point."""
    return bool((box[0] > box[1]).any())


def boxes_of(tree: Tree) -> dict[int, Floats]:
    """Return the box round every node of a tree by identity; the empty one is inverted."""
    boxes: dict[int, Floats] = {}
    for node in postorder(tree):
        boxes[id(node)] = _box_of(node, boxes)
    return boxes


def _box_of(node: Shape, boxes: dict[int, Floats]) -> Floats:
    if not isinstance(node, Tree):
        return _leaf_box(node)
    parts = [boxes[id(child)] for child in node.children]
    if node.operation == "union":
        full = [part for part in parts if not is_empty(part)]
        return np.stack([np.min(full, axis=0)[0], np.max(full, axis=0)[1]]) if full else EMPTY
    if node.operation == "difference":
        parts = parts[:1]
    box = np.stack([np.max(parts, axis=0)[0], np.min(parts, axis=0)[1]])
    if is_empty(box) or np.isfinite(box).all():
        return EMPTY if is_empty(box) else box
    return _cut_by_planes(box, _planes(node))


def _leaf_box(leaf: Shape) -> Floats:
    try:
        return np.asarray(leaf.bounds)
    except InputError:  # an empty cloud or a mesh without triangles
        return EMPTY


def _planes(node: Tree) -> list[tuple[Floats, float]]:
    """Return the half-spaces normal . x <= offset that a node lies in."""
    found = []
    for place, child in enumerate(node.children):
        plane = half_space_of(child)
        if plane is None and isinstance(child, Intersection | Difference):
            found += _planes(child) if node.operation == "intersection" or place == 0 else []
        elif plane is not None:
            turned = node.operation == "difference" and place > 0
            found.append((-plane[0], -plane[1]) if turned else plane)
    return found


def half_space_of(leaf: Shape) -> tuple[Floats, float] | None:
    """Return normal and offset of a half-space, wherever it was placed."""
    if isinstance(leaf, HalfSpace):
        return np.asarray(leaf.normal, float), float(leaf.offset)
    if isinstance(leaf, Placed) and isinstance(leaf.shape, HalfSpace):
        normal = np.asarray(leaf.shape.normal, float)
        mapped = normal @ leaf.inverse
        return mapped[:3], float(leaf.shape.offset) - float(mapped[3])
    return None


def _cut_by_planes(box: Floats, planes: list[tuple[Floats, float]]) -> Floats:
    """Shrink a box to the part that the planes leave; the sides stay infinite where they leave it open."""
    from scipy.optimize import linprog

    if not planes:
        return box
    normals = np.array([normal for normal, _ in planes])
    offsets = np.array([offset for _, offset in planes])
    limits = [(lo if np.isfinite(lo) else None, hi if np.isfinite(hi) else None) for lo, hi in box.T]
    cut = box.copy()
    for axis in range(3):
        for end, sign in ((0, 1.0), (1, -1.0)):
            goal = np.zeros(3)
            goal[axis] = sign
            found = linprog(goal, A_ub=normals, b_ub=offsets, bounds=limits, method="highs")
            if found.status == 2:
                return EMPTY
            if found.status == 0:
                cut[end, axis] = found.x[axis]
    if not np.isfinite(cut).all():
        return cut
    margin = 1e-9 * (cut[1] - cut[0])  # the program is solved in floating point
    return np.stack([cut[0] - margin, cut[1] + margin])
