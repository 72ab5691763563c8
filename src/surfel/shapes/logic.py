"""The logic of a tree as flat arrays: which leaf feeds which node, and how a change of one bit climbs to the root."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner
from surfel.core.errors import InputError
from surfel.shapes.base import Shape
from surfel.shapes.tree import Tree

Ints = NDArray[np.int32]


class Logic(NamedTuple):
    """A directed graph of leaves (items 0 to l - 1) and nodes (items l and up, children before parents).

    A node is true while at least ``need`` of its inputs are: one of a union, all of an intersection. A difference is an
    intersection whose further inputs are negated. The last node is the root.
    """

    offsets: Ints  # (items + 1,): the outputs of each item
    node: Ints  # (outputs,): the node that each feeds
    negated: NDArray[np.bool_]  # (outputs,)
    need: Ints  # (nodes,)
    inputs: Ints  # (nodes,): how many there are
    start: Ints  # (nodes,): how many are true while every leaf is false
    leaves: int
    table: np.uint64  # bit m: the root's value where leaf k is bit k of m; only for a few leaves


TABLED = 6
"""So many leaves have a truth table that fits a word of 64 bits, which is far quicker to ask than the nodes."""


def logic_of(postorder: list[Shape], leaves: tuple[Shape, ...]) -> Logic:
    """Flatten a tree given with its children before their parents."""
    item = {id(leaf): k for k, leaf in enumerate(leaves)}
    nodes = [node for node in postorder if isinstance(node, Tree)]
    item |= {id(node): len(leaves) + k for k, node in enumerate(nodes)}
    wires = [
        (item[id(child)], k, node.operation == "difference" and place > 0)
        for k, node in enumerate(nodes)
        for place, child in enumerate(node.children)
    ]
    wires.sort(key=lambda wire: wire[0])
    source = np.array([wire[0] for wire in wires], np.int64)
    offsets = np.searchsorted(source, np.arange(len(item) + 1)).astype(np.int32)
    inputs = np.array([len(node.children) for node in nodes], np.int32)
    need = np.array([1 if node.operation == "union" else len(node.children) for node in nodes], np.int32)
    start = np.array([len(node.children) - 1 if node.operation == "difference" else 0 for node in nodes], np.int32)
    # with all leaves false every union, intersection and difference is false, so only negated inputs count
    node = np.array([wire[1] for wire in wires], np.int32)
    negated = np.array([wire[2] for wire in wires], np.bool_)
    few = len(leaves) <= TABLED
    return Logic(
        offsets, node, negated, need, inputs, start, len(leaves), _table(nodes, item, leaves) if few else np.uint64(0)
    )


def _table(nodes: list[Tree], item: dict[int, int], leaves: tuple[Shape, ...]) -> np.uint64:
    """Return the truth table of the root over all sets of leaves."""
    every = 1 << len(leaves)
    inside = [sum(1 << m for m in range(every) if m >> k & 1) for k in range(len(leaves))]
    full = (1 << every) - 1
    for node in nodes:
        parts = [inside[item[id(child)]] for child in node.children]
        value = 0 if node.operation == "union" else parts[0]
        for part in parts if node.operation == "union" else parts[1:]:
            if node.operation == "union":
                value |= part
            else:
                value &= part if node.operation == "intersection" else full ^ part
        inside.append(value)
    return np.uint64(inside[-1])


def refuse_lost_sheets(logic: Logic, sheets: list[int]) -> None:
    """Refuse a tree that subtracts a sheet, or intersects two.

    Raises
    ------
    InputError
        If it does.
    """
    holds = np.zeros(len(logic.offsets) - 1, np.int64)  # how many sheets come in through each item
    holds[sheets] = 1
    for item in range(len(holds)):
        for wire in range(logic.offsets[item], logic.offsets[item + 1]):
            node = logic.node[wire]
            if not holds[item]:
                continue
            if logic.negated[wire]:
                raise InputError(
                    "a sheet (an open cloud or mesh) cannot be subtracted from anything: it has no inside; close it, "
                    "or say that it bounds a solid (cloud.with_solid(True))"
                )
            above = logic.leaves + node
            if holds[above] and logic.need[node] > 1:
                raise InputError("two sheets cannot be intersected: what they share is a curve; leave one out")
            holds[above] += 1


@inner
def set_leaf(offsets, node, negated, need, leaves, leaf, on, counts, stack, value):
    """Change the bit of a leaf, and what follows from it in every node above."""
    stack[0], value[0], top = leaf, on, 1
    while top > 0:
        top -= 1
        item, now_on = stack[top], value[top]
        for k in range(offsets[item], offsets[item + 1]):
            to = node[k]
            was = counts[to] >= need[to]
            counts[to] += 1 if now_on != negated[k] else -1
            now = counts[to] >= need[to]
            if was != now:
                stack[top], value[top] = to + leaves, now
                top += 1


@inner
def keeps_sheet(offsets, node, need, inputs, leaves, sheet, counts, stack):
    """Tell whether an element of a sheet survives: on some way to the root every intersection agrees.

    A sheet counts as false in the logic, so an intersection agrees if all its other inputs are true.
    """
    root = len(need) - 1
    stack[0], top = sheet, 1
    while top > 0:
        top -= 1
        item = stack[top]
        own = 1 if item >= leaves and counts[item - leaves] >= need[item - leaves] else 0
        for k in range(offsets[item], offsets[item + 1]):
            to = node[k]
            if need[to] > 1 and counts[to] - own < inputs[to] - 1:
                continue
            if to == root:
                return True
            stack[top] = to + leaves
            top += 1
    return False
