"""The Python that makes what is on the stage."""

from __future__ import annotations

import numpy as np

from surfel.shapes.placed import Placed
from surfel.shapes.surfels import Surfels
from surfel.viewer.stage import Join, Part, Stage

_WRITTEN = ("Box", "Sphere", "Ellipsoid", "Cylinder", "Cone", "Torus", "HalfSpace")
"""Shapes of which the repr makes them anew."""

_SIGNS = {"union": " | ", "intersection": " & ", "difference": " - "}


def script_of(stage: Stage) -> str:
    """Return a program that builds the stage's expression and measures it.

    Solids and files are written out. For what was handed over as a Python object a line says so.
    """
    names = _names(stage)
    lines = ["import surfel", ""]
    for part in stage.parts:
        lines.append(f"{names[id(part)]} = {_maker(part)}")
    root = stage.root
    assert root is not None
    lines += [f"tree = {_expression(root, names)}", "", "m = surfel.measure(tree)", "print(m.area, m.volume)"]
    if any(isinstance(part.shape, Surfels) for part in stage.parts) and isinstance(root, Join):
        lines.append('surfel.write("result.ply", surfel.combine(tree).surfels)')
    return "\n".join(lines) + "\n"


def _names(stage: Stage) -> dict[int, str]:
    taken: set[str] = {"m", "tree", "surfel"}
    names = {}
    for part in stage.parts:
        word = "".join(c if c.isalnum() and c.isascii() else "_" for c in part.name.lower()).strip("_") or "part"
        word = f"part_{word}" if word[0].isdigit() else word
        while word in taken:
            word += "_"
        taken.add(word)
        names[id(part)] = word
    return names


def _maker(part: Part) -> str:
    shape = part.shape
    source = shape.provenance.get("path") if isinstance(shape, Surfels) else None
    if source is not None:
        made = f"surfel.read({str(source)!r})"
    elif isinstance(shape, Placed) and type(shape.shape).__name__ in _WRITTEN:
        made = f"surfel.{shape.shape!r}.transformed({_matrix(shape.matrix)})"
    elif type(shape).__name__ in _WRITTEN:
        made = f"surfel.{shape!r}"
    else:
        made = f"...  # {type(shape).__name__} that was handed over: {shape!r}"
        return made if np.array_equal(part.pose, np.eye(4)) else f"{made}, then .transformed({_matrix(part.pose)})"
    return made if np.array_equal(part.pose, np.eye(4)) else f"{made}.transformed({_matrix(part.pose)})"


def _matrix(matrix: np.ndarray) -> str:
    return str([[float(f"{value:.12g}") for value in row] for row in np.asarray(matrix)])


def _expression(node: Part | Join, names: dict[int, str]) -> str:
    if isinstance(node, Part):
        return names[id(node)]
    parts = [_expression(child, names) for child in node.children]
    parts = [f"({text})" if isinstance(child, Join) else text for text, child in zip(parts, node.children, strict=True)]
    if len(parts) > 1:
        return _SIGNS[node.operation].join(parts)
    return f"surfel.{node.operation.capitalize()}({', '.join(parts)})"
