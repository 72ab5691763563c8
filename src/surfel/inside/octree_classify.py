"""Classifying by a coloured octree as published: places by their leaf and its two planes, clouds node against node."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import inner, kernel, rows, threads_for
from surfel.core.cast import Booleans, Floats, as_choice
from surfel.inside.grid import BORDER, IN, OUT
from surfel.inside.judges import named
from surfel.inside.moved import rigid
from surfel.inside.octree import Octree, build_octree
from surfel.inside.octree_colour import UNKNOWN, colour_by_flood, colour_per_level, leaf_at
from surfel.inside.operand import Operand

COLOURINGS = ("per-level", "flood", "flood-faces")
_STACK = 1024


class NodeTests(NamedTuple):
    """What node against node found for the surfels of the other cloud, in its sorted order, and what it took.

    Parameters
    ----------
    inside : Booleans, shape (n,)
        Which surfels are inside.
    whole : float
        Share of the surfels that were settled with their node.
    tests : int
        How many nodes were tested against the octree.
    """

    inside: Booleans
    whole: float
    tests: int


class OctreeClassifier:
    """The published way to tell what is inside a cloud, to compare :class:`surfel.inside.classify.Classifier` with.

    Parameters
    ----------
    operand : Operand
        The cloud, at least one surfel. Its normals are believed; nothing is repaired.
    depth : int
        Of the octree.
    colouring : str
        ``per-level`` (sec. 6.1), ``flood`` (sec. 6.2), or ``flood-faces``, which looks for neighbours all over a face.
    slabs : bool
        Divide border leaves by two planes round their surfels; wrong at edges, for nothing guards them.

    Raises
    ------
    InputError
        If the cloud is empty or an argument is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.octree_classify import OctreeClassifier
    >>> from surfel.inside.operand import Operand
    >>> p = np.random.default_rng(0).standard_normal((2000, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> OctreeClassifier(Operand.of(p, p), depth=4).classify([[0.0, 0.0, 0.5], [0.0, 0.0, 1.5]]).tolist()
    [True, False]
    """

    def __init__(self, operand: Operand, depth: int = 5, colouring: str = "per-level", slabs: bool = True) -> None:
        how = as_choice(colouring, "colouring", COLOURINGS)
        self.operand = operand
        self.tree: Octree = build_octree(operand, depth)
        if how == "per-level":
            self.colours = colour_per_level(self.tree, operand)
        else:
            self.colours = colour_by_flood(self.tree, operand, every_face=how == "flood-faces")
        self._slabs = two_plane_slabs(self.tree, operand) if slabs else np.empty((0, 5))

    def classify(self, queries: ArrayLike) -> Booleans:
        """Tell which places, shape (q, 3) in the coordinates of the cloud, are inside.

        Raises
        ------
        InputError
            If the queries are not finite rows of three.
        """
        places = self.operand.local(queries)
        kind = np.empty(len(places), np.int8)
        with threads_for(len(places)):
            _locate(len(places), places, *_of_tree(self.tree), self.colours, self._slabs, kind)
        return self._judge(kind, places)

    def classify_nodes(self, other: Octree, cloud: Operand, pose: ArrayLike | None = None) -> NodeTests:
        """Tell which surfels of another cloud are inside, testing the nodes of its octree against this one.

        A node that meets only inside leaves, or only outside ones, is settled whole; the surfels of the others are
        looked at one by one. A turned node is tested by its upright box.

        Parameters
        ----------
        other : Octree
            Of the other cloud.
        cloud : Operand
            The other cloud.
        pose : array_like, shape (4, 4), optional
            A rigid motion under which it is taken.

        Raises
        ------
        InputError
            If the pose is not rigid.
        """
        motion = rigid(pose)[:3].copy()
        motion[:, 3] += motion[:, :3] @ cloud.origin - self.operand.origin
        kind = np.full(len(cloud), UNKNOWN, np.int8)
        tests, whole = _test_nodes(*_of_tree(self.tree), self.colours, *other, motion, kind)
        left = np.flatnonzero(kind == UNKNOWN)
        places = cloud.points[left] @ motion[:, :3].T + motion[:, 3]
        near = np.empty(len(left), np.int8)
        with threads_for(len(left)):
            _locate(len(left), places, *_of_tree(self.tree), self.colours, self._slabs, near)
        inside = kind == IN
        inside[left] = self._judge(near, places)
        return NodeTests(inside, whole / max(len(cloud), 1), int(tests))

    def _judge(self, kind: NDArray[np.int8], places: Floats) -> Booleans:
        """Let the nearest surfel decide what the octree does not."""
        inside = kind == IN
        left = np.flatnonzero(kind >= BORDER)
        inside[left] = named("nearest")(self.operand, places[left] + self.operand.origin).inside
        return np.asarray(inside)


def two_plane_slabs(tree: Octree, operand: Operand) -> Floats:
    """Return normal, lower and upper plane of each leaf that holds surfels, shape (m, 5) (Gaal, sec. 6.1).

    ``n = sum n_s / |sum n_s|``, ``d_1 = min n . x_s``, ``d_2 = max n . x_s``. Nothing guards them: where a leaf holds
    an edge, or a part of the surface that no centre of a surfel lies on, up to 28 % of the places are wrong.
    """
    slabs = np.zeros((len(tree.child), 5))
    slabs[:, 3], slabs[:, 4] = -np.inf, np.inf
    _span(tree.row, tree.first, tree.last, tree.child, operand.points, operand.normals, slabs)
    return slabs


def _of_tree(tree: Octree) -> tuple[Floats, float, int, NDArray[np.int64], NDArray[np.int64]]:
    return tree.low, tree.size, tree.depth, tree.child, tree.level


@kernel
def _span(row, first, last, child, points, normals, slabs):
    for node in range(len(child)):
        if child[node] >= 0 or last[node] == first[node]:
            continue
        nx = ny = nz = 0.0
        for n in range(first[node], last[node]):
            nx, ny, nz = nx + normals[row[n], 0], ny + normals[row[n], 1], nz + normals[row[n], 2]
        length = (nx * nx + ny * ny + nz * nz) ** 0.5
        if length == 0.0:
            continue
        nx, ny, nz = nx / length, ny / length, nz / length
        low, high = np.inf, -np.inf
        for n in range(first[node], last[node]):
            along = nx * points[row[n], 0] + ny * points[row[n], 1] + nz * points[row[n], 2]
            low, high = min(low, along), max(high, along)
        slabs[node, 0], slabs[node, 1], slabs[node, 2], slabs[node, 3], slabs[node, 4] = nx, ny, nz, low, high


@rows
def _locate(start, stop, places, low, size, depth, child, level, colours, slabs, kind):
    count = 1 << depth
    for n in range(start, stop):
        x, y, z = places[n, 0], places[n, 1], places[n, 2]
        a, b, c = (x - low[0]) / size * count, (y - low[1]) / size * count, (z - low[2]) / size * count
        kind[n] = OUT
        if not (a >= 0.0 and b >= 0.0 and c >= 0.0 and a < count and b < count and c < count):
            continue
        leaf = leaf_at(child, level, depth, int(a), int(b), int(c))
        kind[n] = colours[leaf]
        if colours[leaf] == BORDER and len(slabs) > 0:
            along = slabs[leaf, 0] * x + slabs[leaf, 1] * y + slabs[leaf, 2] * z
            if along < slabs[leaf, 3]:
                kind[n] = IN
            elif along > slabs[leaf, 4]:
                kind[n] = OUT


@kernel
def _test_nodes(
    low, size, depth, child, level, colours,
    other_low, other_size, other_depth, row, first, last, other_child, other_level, cell, motion, kind,
):  # fmt: skip
    """Settle the nodes of another octree that meet leaves of one colour; return how many were tested and settled."""
    todo, stack = np.empty(_STACK, np.int64), np.empty(_STACK, np.int64)
    place = np.zeros((len(child), 3), np.int64)
    for node in range(len(child)):  # where the nodes of this octree stand
        for octant in range(8 if child[node] >= 0 else 0):
            for axis in range(3):
                place[child[node] + octant, axis] = 2 * place[node, axis] + ((octant >> (2 - axis)) & 1)
    todo[0], height, tests, settled = 0, 1, 0, 0
    middle, half = np.empty(3), np.empty(3)
    while height > 0:
        height -= 1
        node = todo[height]
        if last[node] == first[node]:
            continue
        tests += 1
        side = other_size / 2.0 ** other_level[node]
        for axis in range(3):
            middle[axis], half[axis] = motion[axis, 3], 0.0
            for t in range(3):
                middle[axis] += motion[axis, t] * (other_low[t] + (cell[node, t] + 0.5) * side)
                half[axis] += abs(motion[axis, t]) * 0.5 * side
        colour = _colour_of_box(low, size, child, level, colours, place, middle, half, stack)
        if colour < BORDER:
            for n in range(first[node], last[node]):
                kind[row[n]] = colour
            settled += last[node] - first[node]
        elif other_child[node] >= 0:
            for octant in range(8):
                todo[height] = other_child[node] + octant
                height += 1
    return tests, settled


@inner
def _colour_of_box(low, size, child, level, colours, place, middle, half, stack):
    """Return the one colour of all leaves that a box meets (outside where it leaves the octree), else BORDER."""
    inside = outside = False
    for axis in range(3):
        outside |= middle[axis] - half[axis] < low[axis] or middle[axis] + half[axis] > low[axis] + size
    stack[0], height = 0, 1
    while height > 0:
        height -= 1
        node = stack[height]
        side = size / 2.0 ** level[node]
        apart = False
        for axis in range(3):
            start = low[axis] + place[node, axis] * side
            apart |= middle[axis] - half[axis] > start + side or middle[axis] + half[axis] < start
        if apart:
            continue
        if child[node] >= 0:
            for octant in range(8):
                stack[height] = child[node] + octant
                height += 1
        elif colours[node] >= BORDER:
            return BORDER
        elif colours[node] == IN:
            inside = True
        else:
            outside = True
        if inside and outside:
            return BORDER
    return IN if inside else OUT
