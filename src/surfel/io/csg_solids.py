"""What single statements of a ``.csg`` file stand for: cube, sphere, cylinder, polyhedron, and matrices."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from surfel.core.cast import Floats
from surfel.io.csg_facets import faceted_cylinder, faceted_sphere, fragments, polyhedron
from surfel.io.csg_parse import Statement
from surfel.shapes.base import Shape

FACETS = ("auto", "exact", "as written")

FEW = 12
"""A circle with ``$fn`` up to this is a polygon on purpose (a nut, a post), not a coarse circle."""

ARGUMENTS: Mapping[str, tuple[str, ...]] = {
    "cube": ("size", "center"),
    "sphere": ("r", "d"),
    "cylinder": ("h", "r1", "r2", "center", "r", "d", "d1", "d2"),
    "polyhedron": ("points", "faces", "convexity", "triangles"),
    "multmatrix": ("m",),
    "color": ("c", "alpha"),
    "render": ("convexity",),
    "group": (),
    "union": (),
    "difference": (),
    "intersection": (),
    "import": (
        "file", "layer", "convexity", "origin", "scale", "center", "timestamp", "dpi", "id", "filename", "width",
        "height",
    ),
}  # fmt: skip
"""The arguments of each statement; those without a name are taken in this order."""

Placed = tuple[Shape, Floats | None]
"""A solid and where it stands: a matrix (4, 4), or None where it is centred at the origin as it is."""


class ArgumentError(ValueError):
    """An argument that does not fit; the reader adds the file and the line."""


def bound(statement: Statement) -> dict[str, Any]:
    """Return the arguments by name, those without one in their usual order."""
    names = ARGUMENTS[statement.name]
    if len(statement.positional) > len(names):
        raise ArgumentError(f"{len(statement.positional)} arguments without a name are more than it takes")
    given = dict(zip(names, statement.positional, strict=False))
    for name, value in statement.named.items():
        if name not in names and not name.startswith("$"):
            raise ArgumentError(f"it has no argument {name!r}")
        given[name] = value
    return given


def solid_of(statement: Statement, specials: Mapping[str, Any], facets: str) -> Placed | None:
    """Return the solid of a cube, sphere, cylinder or polyhedron; None where it is empty, of size zero.

    Raises
    ------
    ArgumentError
        If an argument is of another type, negative, not finite, or there are too many.
    """
    given = bound(statement)
    circles = _Circles({**specials, **given}, facets)
    return _SOLIDS[statement.name](given, circles)


class _Circles:
    """Whether circles are exact, and how many edges they have where they are not."""

    def __init__(self, given: Mapping[str, Any], facets: str) -> None:
        self.fn = _number(given, "$fn", 0.0)
        self.fa = _number(given, "$fa", 12.0)
        self.fs = _number(given, "$fs", 2.0)
        self.exact = facets == "exact" or (facets == "auto" and not 0.0 < self.fn <= FEW)

    def edges(self, radius: float) -> int:
        return fragments(radius, self.fn, self.fa, self.fs)


def _cube(given: Mapping[str, Any], circles: _Circles) -> Placed | None:
    from surfel.shapes.primitives.box import Box

    value = given.get("size", 1.0)
    sides = _vector(value, "size", 3) if isinstance(value, list) else [_number(given, "size", 1.0)] * 3
    if not _sizes(sides, "size"):
        return None
    return Box(tuple(sides)), None if _truth(given, "center") else _lifted(*(0.5 * side for side in sides))


def _sphere(given: Mapping[str, Any], circles: _Circles) -> Placed | None:
    from surfel.shapes.primitives.ellipsoid import Sphere

    radius = _radius(given, "r", "d", 1.0)
    if not _sizes([radius], "the radius"):
        return None
    return (Sphere(radius) if circles.exact else faceted_sphere(radius, circles.edges(radius))), None


def _cylinder(given: Mapping[str, Any], circles: _Circles) -> Placed | None:
    height = _number(given, "h", 1.0)
    both = _radius(given, "r", "d", 1.0)
    bottom, top = _radius(given, "r1", "d1", both), _radius(given, "r2", "d2", both)
    if not _sizes([height], "h") or not (_sizes([bottom], "r1") | _sizes([top], "r2")):
        return None
    place = None if _truth(given, "center") else _lifted(0.0, 0.0, 0.5 * height)
    if not circles.exact:
        return faceted_cylinder(bottom, top, height, circles.edges(max(bottom, top))), place
    from surfel.shapes.primitives.cylinder import Cone, Cylinder

    return (Cylinder(bottom, height) if bottom == top else Cone(bottom, top, height)), place


def _polyhedron(given: Mapping[str, Any], circles: _Circles) -> Placed | None:
    points = given.get("points", [])
    if not isinstance(points, list):
        raise ArgumentError("points must be a list of [x, y, z]")
    rows = [_vector(row, f"point {i}", 3) for i, row in enumerate(points)]
    faces = given.get("faces", given.get("triangles", []))
    if not isinstance(faces, list):
        raise ArgumentError("faces must be a list of lists of point numbers")
    corners = [_corners(face, i, len(rows)) for i, face in enumerate(faces)]
    return (polyhedron(np.array(rows).reshape(-1, 3), corners), None) if corners else None


_SOLIDS = {"cube": _cube, "sphere": _sphere, "cylinder": _cylinder, "polyhedron": _polyhedron}
SOLIDS = frozenset(_SOLIDS)


def matrix_of(statement: Statement) -> Floats | None:
    """Return the matrix (4, 4) of a multmatrix; None where it flattens whatever it is applied to.

    Raises
    ------
    ArgumentError
        If it is not a matrix of three or four rows of four numbers, or not affine.
    """
    value = bound(statement).get("m")
    if not isinstance(value, list) or len(value) not in (3, 4):
        raise ArgumentError("m must be a matrix of 4 x 4 numbers")
    rows = np.array([_vector(row, f"row {i} of m", 4) for i, row in enumerate(value)])
    matrix = np.vstack([rows, [[0.0, 0.0, 0.0, 1.0]]]) if len(rows) == 3 else rows
    if matrix[3, :3].any() or matrix[3, 3] == 0.0:
        raise ArgumentError("the last row of m must be [0, 0, 0, 1]: perspective is not supported")
    matrix = matrix / matrix[3, 3]
    scale = float(np.abs(matrix[:3, :3]).max())
    return None if scale == 0.0 or np.linalg.det(matrix[:3, :3] / scale) == 0.0 else matrix


def _corners(face: Any, number: int, points: int) -> Any:
    if not isinstance(face, list) or len(face) < 3 or not all(isinstance(i, float) for i in face):
        raise ArgumentError(f"face {number} must be a list of at least three point numbers")
    corners = np.array(face)
    if not (np.isfinite(corners) & (corners == np.floor(corners)) & (corners >= 0) & (corners < points)).all():
        wrong = next(i for i in face if not (i >= 0 and i == math.floor(i) and i < points))
        raise ArgumentError(f"face {number} names point {wrong:g}, but there are points 0 to {points - 1}")
    return corners.astype(np.int64)


def _lifted(x: float, y: float, z: float) -> Floats:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def _radius(given: Mapping[str, Any], radius: str, diameter: str, default: float) -> float:
    if given.get(diameter) is not None:
        return 0.5 * _number(given, diameter, 0.0)
    return _number(given, radius, default)


def _sizes(values: list[float], name: str) -> bool:
    """Tell whether sizes are positive; one of zero makes the solid empty, as in OpenSCAD."""
    if min(values) < 0.0:
        raise ArgumentError(f"{name} must not be negative; it is {min(values):g}")
    return min(values) > 0.0


def _number(given: Mapping[str, Any], name: str, default: float) -> float:
    value = given.get(name)
    if value is None:
        return default
    if not isinstance(value, float) or not math.isfinite(value):
        raise ArgumentError(f"{name} must be a finite number; it is {_shown(value)}")
    return value


def _vector(value: Any, name: str, size: int) -> list[float]:
    good = isinstance(value, list) and len(value) == size
    if not good or not all(isinstance(number, float) and math.isfinite(number) for number in value):
        raise ArgumentError(f"{name} must be {size} finite numbers; it is {_shown(value)}")
    return list(value)


def _truth(given: Mapping[str, Any], name: str) -> bool:
    value = given.get(name)
    if value is None or isinstance(value, bool):
        return bool(value)
    raise ArgumentError(f"{name} must be true or false; it is {_shown(value)}")


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."
