"""Trees as expressions over implicit functions: planes, quadrics and tori.

A convex primitive is an intersection of half-spaces and at most one quadric, whatever affine map it stands under. A
point is inside of a function where its value is negative. Equal planes and quadrics are one function, and opposite
planes are each other's complements, so that faces that coincide are told apart by logic and not by rounding.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.measuring.baselines.functions import PLANE, QUADRIC, TORUS, WIDTH
from surfel.shapes.base import Shape
from surfel.shapes.placed import Placed
from surfel.shapes.tree import Tree

AND, OR = -1, -2
"""Tokens of an expression in reverse Polish notation; a function f is 2 f, its complement 2 f + 1."""

_SAME = 1e-9  # of the size: functions nearer than this are one


class Implicit(NamedTuple):
    """An expression: its functions (n, 16) and its tokens; no tokens where the shape is empty."""

    functions: Floats
    tokens: NDArray[np.int64]


def implicit_of(shape: Shape) -> Implicit:
    """Return the expression of a tree.

    Raises
    ------
    InputError
        If a leaf has no implicit function here: a cloud, a mesh, a cyclide, a polynomial.
    """
    functions = _Functions(shape)
    tokens: list[int] = []
    todo: list[tuple[Any, bool]] = [(shape, False)]  # shapes still to be written, or tokens; and whether negated
    while todo:
        node, negated = todo.pop()
        if isinstance(node, int):
            tokens.append(node)
        elif isinstance(node, Tree) and node.children:
            todo.extend(reversed(_parts(node, negated)))
        else:
            tokens.extend(_literals(functions.of(node), negated))
    return Implicit(functions.table(), np.array(tokens, np.int64))


def _parts(node: Tree, negated: bool) -> list[tuple[Any, bool]]:
    """Return the operands of a node with an operation behind each but the first; De Morgan moves negations down."""
    conjunction = (node.operation != "union") != negated
    parts: list[tuple[Any, bool]] = []
    for k, child in enumerate(node.children):
        parts.append((child, negated != (node.operation == "difference" and k > 0)))
        if k > 0:
            parts.append((AND if conjunction else OR, False))
    return parts


def _literals(functions: list[int], negated: bool) -> list[int]:
    tokens = []
    for k, function in enumerate(functions):
        tokens.append(function ^ 1 if negated else function)
        if k > 0:
            tokens.append(OR if negated else AND)
    return tokens


class _Functions:
    """The distinct functions met so far."""

    def __init__(self, shape: Shape) -> None:
        bounds = np.asarray(shape.bounds)
        if not np.isfinite(bounds).all():
            raise InputError("the shape is unbounded; intersect it with a box")
        self.centre = bounds.mean(axis=0)
        self.size = float(np.abs(bounds - self.centre).max()) or 1.0
        self.rows: list[Floats] = []
        self.known: dict[tuple[float, ...], int] = {}

    def table(self) -> Floats:
        return np.array(self.rows).reshape(-1, WIDTH)

    def of(self, leaf: Shape) -> list[int]:
        """Return the tokens of the functions of a leaf, to be joined by AND."""
        if isinstance(leaf, Tree):  # the empty one: positive everywhere
            row = np.zeros(WIDTH)
            row[4] = -1.0
            return [self.token(row, ())]
        matrix = leaf.matrix if isinstance(leaf, Placed) else np.eye(4)
        own: Any = leaf.shape if isinstance(leaf, Placed) else leaf
        convex = own._convex() if hasattr(own, "_convex") else None
        if convex is not None:
            form, placement = convex
            return self.convex(np.asarray(form, float), matrix @ placement)
        name = type(own).__name__
        if name == "Quadric":
            return [self.quadric(np.asarray(own.matrix, float), matrix)]
        if name == "Torus":
            row = np.zeros(WIDTH)
            row[0], row[1:13] = TORUS, np.linalg.inv(matrix)[:3].ravel()
            row[13:15] = own.major, own.minor
            return [self.token(row, tuple(np.round(row, 12)))]
        raise InputError(f"a {name} has no implicit function for this method; measure it by lines")

    def convex(self, form: Floats, matrix: Floats) -> list[int]:
        inverse = np.linalg.inv(matrix)
        found = []
        for axis in range(3):
            along, start = inverse[axis, :3], inverse[axis, 3]
            for sign, end in ((-1.0, form[axis]), (1.0, form[3 + axis])):
                if math.isfinite(end):
                    found.append(self.plane(sign * along, sign * (end - start)))
        if form[6:].any():
            a, b, c, d, e = form[6:]
            local = np.diag([a, b, c, e])
            local[2, 3] = local[3, 2] = 0.5 * d
            found.append(self.quadric(local, matrix))
        return found

    def plane(self, normal: Any, offset: float) -> int:
        length = float(np.linalg.norm(normal))
        normal, offset = normal / length, offset / length
        key = (*np.round(normal, 9), round((offset - float(normal @ self.centre)) / self.size / _SAME))
        opposite = (*np.round(-normal, 9), -key[3])
        if opposite in self.known:
            return self.known[opposite] ^ 1
        row = np.zeros(WIDTH)
        row[0], row[1:4], row[4] = PLANE, normal, offset
        return self.token(row, tuple(float(k) + 0.0 for k in key))

    def quadric(self, local: Floats, matrix: Floats) -> int:
        """Take over a quadric x^T Q x <= 0 that stands under a matrix, about where the matrix moves the origin."""
        centre = matrix[:3, 3]
        turn = np.linalg.inv(matrix[:3, :3])
        square = turn.T @ local[:3, :3] @ turn
        linear = 2.0 * local[:3, 3] @ turn
        square = 0.5 * (square + square.T)
        scale = max(float(np.abs(square).max()), float(np.abs(linear).max()) / self.size)
        row = np.zeros(WIDTH)
        row[0] = QUADRIC
        row[1:4] = np.diag(square)
        row[4:7] = 2.0 * square[0, 1], 2.0 * square[0, 2], 2.0 * square[1, 2]
        row[7:10], row[10] = linear, local[3, 3]
        row[1:11] /= scale or 1.0
        row[11:14] = centre
        return self.token(row, (QUADRIC, *_about(row, self.centre, self.size)))

    def token(self, row: Floats, key: tuple[float, ...]) -> int:
        if key not in self.known:
            self.known[key] = 2 * len(self.rows)
            self.rows.append(row)
        return self.known[key]


def _about(row: Floats, centre: Floats, size: float) -> list[float]:
    """Return rounded coefficients of a quadric about the middle of the tree, in units of its size: equal if it is."""
    square = np.diag(row[1:4])
    square[0, 1] = square[1, 0] = 0.5 * row[4]
    square[0, 2] = square[2, 0] = 0.5 * row[5]
    square[1, 2] = square[2, 1] = 0.5 * row[6]
    offset = centre - row[11:14]
    linear = (row[7:10] + 2.0 * square @ offset) / size
    constant = (row[10] + row[7:10] @ offset + offset @ square @ offset) / size**2
    return [float(k) + 0.0 for k in np.round([*row[1:7], *linear, constant], 9)]
