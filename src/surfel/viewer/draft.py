"""Draft: which disks of the parts are to be seen where they are now, fast enough to follow a hand."""

from __future__ import annotations

import numpy as np

from surfel.booleans.sides import is_sheet
from surfel.core.cast import Booleans, Floats
from surfel.core.errors import InputError
from surfel.inside.operand import Operand
from surfel.rendering.bits import Beside, Bits, survival
from surfel.shapes.base import Shape
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree
from surfel.viewer.elements import Elements
from surfel.viewer.stage import Stage


class Draft:
    """Classifies disks by their centres; a pair of parts that keeps its relative pose is not asked again."""

    def __init__(self) -> None:
        self._pairs: dict[tuple[int, int], tuple[bytes, Booleans]] = {}
        self._queries: dict[int, tuple[Elements, Operand]] = {}

    def kept(self, stage: Stage, elements: list[Elements]) -> list[Booleans]:
        """Tell which disks the expression keeps, part by part."""
        tree = stage.bare()
        return [self._kept(stage, tree, k, elements[k]) for k in range(len(stage.parts))]

    def _kept(self, stage: Stage, tree: Shape, k: int, mine: Elements) -> Booleans:
        count = len(mine.points)
        if not isinstance(tree, Tree):
            return np.ones(count, np.bool_)
        beside = {}
        for j, other in enumerate(stage.parts):
            if j != k:
                inside = np.zeros(count, np.bool_) if is_sheet(other.shape) else self._inside(stage, k, j, mine)
                bits = Bits.known(inside)
                beside[id(other.shape)] = Beside(bits, bits, np.zeros(count, np.bool_))
        part = stage.parts[k]
        return survival(tree, part.shape, beside, count, sheet=is_sheet(part.shape)).surely

    def _inside(self, stage: Stage, k: int, j: int, mine: Elements) -> Booleans:
        one, other = stage.parts[k], stage.parts[j]
        pose = np.linalg.inv(other.pose) @ one.pose
        known = self._pairs.get((k, j))
        if known is None or known[0] != pose.tobytes() or len(known[1]) != len(mine.points):
            found = self._in_cloud if isinstance(other.shape, Surfels) else _in_solid
            known = (pose.tobytes(), found(k, mine, other.shape, pose))
            self._pairs[k, j] = known
        return known[1]

    def _in_cloud(self, k: int, mine: Elements, cloud: Shape, pose: Floats) -> Booleans:
        """Ask a cloud, by whole blocks of disks."""
        assert isinstance(cloud, Surfels)
        if not len(cloud) or not len(mine.points):
            return np.zeros(len(mine.points), np.bool_)
        query = self._queries.get(k)
        if query is None or query[0] is not mine:
            query = (mine, Operand.of(mine.points, mine.normals))
            self._queries[k] = query
        inside = np.empty(len(mine.points), np.bool_)
        inside[query[1].order] = cloud.classifier.classify(query[1], pose=pose).inside
        return inside


def _in_solid(k: int, mine: Elements, solid: Shape, pose: Floats) -> Booleans:
    """Ask a solid about the disks in its box, found axis by axis."""
    found = np.zeros(len(mine.points), np.bool_)
    try:
        low, high = np.asarray(solid.bounds)
    except InputError:  # a mesh without triangles
        return found
    rows, here, there = np.arange(len(found)), np.ascontiguousarray(mine.points.T), np.empty((0, len(found)))
    for axis in range(3):
        place = pose[axis, 0] * here[0] + pose[axis, 1] * here[1] + pose[axis, 2] * here[2] + pose[axis, 3]
        near = np.flatnonzero((place >= low[axis]) & (place <= high[axis]))
        rows, here, there = rows[near], here[:, near], np.vstack([there, place])[:, near]
    found[rows] = solid._contains(np.ascontiguousarray(there.T))
    return found
