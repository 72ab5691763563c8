"""Statements of a ``.csg`` file to a tree of solids, without recursion: matrices go down to the leaves."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.io.csg_parse import Fail, Statement
from surfel.io.csg_solids import ARGUMENTS, SOLIDS, ArgumentError, bound, matrix_of, solid_of
from surfel.shapes.base import Shape
from surfel.shapes.tree import Difference, Intersection, Tree, Union

MOST_LEAVES = 100_000
"""More leaves than this out of imported trees are refused: a few files that import each other could give any number."""

_FLAT = (".dxf", ".svg")

Import = Callable[[str, int], Shape]
"""Called with the name of a file and the place of its import; returns its shape."""


@dataclass(slots=True, eq=False)
class _Work:
    """A statement on its way: where it stands, what has been built of its children."""

    statement: Statement
    matrix: Floats
    specials: dict[str, Any]
    parent: _Work | None
    built: list[Shape | None] = field(default_factory=list)
    opened: bool = False


def build(root: Statement, facets: str, import_file: Import, fail: Fail) -> Shape:
    """Return the tree that the statements of a file describe; the empty union where they describe nothing.

    Parameters
    ----------
    root : Statement
        The file.
    facets : {"auto", "exact", "as written"}
        Whether circles are exact.
    import_file : callable
        Reads what ``import()`` names.
    fail : callable
        Told what is wrong, where, and the cure; raises.
    """
    builder = _Builder(facets, import_file, fail)
    shape = builder.run(_marked_root(root) or root)
    return Union() if shape is None else shape


class _Builder:
    def __init__(self, facets: str, import_file: Import, fail: Fail) -> None:
        self.facets, self.import_file, self.fail = facets, import_file, fail
        self.leaves = 0

    def run(self, root: Statement) -> Shape | None:
        top = _Work(Statement("group", root.place), np.eye(4), dict(root.specials if not root.name else {}), None)
        start = root.children if not root.name else [root]
        todo = [_Work(child, top.matrix, top.specials, top) for child in reversed(start)]
        while todo:
            work = todo.pop()
            if work.opened:
                _hand_on(work, _combined(work.statement.name, work.built))
            elif self.open(work):
                todo.append(work)  # again, below its children
                todo.extend(_Work(c, work.matrix, work.specials, work) for c in reversed(work.statement.children))
        return _combined("union", top.built)

    def open(self, work: _Work) -> bool:
        """Build what needs no children; tell whether the statement waits for them."""
        statement = work.statement
        name = statement.name
        if "*" in statement.modifiers or "%" in statement.modifiers:
            return False  # switched off or background: as if it were not there
        try:
            if name not in ARGUMENTS:
                self.unsupported(statement)
            if name in SOLIDS:
                self.leaf(work, solid_of(statement, work.specials, self.facets))
            elif name == "import":
                self.leaf(work, (self.imported(statement), None))
            else:
                return self.container(work)
        except (ArgumentError, InputError) as error:
            self.fail(f"{name}(): {error}", statement.place, "mend that line")
        return False

    def container(self, work: _Work) -> bool:
        statement = work.statement
        if statement.name == "multmatrix":
            own = matrix_of(statement)
            if own is None:  # flat: nothing is left of its children
                _hand_on(work, None)
                return False
            work.matrix = work.matrix @ own
        else:
            bound(statement)
        given = {key: value for key, value in statement.named.items() if key.startswith("$")}
        if given or statement.specials:
            work.specials = work.specials | given | statement.specials
        work.opened = True
        return True

    def leaf(self, work: _Work, placed: tuple[Shape, Floats | None] | None) -> None:
        if placed is None:
            _hand_on(work, None)
            return
        shape, own = placed
        self.leaves += len(shape.leaves) if isinstance(shape, Tree) else 0
        if self.leaves > MOST_LEAVES:
            problem = f"more than {MOST_LEAVES:,} solids are imported"
            self.fail(problem, work.statement.place, "import fewer files, or meshes of them")
        matrix = work.matrix if own is None else work.matrix @ own
        if isinstance(shape, Tree) and not shape.leaves:
            _hand_on(work, None)
        elif np.array_equal(matrix, np.eye(4)):
            _hand_on(work, shape)
        else:
            _hand_on(work, shape.transformed(matrix))

    def imported(self, statement: Statement) -> Shape:
        given = bound(statement)
        name = given.get("file", given.get("filename"))
        if not isinstance(name, str) or not name:
            raise ArgumentError("file must name a file")
        if given.get("center") or given.get("scale") not in (None, 1.0):
            raise ArgumentError("center and scale of an import are not supported; move it by a multmatrix")
        if os.path.splitext(name)[1].lower() in _FLAT:
            raise ArgumentError(f"{name!r} is flat, and flat shapes are not supported")
        return self.import_file(name, statement.place)

    def unsupported(self, statement: Statement) -> NoReturn:
        self.fail(
            f"{statement.name}() is not supported, only {', '.join(sorted(ARGUMENTS))}",
            statement.place,
            'in OpenSCAD export what it makes as a mesh, and put import("part.stl") in its place',
        )


def _hand_on(work: _Work, shape: Shape | None) -> None:
    assert work.parent is not None
    work.parent.built.append(shape)


def _combined(name: str, built: list[Shape | None]) -> Shape | None:
    """Join what was built of the children of a statement; None stands for what is empty.

    As in OpenSCAD the empty child of a union adds nothing, an intersection with something empty is empty, and so is a
    difference from something empty.
    """
    some = [shape for shape in built if shape is not None]
    if name == "difference":
        return _difference(some) if built and built[0] is not None else None
    if name == "intersection":
        return _joined(Intersection, some) if len(some) == len(built) else None
    return _joined(Union, some)


def _difference(shapes: list[Shape]) -> Shape:
    first, *others = shapes
    if not others:
        return first
    head = first.children if type(first) is Difference else (first,)
    return Difference(*head, *others)


def _joined(operation: type[Union] | type[Intersection], shapes: list[Shape]) -> Shape | None:
    """Apply an operation whose operands may be taken in any grouping: nested ones become one."""
    flat = [part for shape in shapes for part in (shape.children if type(shape) is operation else (shape,))]
    return flat[0] if len(flat) == 1 else operation(*flat) if flat else None


def _marked_root(root: Statement) -> Statement | None:
    """Return the first statement that is marked with ``!``: it stands for the whole file, without what is round it."""
    todo = [root]
    while todo:
        statement = todo.pop()
        if "!" in statement.modifiers:
            return statement
        if "*" not in statement.modifiers:
            todo.extend(reversed(statement.children))
    return None
