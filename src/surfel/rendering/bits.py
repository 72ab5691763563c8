"""The one rule of trees in three values: which surfels survive whatever a cut does, and which a cut may pass.

With the bits of the other leaves where it lies, an element of leaf i survives if ``tree(i = 0) != tree(i = 1)``. A
surfel that a surface may pass has a bit that is not known. The logic runs over arrays, node by node, so trees may have
any number of leaves.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from surfel.core.cast import Booleans
from surfel.shapes.base import Shape
from surfel.shapes.tree import Tree, postorder


class Bits(NamedTuple):
    """What is known of a leaf's bit at each place: whether it must be set, and whether it may be."""

    must: Booleans
    may: Booleans

    @classmethod
    def known(cls, value: Booleans) -> Bits:
        """Return bits that are known."""
        return cls(value, value)

    @classmethod
    def constant(cls, value: bool, count: int) -> Bits:
        """Return one known bit for all places."""
        return cls.known(np.full(count, value))


class Beside(NamedTuple):
    """What is known of another leaf's bit just below and above each surfel; they differ where surfaces coincide."""

    below: Bits
    above: Bits
    on: Booleans
    """Where they are known to coincide."""

    @classmethod
    def constant(cls, value: bool, count: int) -> Beside:
        """Return one known bit for all places."""
        bits = Bits.constant(value, count)
        return cls(bits, bits, np.zeros(count, np.bool_))


class Survival(NamedTuple):
    """Which elements of a leaf are kept for certain, and which perhaps: where a bit is not known."""

    surely: Booleans
    perhaps: Booleans


def survival(tree: Tree, leaf: Shape, beside: Mapping[int, Beside], count: int, *, sheet: bool) -> Survival:
    """Tell which of ``count`` elements of a leaf survive, from the bits of all other leaves, by the leaf's identity.

    A sheet has no bit of its own: its elements survive if on some way to the root every intersection agrees. Where
    surfaces coincide, the first of the leaves keeps its copy.
    """
    below = {name: bits.below for name, bits in beside.items()}
    above = {name: bits.above for name, bits in beside.items()}
    if sheet:
        return _passed_on(tree, leaf, _values(tree, {**below, id(leaf): Bits.constant(False, count)}))
    low = _values(tree, {**above, id(leaf): Bits.constant(False, count)})[id(tree)]
    high = _values(tree, {**below, id(leaf): Bits.constant(True, count)})[id(tree)]
    known = (low.must == low.may) & (high.must == high.may)
    lost = np.zeros(count, np.bool_)
    for other in tree.leaves:
        if other is leaf:
            break
        lost |= beside[id(other)].on
    return Survival(known & (low.must != high.must) & ~lost, ~known & ~lost)


def _values(tree: Tree, bits: Mapping[int, Bits]) -> dict[int, Bits]:
    """Return the value of every node."""
    values = dict(bits)
    for node in postorder(tree):
        if not isinstance(node, Tree):
            continue
        parts = [values[id(child)] for child in node.children]
        if node.operation == "difference":
            parts[1:] = [Bits(~part.may, ~part.must) for part in parts[1:]]
        if not parts:  # a union of nothing
            some = next(iter(bits.values()))
            values[id(node)] = Bits.constant(False, len(some.must))
        elif node.operation == "union":
            values[id(node)] = Bits(
                np.logical_or.reduce([p.must for p in parts]), np.logical_or.reduce([p.may for p in parts])
            )
        else:
            values[id(node)] = Bits(
                np.logical_and.reduce([p.must for p in parts]), np.logical_and.reduce([p.may for p in parts])
            )
    return values


def _passed_on(tree: Tree, leaf: Shape, values: Mapping[int, Bits]) -> Survival:
    """Follow a sheet to the root: a union passes it on; an intersection where all its other inputs are true."""
    carried: dict[int, Bits] = {id(leaf): Bits.known(np.ones(len(values[id(tree)].must), np.bool_))}
    nowhere = Bits.known(np.zeros(len(values[id(tree)].must), np.bool_))
    for node in postorder(tree):
        if not isinstance(node, Tree):
            continue
        must, may = nowhere
        for place, child in enumerate(node.children):
            here = carried.get(id(child))
            if here is None or (node.operation == "difference" and place > 0):
                continue
            others = Bits(*here)
            for k, other in enumerate(node.children):
                if k == place or node.operation == "union":
                    continue
                bit = values[id(other)]
                if node.operation == "difference" and k > 0:
                    bit = Bits(~bit.may, ~bit.must)
                others = Bits(others.must & bit.must, others.may & bit.may)
            must, may = must | others.must, may | others.may
        carried[id(node)] = Bits(must, may)
    root = carried[id(tree)]
    return Survival(root.must, root.may & ~root.must)
