"""A tree of solids as the text of a ``.csg`` file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.shapes.base import Shape
from surfel.shapes.mesh import Mesh
from surfel.shapes.placed import Placed
from surfel.shapes.tree import Tree

CIRCLE = "$fn = 128"
"""How many facets OpenSCAD is to give to circles; more than any number that is read as facets on purpose."""

_ROOM = 1.01  # the cube of a half-space is so much larger than all else


def csg_text(shape: Shape) -> str:
    """Return the text of a tree.

    Raises
    ------
    InputError
        If a leaf has no counterpart in OpenSCAD.
    """
    if not isinstance(shape, Shape):
        raise InputError(f"a .csg file holds a tree of solids; got {type(shape).__name__}")
    lines: list[str] = []
    covering = _Covering(shape)
    todo: list[tuple[Shape | None, int]] = [(shape, 0)]
    while todo:
        node, depth = todo.pop()
        if node is None:
            lines.append("\t" * depth + "}")
        elif isinstance(node, Tree) and node.children:
            lines.append("\t" * depth + f"{node.operation}() {{")
            todo.append((None, depth))
            todo.extend((child, depth + 1) for child in reversed(node.children))
        else:
            lines.append("\t" * depth + _leaf(node, covering))
    return "\n".join(lines) + "\n"


def _leaf(leaf: Shape, covering: _Covering) -> str:
    if isinstance(leaf, Tree):
        return "group();"
    if isinstance(leaf, Mesh):
        return _mesh(leaf)
    matrix = leaf.matrix if isinstance(leaf, Placed) else np.eye(4)
    shape: Any = leaf.shape if isinstance(leaf, Placed) else leaf
    name = type(shape).__name__
    if name == "HalfSpace":
        return covering.half_space(shape, matrix)
    if name not in _CALLS:
        raise InputError(f"a {name} cannot be written to a .csg file; {_CURES.get(name, _CURE)}")
    own, call = _CALLS[name](shape)
    return _placed(matrix if own is None else matrix @ own, call)


def _placed(matrix: Floats, call: str) -> str:
    if np.array_equal(matrix, np.eye(4)):
        return call
    rows = ", ".join(_list(row) for row in matrix.tolist())
    return f"multmatrix([{rows}]) {{ {call} }}"


def _box(box: Any) -> tuple[None, str]:
    return None, f"cube(size = {_list(np.broadcast_to(np.asarray(box.size, float), 3).tolist())}, center = true);"


def _sphere(sphere: Any) -> tuple[None, str]:
    return None, f"sphere({CIRCLE}, r = {float(sphere.radius)!r});"


def _ellipsoid(ellipsoid: Any) -> tuple[Floats, str]:
    return np.diag([*np.broadcast_to(np.asarray(ellipsoid.radii, float), 3).tolist(), 1.0]), f"sphere({CIRCLE}, r = 1);"


def _cylinder(cylinder: Any) -> tuple[None, str]:
    return None, _round(cylinder.radius, cylinder.radius, cylinder.height)


def _cone(cone: Any) -> tuple[None, str]:
    return None, _round(cone.bottom, cone.top, cone.height)


def _round(bottom: float, top: float, height: float) -> str:
    sizes = f"h = {float(height)!r}, r1 = {float(bottom)!r}, r2 = {float(top)!r}"
    return f"cylinder({CIRCLE}, {sizes}, center = true);"


_CALLS: dict[str, Callable[[Any], tuple[Floats | None, str]]] = {
    "Box": _box,
    "Sphere": _sphere,
    "Ellipsoid": _ellipsoid,
    "Cylinder": _cylinder,
    "Cone": _cone,
}
_CURE = "OpenSCAD has nothing like it; put a mesh of it in its place"
_CURES = {"Surfels": 'write the cloud by surfel.write("scan.ply", cloud) and name it by import("scan.ply") in the file'}


def _mesh(mesh: Mesh) -> str:
    """Write a polyhedron; OpenSCAD's faces are clockwise seen from outside."""
    triangles = mesh.triangles if mesh.inverted else mesh.triangles[:, ::-1]
    points = ", ".join(_list(row) for row in mesh.vertices.tolist())
    faces = ", ".join(_list(row) for row in triangles.tolist())
    return f"polyhedron(points = [{points}], faces = [{faces}], convexity = 10);"


def _list(numbers: Iterable[float]) -> str:
    return "[" + ", ".join(map(repr, numbers)) + "]"


class _Covering:
    """A ball round all bounded leaves: cut off there, a half-space changes nothing of a bounded tree.

    Outside of it every leaf is false then, and so is the tree; inside nothing has changed.
    """

    def __init__(self, shape: Shape) -> None:
        self.shape = shape
        self.found: tuple[Floats, float] | None = None

    def ball(self) -> tuple[Floats, float]:
        if self.found is None:
            boxes = [np.asarray(self.shape.bounds)]
            if not np.isfinite(boxes[0]).all():
                raise InputError("a half-space leaves the tree unbounded; intersect it with a box")
            leaves = self.shape.leaves if isinstance(self.shape, Tree) else (self.shape,)
            boxes += [leaf.bounds for leaf in leaves if np.isfinite(leaf.bounds).all()]
            low, high = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
            self.found = 0.5 * (low + high), _ROOM * 0.5 * float(np.linalg.norm(high - low))
        return self.found

    def half_space(self, shape: Any, matrix: Floats) -> str:
        centre, radius = self.ball()
        normal = np.linalg.solve(matrix[:3, :3].T, np.asarray(shape.normal, float))
        offset = float(shape.offset) + float(normal @ matrix[:3, 3])
        length = float(np.linalg.norm(normal))
        normal, offset = normal / length, offset / length
        depth = min(offset - float(normal @ centre), radius) + radius
        if depth <= 0.0:
            return "group();"
        first = np.cross(np.eye(3)[np.abs(normal).argmin()], normal)
        first /= np.linalg.norm(first)
        place = np.eye(4)
        place[:3, :3] = np.stack([first, np.cross(normal, first), normal], axis=1)
        place[:3, 3] = centre + (depth - radius) * normal
        place[:3, 3] -= place[:3, :3] @ [radius, radius, depth]
        return _placed(place, f"cube(size = {_list([2.0 * radius, 2.0 * radius, depth])}, center = false);")
