"""Surfaces that points of the curve are brought onto: those of a cloud, smooth or with edges, and exact ones."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel._vec import dot
from surfel.core.cast import Floats
from surfel.inside.mls import project
from surfel.inside.operand import Operand
from surfel.inside.sheets import NEIGHBOURS, side_of_sheets
from surfel.shapes.base import Shape
from surfel.shapes.sample_lines import nearest_hit, normals_at

_LOOKED_AT = 20  # surfels that a projection looks at
_ALIKE = 0.8  # neighbours whose normals make a smaller cosine lie beyond an edge


class Surface(Protocol):
    """What can say how far above it places near by are."""

    def over(self, places: Floats, towards: Floats) -> tuple[Floats, Floats]:
        """Return heights and unit normals; ``towards`` is about the normal, or any direction across the surface."""
        ...


class SheetSurface:
    """The surface of a cloud: the sheet that decides (:mod:`surfel.inside.sheets`)."""

    def __init__(self, operand: Operand) -> None:
        self.operand = operand

    def over(self, places: Floats, towards: Floats) -> tuple[Floats, Floats]:
        """Take the sheet that decides whether a place is inside."""
        m, k = len(places), min(NEIGHBOURS, len(self.operand))
        height, normal = np.zeros(m), np.zeros((m, 3))
        if m and k:
            local = self.operand.local(places)
            squares, near = self.operand.index._nearest(local, np.arange(m, dtype=np.int32), k, own=False)
            with threads_for(8 * m):
                _over(m, self.operand.points, self.operand.normals, local, squares, near, height, normal)
        return height, normal


@rows
def _over(first, last, points, normals, places, squares, near, height, normal):
    sums, weights = np.empty((2, 8)), np.empty(near.shape[1])
    for i in range(first, last):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        value, _ = side_of_sheets(points, normals, x, y, z, squares, near, i, sums, weights)
        best = -1
        least = 0.0
        for c in range(2 if sums[1, 6] > 0.0 else 1):
            own = 0.5 * (
                sums[c, 7] / sums[c, 6] - dot(sums[c, 0], sums[c, 1], sums[c, 2], sums[c, 3], sums[c, 4], sums[c, 5])
            )
            if best < 0 or abs(own - value) < least:
                best, least = c, abs(own - value)
        height[i] = value
        normal[i, 0], normal[i, 1], normal[i, 2] = sums[best, 0], sums[best, 1], sums[best, 2]


class SmoothSurface:
    """The surface of a cloud: moving least squares as published, and where normals spread the sheet that decides."""

    def __init__(self, operand: Operand) -> None:
        self.operand = operand
        self._sheets = SheetSurface(operand)

    def over(self, places: Floats, towards: Floats) -> tuple[Floats, Floats]:
        """Project what lies beside smooth parts (:func:`surfel.inside.mls.project`); ask the sheets for the rest."""
        height, normal = self._sheets.over(places, towards)
        flat = np.flatnonzero(self._smooth(places))
        if len(flat):
            found = project(places[flat], self.operand)
            good = found.converged & found.normals.any(axis=1)
            offset, upright = places[flat[good]] - found.points[good], found.normals[good]
            height[flat[good]], normal[flat[good]] = np.einsum("ij,ij->i", offset, upright), upright
        return height, normal

    def _smooth(self, places: Floats) -> NDArray[np.bool_]:
        """Tell where all surfels that the projection looks at face about one way."""
        if not len(self.operand):
            return np.zeros(len(places), bool)
        near = self.operand.index.knn_of(places, min(_LOOKED_AT, len(self.operand)))[1]
        normals = self.operand.normals[near]
        return np.asarray((np.einsum("ikj,ij->ik", normals, normals[:, 0]) > _ALIKE).all(axis=1))


class SolidSurface:
    """The surface of an exact solid or a mesh, found by crossing it with lines."""

    def __init__(self, shape: Shape) -> None:
        self.shape = shape

    def over(self, places: Floats, towards: Floats) -> tuple[Floats, Floats]:
        """Cross the surface along ``towards``; the normal is told by how three lines pass the place that is hit."""
        t, cosine, hit = nearest_hit(self.shape, places, towards, np.zeros(len(places)))
        at = places + np.where(hit, t, 0.0)[:, None] * towards
        near = np.maximum(np.abs(t), 1e-6 * float(np.abs(places).max(initial=1.0)))
        normal, _ = normals_at(self.shape, at, towards, cosine, near)
        normal = np.where(hit[:, None], normal, towards)
        height = np.where(hit, -t * np.einsum("ij,ij->i", towards, normal), 0.0)
        return np.asarray(height), np.asarray(normal)
