"""Octree: space divided where there are surfels, down to a depth, as by Adams and Dutre; to compare the grid with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats, as_count
from surfel.core.errors import InputError
from surfel.inside.operand import Operand

DEEPEST = 20
"""A Morton key of three times so many bits fits an integer of 64."""


class Octree(NamedTuple):
    """Nodes in the order of their levels, the eight children of a node side by side.

    Parameters
    ----------
    low : Floats, shape (3,)
        The lowest corner, in the operand's coordinates.
    size : float
        Side of the root.
    depth : int
        The deepest level.
    row : NDArray[np.int64], shape (n,)
        The operand's row of each surfel, in the order of the nodes.
    first, last : NDArray[np.int64], shape (m,)
        Which of ``row`` lie in each node.
    child : NDArray[np.int64], shape (m,)
        The first child, -1 for a leaf.
    level : NDArray[np.int64], shape (m,)
        0 for the root.
    cell : NDArray[np.int64], shape (m, 3)
        Place of each node among those of its level.
    """

    low: Floats
    size: float
    depth: int
    row: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    child: NDArray[np.int64]
    level: NDArray[np.int64]
    cell: NDArray[np.int64]


def build_octree(operand: Operand, depth: int = 5, most: int = 1) -> Octree:
    """Divide the cube round a cloud wherever more than ``most`` surfels lie in a node, down to ``depth``.

    Parameters
    ----------
    operand : Operand
        The cloud, at least one surfel.
    depth : int
        1 to 20. Adams and Dutre, and Gaal, find 4 best for interaction, 5 from 100,000 surfels on.
    most : int
        A node with no more surfels than this is a leaf.

    Raises
    ------
    InputError
        If the cloud is empty, or a number out of range.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.octree import build_octree
    >>> from surfel.inside.operand import Operand
    >>> p = np.array([[0.1, 0.1, 0.1], [0.9, 0.9, 0.9]])
    >>> tree = build_octree(Operand.of(p, p), depth=3)
    >>> len(tree.first), tree.level.tolist()
    (9, [0, 1, 1, 1, 1, 1, 1, 1, 1])
    """
    deepest, few = as_count(depth, "depth", 1, DEEPEST), as_count(most, "most")
    if not len(operand):
        raise InputError("an octree needs at least one surfel; got none")
    low, high = operand.bounds
    size = float((high - low).max()) * 1.0001 or 1.0
    place = np.clip(((operand.points - low) * (2.0**deepest / size)).astype(np.int64), 0, 2**deepest - 1)
    key = _interleaved(place, deepest)
    row = np.argsort(key, kind="stable")
    key = key[row]

    begin, end, prefix = np.zeros(1, np.int64), np.full(1, len(key)), np.zeros(1, np.int64)
    place_of = np.zeros((1, 3), np.int64)
    firsts, lasts, cells, levels, children = [begin], [end], [place_of], [np.zeros(1, np.int64)], [np.full(1, -1)]
    total = 1
    for depth_now in range(deepest):
        divided = np.flatnonzero(end - begin > few)
        children[-1][divided] = total + 8 * np.arange(len(divided))
        if not len(divided):
            break
        below = (prefix[divided, None] << 3) | np.arange(8)
        shift = 3 * (deepest - depth_now - 1)
        begin = np.searchsorted(key, (below << shift).ravel())
        end = np.searchsorted(key, ((below + 1) << shift).ravel())
        octant = np.stack([np.arange(8) >> 2, (np.arange(8) >> 1) & 1, np.arange(8) & 1], axis=1)
        place_of = (2 * place_of[divided, None] + octant).reshape(-1, 3)
        prefix = below.ravel()
        firsts.append(begin)
        lasts.append(end)
        levels.append(np.full(len(prefix), depth_now + 1))
        cells.append(place_of)
        children.append(np.full(len(prefix), -1))
        total += len(prefix)
    join = np.concatenate
    return Octree(low, size, deepest, row, join(firsts), join(lasts), join(children), join(levels), join(cells))


def _interleaved(cell: NDArray[np.int64], bits: int) -> NDArray[np.int64]:
    """Return the Morton key of cells, x first."""
    key = np.zeros(len(cell), np.int64)
    for bit in range(bits - 1, -1, -1):
        for axis in range(3):
            key = (key << 1) | ((cell[:, axis] >> bit) & 1)
    return key
