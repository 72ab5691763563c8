"""Sides: what lies on the inner and on the outer side of a surfel, two bits for each leaf, and what follows for a tree.

Bit 0 tells whether the place just below the surfel (against its normal) is inside a leaf, bit 1 whether the place just
above it is. A surfel of leaf i itself has :data:`SAME` there. So one evaluation of the tree, bit by bit, says
everything: :data:`SAME` at the root keeps the surfel, :data:`OPPOSED` keeps it turned over, the rest drops it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.errors import InputError
from surfel.shapes.base import Shape
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree, postorder

OUT, SAME, OPPOSED, IN = 0, 1, 2, 3
"""Outside, on the surface facing the same way, on it facing the other way, and inside."""

Sides = NDArray[Any] | int
"""Sides of many surfels, or one number for them all."""

FROM_KIND = np.array([OUT, IN, SAME, OPPOSED], np.uint8)
"""Sides for each of the kinds of :mod:`surfel.inside.classes`."""


class Rule:
    """The one rule for trees.

    Parameters
    ----------
    tree : Tree
        The expression.
    sheets : set of int
        The leaves that have no inside.

    Raises
    ------
    InputError
        If a sheet is subtracted, or two are intersected.
    """

    def __init__(self, tree: Tree, sheets: set[int]) -> None:
        self.sheets = sheets
        self._leaf = {id(leaf): k for k, leaf in enumerate(tree.leaves)}
        self._order = postorder(tree)
        self._root = id(tree)
        if sheets:
            from surfel.shapes.logic import logic_of, refuse_lost_sheets

            refuse_lost_sheets(logic_of(self._order, tree.leaves), sorted(sheets))

    def keeps(self, leaf: int, sides: dict[int, Sides], count: int) -> NDArray[np.int8]:
        """Tell which surfels of a leaf survive: 1, turned over -1, else 0.

        Where surfaces coincide, the first of the leaves keeps its copy.

        Parameters
        ----------
        leaf : int
            Whose surfels they are.
        sides : dict of int to Sides
            Of the surfels, for each other leaf that they are not all outside of.
        count : int
            How many surfels there are.
        """
        if leaf in self.sheets:
            return np.array(np.broadcast_to(self._sheet_survives(leaf, sides), count), np.int8)
        value = self._value({**sides, leaf: SAME})
        kept = np.zeros(count, np.int8)
        kept[np.broadcast_to(np.asarray(value == SAME), count)] = 1
        kept[np.broadcast_to(np.asarray(value == OPPOSED), count)] = -1
        for k, there in sides.items():
            if k < leaf and k not in self.sheets:
                kept[np.broadcast_to((np.asarray(there) == SAME) | (np.asarray(there) == OPPOSED), count)] = 0
        return kept

    def _value(self, sides: dict[int, Sides]) -> Sides:
        """Return the sides of the root."""
        return self._values(sides)[self._root]

    def _values(self, sides: dict[int, Sides]) -> dict[int, Sides]:
        values: dict[int, Sides] = {}
        for node in self._order:
            if not isinstance(node, Tree):
                k = self._leaf[id(node)]
                values[id(node)] = OUT if k in self.sheets else sides.get(k, OUT)
                continue
            parts = [values[id(child)] for child in node.children]
            value: Sides = OUT if node.operation == "union" else parts[0]
            for part in parts if node.operation == "union" else parts[1:]:
                if node.operation == "union":
                    value = value | part
                else:
                    value = value & (part if node.operation == "intersection" else part ^ IN)
            values[id(node)] = value
        return values

    def _sheet_survives(self, leaf: int, sides: dict[int, Sides]) -> NDArray[np.bool_]:
        """Tell which elements of a sheet survive: on some way to the root every intersection agrees."""
        values = self._values(sides)
        survives: dict[int, NDArray[np.bool_]] = {}
        no = np.zeros((), bool)
        for node in self._order:
            if not isinstance(node, Tree):
                survives[id(node)] = np.array(self._leaf[id(node)] == leaf)
                continue
            found = no
            for child in node.children:
                here = survives[id(child)]
                if not here.any():
                    continue
                if node.operation != "union":
                    here = here & _others_agree(node, child, values)
                found = found | here
            survives[id(node)] = found
        return survives[self._root]


def _others_agree(node: Tree, child: Shape, values: dict[int, Sides]) -> NDArray[np.bool_]:
    """Tell where all other inputs of an intersection are true, and all that is subtracted is false."""
    agree = np.ones((), bool)
    for place, other in enumerate(node.children):
        if other is not child:
            true = (np.asarray(values[id(other)]) & SAME) != 0
            agree = agree & (~true if node.operation == "difference" and place > 0 else true)
    return agree


def as_tree(shape: Shape) -> Tree:
    """Return a tree; a lone leaf as a union of one.

    Raises
    ------
    InputError
        If it is no shape.
    """
    from surfel.shapes.tree import Union

    if not isinstance(shape, Shape):
        raise InputError(
            f"combine takes an expression over shapes, like a - b; got {type(shape).__name__}"
            + ("; wrap points as surfel.Surfels(points)" if isinstance(shape, np.ndarray) else "")
        )
    return shape if isinstance(shape, Tree) else Union(shape)


def is_sheet(leaf: Shape) -> bool:
    """Tell whether a leaf has no inside: a cloud only where that was said of it."""
    return leaf.solid is False if isinstance(leaf, Surfels) else leaf._is_sheet()
