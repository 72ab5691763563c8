"""Surfaces that points of the curve are brought onto: the sheets of a cloud, and exact ones."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from surfel._numba import rows, threads_for
from surfel._vec import dot
from surfel.core.cast import Floats
from surfel.core.lines import Lines
from surfel.inside.operand import Operand
from surfel.inside.sheets import NEIGHBOURS, side_of_sheets
from surfel.shapes.base import Shape

_TILT = 0.4


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
    sums = np.empty((2, 8))
    for i in range(first, last):
        value, _ = side_of_sheets(points, normals, places[i, 0], places[i, 1], places[i, 2], squares[i], near[i], sums)
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


class SolidSurface:
    """The surface of an exact solid or a mesh, found by crossing it with lines."""

    def __init__(self, shape: Shape) -> None:
        self.shape = shape

    def over(self, places: Floats, towards: Floats) -> tuple[Floats, Floats]:
        """Cross the surface along ``towards``; the normal is told by how three lines pass the place that is hit."""
        t, cosine, hit = self._nearest_hit(places, towards)
        across, along = _beside(towards)
        at = places + np.where(hit, t, 0.0)[:, None] * towards
        directions = [towards]
        for beside in (across, along):
            tilted = towards + _TILT * beside
            directions.append(tilted / np.linalg.norm(tilted, axis=1, keepdims=True))
        cosines = [cosine]
        scale = np.maximum(np.abs(t), 1e-6 * float(np.abs(places).max(initial=1.0)))
        for direction in directions[1:]:
            back = at - scale[:, None] * direction
            t_again, other, found = self._nearest_hit(back, direction, scale)
            good = found & (np.abs(t_again - scale) < 1e-3 * scale)
            cosines.append(np.where(good, other, np.einsum("ij,ij->i", direction, towards) * cosine))
        normal = np.linalg.solve(np.stack(directions, axis=1), np.stack(cosines, axis=1)[..., None])[..., 0]
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = np.where(hit[:, None], normal / np.maximum(length, 1e-300), towards)
        height = np.where(hit, -t * np.einsum("ij,ij->i", towards, normal), 0.0)
        return np.asarray(height), np.asarray(normal)

    def _nearest_hit(
        self, places: Floats, towards: Floats, expected: Floats | float = 0.0
    ) -> tuple[Floats, Floats, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
        found = self.shape._cross(Lines(places, np.ascontiguousarray(towards), np.ones(len(places))))
        m = len(places)
        line = found.lines
        far = np.abs(found.t - np.broadcast_to(expected, m)[line])
        good = np.isfinite(far)
        line, far, t, cosine = line[good], far[good], found.t[good], found.cosine[good]
        order = np.lexsort((far, line))
        line, first = np.unique(line[order], return_index=True)
        chosen = order[first]
        hit, at, slope = np.zeros(m, bool), np.zeros(m), np.ones(m)
        hit[line], at[line], slope[line] = True, t[chosen], cosine[chosen]
        return at, slope, hit


def _beside(unit: Floats) -> tuple[Floats, Floats]:
    helper = np.where(np.abs(unit[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = np.cross(unit, helper)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    return across, np.cross(unit, across)
