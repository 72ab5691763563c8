"""Leaves of a tree as the operation sees them: what is inside, and where they cut the surfels of others."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.beside import Beside, Nearest
from surfel.booleans.by_cloud import VOID, cut_by_cloud
from surfel.booleans.model import Model
from surfel.booleans.part import Part
from surfel.booleans.sides import FROM_KIND, OPPOSED, SAME
from surfel.core.cast import Floats
from surfel.inside.classify import Classifier
from surfel.inside.coincidence import ALIGNED
from surfel.shapes.surfels import Surfels

_SAME_PLACE = 1e-6  # in spacings


class Leaf(ABC):
    """What other surfels may be inside of."""

    @abstractmethod
    def judge(self, part: Part) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """Return the sides of every surfel of a part, and which may be cut at all, ascending."""

    @abstractmethod
    def sift(self, points: Floats, normals: Floats, reach: float) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Return the sides of places far from the surface, and which are within ``reach`` of it, or a little more."""

    @abstractmethod
    def cut(self, part: Part, rows: NDArray[np.int64], sides: NDArray[np.uint8]) -> Model:
        """Return how the leaf cuts those surfels of a part that it may cut."""


class CloudLeaf(Leaf):
    """A cloud with an inside.

    Parameters
    ----------
    cloud : Surfels
        The leaf.
    judge : str
        Which judge tells its inside, unless the cloud says so itself.
    """

    def __init__(self, cloud: Surfels, judge: str) -> None:
        self.cloud = cloud
        self._judge = cloud.judge or judge
        self._around: dict[int, Nearest] = {}

    @property
    def classifier(self) -> Classifier:
        """What tells its inside, built where it is first asked for."""
        return self.cloud._classifier(self._judge)

    def judge(self, part: Part) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """Sift by blocks; what lies near the border may be cut."""
        found, known = self.classifier.classify_beside(part.operand, reach=float(part.reach.max(initial=0.0)))
        sides = FROM_KIND[found.kind]
        rows = np.flatnonzero(found.near)
        operand = self.classifier.operand
        if not len(rows) or not len(operand):
            return sides, rows[:0]
        places = operand.local(part.points.take(rows, axis=0))
        beside = Beside.of(operand, places, np.searchsorted(rows, found.judged), known)
        square, there = beside.nearest()
        cut = np.sqrt(square) <= part.reach[rows] + VOID * operand.spacings[there]
        cut &= ~self._find_same_places(part, rows, sides, square, there)
        self._around[part.leaf] = beside.around(cut)
        return sides, rows[cut]

    def _find_same_places(
        self, part: Part, rows: NDArray[np.int64], sides: NDArray[np.uint8], square: Floats, there: NDArray[np.int32]
    ) -> NDArray[np.bool_]:
        """Tell which surfels lie where one of the cloud does: that says more than the sheets, and cuts none."""
        operand = self.classifier.operand
        here = square <= (_SAME_PLACE * operand.spacings[there]) ** 2
        close = np.flatnonzero(here)
        cosine = np.einsum("ij,ij->i", part.normals[rows[close]], operand.normals[there[close]])
        aligned = np.abs(cosine) > ALIGNED
        here[close[~aligned]] = False
        sides[rows[close[aligned]]] = np.where(cosine[aligned] > 0.0, SAME, OPPOSED)
        return np.asarray(here)

    def sift(self, points: Floats, normals: Floats, reach: float) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Sift places one by one."""
        found = self.classifier.classify(points, reach=reach)
        return FROM_KIND[found.kind], found.near

    def cut(self, part: Part, rows: NDArray[np.int64], sides: NDArray[np.uint8]) -> Model:
        """Meet the sheets near the surfels."""
        if part.leaf not in self._around:
            return Model.none()
        around = self._around.pop(part.leaf)
        return cut_by_cloud(self.classifier.operand, part.points, part.normals, part.reach, rows, sides, around)
