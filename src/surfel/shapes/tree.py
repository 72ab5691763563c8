"""Trees: Boolean expressions over shapes, by ``| & -`` or by Union, Intersection and Difference."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.affine import as_affine
from surfel.core.cast import Floats, read_only
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.core.patches import Patches
from surfel.shapes.base import Shape

if TYPE_CHECKING:
    from surfel.shapes.program import Program


class Tree(Shape):
    """A Boolean expression, evaluated by what reads it; nothing is built before.

    Booleans are regularised: faces that coincide are faces of the result only where they part inside from outside, and
    count once. A sheet (an open cloud or mesh) keeps its part inside of an intersection and outside of what is
    subtracted from it; joined to anything it is kept whole. It cannot itself be subtracted.

    Parameters
    ----------
    *shapes : Shape
        The operands. One object used twice is one leaf.

    Raises
    ------
    InputError
        If an operand is no shape.
    """

    operation: ClassVar[str]

    def __init__(self, *shapes: Shape) -> None:
        for shape in shapes:
            if not isinstance(shape, Shape):
                raise InputError(
                    f"{self.operation} takes shapes; got {type(shape).__name__}"
                    + ("; wrap points as surfel.Surfels(points)" if isinstance(shape, np.ndarray) else "")
                )
        self._children = shapes

    @classmethod
    def joining(cls, first: Shape, other: Shape) -> Self:
        """Combine two operands; what is already such an expression takes the other one in."""
        if not isinstance(other, Shape):
            return NotImplemented
        head = first._children if type(first) is cls else (first,)
        tail = other._children if type(other) is cls and cls.operation != "difference" else (other,)
        fixed = 1 if cls.operation == "difference" else 0
        rest = {id(shape): shape for shape in (*head[fixed:], *tail)}  # a second time a shape changes nothing
        return cls(*head[:fixed], *rest.values())

    @property
    def children(self) -> tuple[Shape, ...]:
        """The operands, in order."""
        return self._children

    @cached_property
    def leaves(self) -> tuple[Shape, ...]:
        """The distinct shapes that are no trees, in the order in which they first occur."""
        return tuple(node for node in postorder(self) if not isinstance(node, Tree))

    @cached_property
    def program(self) -> Program:
        """The tree as flat arrays for the kernels, made on first use."""
        from surfel.shapes.program import program_of

        return program_of(self)

    @cached_property
    def bounds(self) -> Floats:
        """The lowest and the highest corner of an axis-aligned box round the tree, shape (2, 3).

        Infinite where the tree is not bounded; zeros where it is empty.
        """
        from surfel.shapes.extent import extent_of

        return read_only(extent_of(self))

    def transformed(self, matrix: ArrayLike) -> Tree:
        """Return the tree under an affine map, shape (4, 4): the same expression over moved leaves."""
        affine = as_affine(matrix)
        moved = {id(leaf): leaf.transformed(affine) for leaf in self.leaves}
        return rebuilt(self, moved)

    def _hull(self) -> tuple[Floats, float]:
        from surfel.shapes.extent import hull_of

        return hull_of(self)

    def _cross(self, lines: Lines) -> Crossings:
        return self.program.cross(lines)

    def _sheets(self, crossings: Crossings) -> Crossings:
        from surfel.shapes.program import events_of

        return events_of(crossings)

    def _patches(self, n: int) -> Patches:
        from surfel.shapes.elements import kept_elements

        return kept_elements(self, n)

    def _contains(self, points: Floats) -> NDArray[np.bool_]:
        return self.program.contains(points)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self._children)} operands, {len(self.leaves)} leaves)"

    def __getstate__(self) -> dict[str, object]:
        return {"_children": self._children}


class Union(Tree):
    """What lies in any of the operands; of none, the empty solid.

    Examples
    --------
    >>> import surfel
    >>> two = surfel.Union(surfel.Box(2), surfel.Box(2).translated((1, 0, 0)))
    >>> abs(surfel.measure(two).area.value / 32 - 1) < 1e-3
    True
    """

    operation = "union"


class Intersection(Tree):
    """What lies in all of the operands.

    Examples
    --------
    >>> import surfel
    >>> lens = surfel.Intersection(surfel.Sphere(1), surfel.HalfSpace((0, 0, 1), 0))
    >>> abs(surfel.measure(lens).area.value / 9.42477796 - 1) < 1e-3
    True
    """

    operation = "intersection"

    def __init__(self, *shapes: Shape) -> None:
        if not shapes:
            raise InputError("an intersection needs at least one operand: that of none would be all of space")
        super().__init__(*shapes)


class Difference(Tree):
    """What lies in the first operand and in none of the others.

    Examples
    --------
    >>> import surfel
    >>> skeleton = surfel.Difference(surfel.Box(20), surfel.Sphere(13))
    >>> abs(surfel.measure(skeleton).area.value / 1752.83 - 1) < 2e-3
    True
    """

    operation = "difference"

    def __init__(self, *shapes: Shape) -> None:
        if not shapes:
            raise InputError("a difference needs at least one operand, from which the others are taken")
        super().__init__(*shapes)


def postorder(root: Shape) -> list[Shape]:
    """Return a shape and all below it, each once and children first, without recursion: trees may be very deep."""
    order: list[Shape] = []
    seen: set[int] = set()
    todo: list[tuple[Shape, bool]] = [(root, False)]
    while todo:
        node, children_done = todo.pop()
        if children_done:
            order.append(node)
        elif id(node) not in seen:
            seen.add(id(node))
            todo.append((node, True))
            if isinstance(node, Tree):
                todo.extend((child, False) for child in reversed(node.children))
    return order


def rebuilt(root: Tree, leaves: dict[int, Shape]) -> Tree:
    """Return the same expression over other leaves, given by the identity of those that they replace."""
    done: dict[int, Shape] = dict(leaves)
    for node in postorder(root):
        if isinstance(node, Tree):
            done[id(node)] = type(node)(*(done[id(child)] for child in node.children))
    result = done[id(root)]
    assert isinstance(result, Tree)
    return result
