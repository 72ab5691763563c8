"""Elements of the surfaces of a tree's leaves, and which of them the tree keeps."""

from __future__ import annotations

import math

import numpy as np

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.core.patches import Patches
from surfel.shapes.base import Shape
from surfel.shapes.extent import bounded, half_space_of, is_empty
from surfel.shapes.mesh import Mesh
from surfel.shapes.placed import Placed
from surfel.shapes.primitives.half_space import HalfSpace
from surfel.shapes.primitives.primitive import Primitive, square_points
from surfel.shapes.sample_mesh import spread
from surfel.shapes.stretched import area_under
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree

_PILOT = 1024
_RIGID = 1e-12


def can_be_sampled(leaf: Shape) -> bool:
    """Tell whether points can be drawn from the surface of a leaf, or it is made of points already."""
    return isinstance(leaf, Mesh | Surfels) or half_space_of(leaf) is not None or bool(getattr(leaf, "sampled", False))


def exact_area(leaf: Shape, box: Floats) -> float | None:
    """Return the area of a leaf where it is known: that of a half-space is what lies in the box."""
    plane = half_space_of(leaf)
    if plane is not None:
        return float(_plane_elements(plane, np.array([[0.5, 0.5]]), box).areas.sum())
    if isinstance(leaf, Mesh):
        return leaf.area
    if isinstance(leaf, Placed):
        linear, local = leaf.matrix[:3, :3], leaf.shape.area
        if keeps_shape(leaf):
            return None if local is None else local * abs(float(np.linalg.det(linear))) ** (2.0 / 3.0)
        return area_under(leaf.shape, linear)
    return leaf.area if isinstance(leaf, Primitive) else None


def keeps_shape(leaf: Shape) -> bool:
    """Tell whether a leaf was only moved, turned, mirrored and scaled, if placed at all."""
    if not isinstance(leaf, Placed):
        return True
    squares = leaf.matrix[:3, :3].T @ leaf.matrix[:3, :3]
    stretch = float(np.trace(squares)) / 3.0
    return bool(np.abs(squares - stretch * np.eye(3)).max() <= _RIGID * stretch)


def rough_area(leaf: Shape, box: Floats) -> float:
    """Return about the area of a leaf, to share points out."""
    known = exact_area(leaf, box)
    if known is not None:
        return known
    return float(elements_of(leaf, square_points(_PILOT), box).areas.sum())


def elements_of(leaf: Shape, uv: Floats, box: Floats, seed: int = 0) -> Patches:
    """Return one element for each point of the unit square; of a mesh as many, spread by ``seed``.

    Parameters
    ----------
    leaf : Shape
        One that can be sampled, but no cloud.
    uv : Floats, shape (n, 2)
        Low-discrepancy points.
    box : Floats, shape (2, 3)
        What a half-space is cut off by.
    seed : int
        For meshes.
    """
    plane = half_space_of(leaf)
    if plane is not None:
        return _plane_elements(plane, uv, box)
    if isinstance(leaf, Mesh):
        points, triangles = spread(leaf, len(uv), seed)
        return Patches(points, leaf.face_normals[triangles], np.full(len(points), leaf.area / len(points)))
    if isinstance(leaf, Placed | Primitive):
        return leaf._sample(uv)
    raise InputError(f"the surface of a {type(leaf).__name__} cannot be sampled; take method='lines'")


def kept_elements(tree: Tree, n: int) -> Patches:
    """Return elements of the surface of a tree: about n for all its leaves together, less what the tree leaves out.

    Raises
    ------
    InputError
        If the tree is unbounded, or a leaf is known by its equation alone.
    """
    box = bounded(tree)
    program = tree.program
    active = [k for k in range(len(tree.leaves)) if not is_empty(program.boxes[k])]
    for k in active:
        if not can_be_sampled(tree.leaves[k]):
            raise InputError(
                f"the surface of a {_name(tree.leaves[k])} cannot be sampled, for it is known by its equation alone; "
                "cross the tree with lines instead"
            )
    sampled = [k for k in active if not isinstance(tree.leaves[k], Surfels)]
    sizes = {k: rough_area(tree.leaves[k], box) for k in sampled}
    whole = math.fsum(sizes.values()) or 1.0
    parts = []
    for k in active:
        leaf = tree.leaves[k]
        if isinstance(leaf, Surfels):
            found = leaf.surface.patches
        else:
            found = elements_of(leaf, square_points(max(1, round(n * sizes[k] / whole))), box)
        kept = program.keeps(found.points, found.normals, k)
        rows = kept != 0
        parts.append((found.points[rows], found.normals[rows] * kept[rows, None], found.areas[rows]))
    if not parts:
        return Patches(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    return Patches(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _name(leaf: Shape) -> str:
    return type(leaf.shape if isinstance(leaf, Placed) else leaf).__name__


def _plane_elements(plane: tuple[Floats, float], uv: Floats, box: Floats) -> Patches:
    normal, offset = plane
    margin = 1e-9 * float(np.abs(box).max())  # so that a plane in a side of the box is not lost to rounding
    return HalfSpace(tuple(normal), offset)._sample_within(uv, box + np.array([[-margin], [margin]]))
