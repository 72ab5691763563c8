"""Draft: which disks of the parts are to be seen where they are now, fast enough to follow a hand."""

from __future__ import annotations

import numpy as np

from surfel.booleans.sides import is_sheet
from surfel.core.cast import Booleans, Floats
from surfel.core.errors import InputError
from surfel.rendering.bits import Beside, Bits, survival
from surfel.shapes.base import Shape
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree
from surfel.viewer.elements import Elements
from surfel.viewer.stage import Part, Stage


class Draft:
    """Classifies disks by their centres; a pair of parts that keeps its relative pose is not asked again."""

    def __init__(self) -> None:
        self._pairs: dict[tuple[int, int], tuple[bytes, Booleans]] = {}

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
            known = (pose.tobytes(), _inside(one, mine, other, pose))
            self._pairs[k, j] = known
        return known[1]


def _inside(one: Part, mine: Elements, other: Part, pose: Floats) -> Booleans:
    solid = other.shape
    if isinstance(solid, Surfels):
        if not len(solid):
            return np.zeros(len(mine.points), np.bool_)
        cloud = one.shape
        if isinstance(cloud, Surfels) and cloud.clips is None and len(cloud) == len(mine.points):
            return np.asarray(solid.classifier.classify(cloud.operand, pose=pose).inside)  # by blocks: faster
        return np.asarray(solid.classifier.classify(mine.points, pose=pose).inside)
    places = mine.points @ pose[:3, :3].T + pose[:3, 3]
    try:
        low, high = np.asarray(solid.bounds)
    except InputError:  # a mesh without triangles
        return np.zeros(len(places), np.bool_)
    found = np.zeros(len(places), np.bool_)
    near = np.flatnonzero(((places >= low) & (places <= high)).all(axis=1))
    found[near] = solid._contains(np.ascontiguousarray(places[near]))
    return found
