"""Stage: solids that can be moved and combined anew; it knows nothing of browsers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from surfel.core.affine import as_affine
from surfel.core.cast import Floats, as_choice, read_only
from surfel.core.errors import InputError
from surfel.rendering.shown import as_shapes
from surfel.shapes.base import Shape
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Difference, Intersection, Tree, Union

OPERATIONS: dict[str, type[Tree]] = {"union": Union, "intersection": Intersection, "difference": Difference}


@dataclass(eq=False)
class Part:
    """A solid on the stage: what it is, and how it was moved."""

    name: str
    shape: Shape
    pose: Floats = field(default_factory=lambda: np.eye(4))
    _moved: tuple[Floats, Shape] | None = field(default=None, init=False, repr=False)

    @property
    def moved(self) -> Shape:
        """The shape where it is now; the same object until it is moved again, so that what was learnt of it is kept."""
        if np.array_equal(self.pose, np.eye(4)):
            return self.shape
        if self._moved is None or self._moved[0] is not self.pose:
            self._moved = (self.pose, self.shape.transformed(self.pose))
        return self._moved[1]


@dataclass(eq=False)
class Join:
    """A node of the expression: an operation over parts and other nodes."""

    operation: str
    children: list[Part | Join]

    def parts(self) -> Iterator[Part]:
        """Return the parts below, from left to right; one that occurs twice comes twice."""
        for child in self.children:
            yield from child.parts() if isinstance(child, Join) else [child]


class Stage:
    """Parts, how they are joined, and where each of them is.

    Parameters
    ----------
    shapes : Shape or iterable of Shape
        A tree, of which every leaf becomes a part; a leaf; or several of these, joined one after the other.
    names : sequence of str, optional
        What the parts are called, from left to right; by default, and where empty, by their kind.

    Raises
    ------
    InputError
        If something is no shape, or there is none.
    """

    def __init__(self, shapes: Any, names: Iterable[str] = ()) -> None:
        self.parts: list[Part] = []
        self.root: Part | Join | None = None
        self._known: dict[int, Part] = {}
        self._tree: tuple[tuple[object, ...], Shape] | None = None
        given = iter(names)
        for shape in as_shapes(shapes):
            self.add(shape, given)
        if self.root is None:
            raise InputError("there is nothing to see: give a shape, a tree of shapes, or several of them")

    def add(self, shape: Shape, names: Iterable[str] = (), operation: str = "union") -> None:
        """Join one more shape to what is there; its new parts take the next names."""
        added = self._taken(shape, iter(names))
        self.root = added if self.root is None else Join(_operation(operation), [self.root, added])

    @property
    def joins(self) -> list[Join]:
        """The nodes of the expression, outermost first."""
        found: list[Join] = []
        waiting = [self.root]
        while waiting:
            node = waiting.pop()
            if isinstance(node, Join):
                found.append(node)
                waiting += reversed(node.children)
        return found

    def switch(self, number: int, operation: str) -> None:
        """Change the operation of a node."""
        self.joins[number].operation = _operation(operation)

    def move(self, number: int, pose: ArrayLike) -> None:
        """Put a part where a rigid motion takes it from where it came."""
        self.parts[number].pose = read_only(as_affine(pose).copy())

    def tree(self) -> Shape:
        """Return the expression as it stands, every part where it is now; the same object until something changes."""
        moved = {id(part): part.moved for part in self.parts}
        state = (*map(id, moved.values()), *(join.operation for join in self.joins))
        if self._tree is None or self._tree[0] != state:
            self._tree = (state, self._built(moved))
        return self._tree[1]

    def bare(self) -> Shape:
        """Return the expression over the parts as they came: its logic, whatever was moved."""
        return self._built({id(part): part.shape for part in self.parts})

    def _built(self, shapes: dict[int, Shape]) -> Shape:
        def build(node: Part | Join) -> Shape:
            if isinstance(node, Part):
                return shapes[id(node)]
            return OPERATIONS[node.operation](*(build(child) for child in node.children))

        assert self.root is not None
        return build(self.root)

    def _taken(self, shape: Shape, names: Iterator[str]) -> Part | Join:
        """Turn a tree into nodes and its leaves into parts; a leaf that occurs twice is one part."""
        if isinstance(shape, Tree):
            return Join(shape.operation, [self._taken(child, names) for child in shape.children])
        if id(shape) not in self._known:
            self._known[id(shape)] = Part(self._free(next(names, "") or _kind(shape)), shape)
            self.parts.append(self._known[id(shape)])
        return self._known[id(shape)]

    def _free(self, name: str) -> str:
        taken = {part.name for part in self.parts}
        if name not in taken:
            return name
        return next(f"{name} {k}" for k in range(2, len(taken) + 3) if f"{name} {k}" not in taken)


def _operation(name: str) -> str:
    return as_choice(name, "operation", tuple(OPERATIONS))


def _kind(shape: Shape) -> str:
    inner = getattr(shape, "shape", shape)
    return "cloud" if isinstance(inner, Surfels) else type(inner).__name__.lower()
