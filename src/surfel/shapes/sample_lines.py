"""Random points on surfaces that are known by what lines they cross alone: equations without a parametrization."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.lines import Lines
from surfel.lines.box import OrientedBox
from surfel.lines.models import line_block, lines_through_box
from surfel.shapes.base import Shape

_PILOT = 1 << 14
_NEAR = 1e-4  # of the box: so far before a place is it looked for again, along other lines
_SAME_PLACE = 1e-3  # of that
_UNIT = 1e-7  # how far from 1 the length of a normal may come out
_TILTS = (0.4, -0.4, 1.0, -1.0)


class OfLines:
    """Draws points of the surface of a shape, uniform by area: all crossings of lines of the invariant measure.

    Of such lines a piece of surface is crossed in proportion to its area, however it lies (Crofton's formula).

    Parameters
    ----------
    shape : Shape
        Anything that lines cross.
    region : Floats, shape (2, 3)
        What lies outside is left out.

    Attributes
    ----------
    area : float
        About the area of the surface in the region.
    """

    def __init__(self, shape: Shape, region: Floats) -> None:
        self.shape = shape
        self.region = region
        half = np.maximum(0.5 * (region[1] - region[0]), 1e-9 * float(np.abs(region).max()))
        self.box = OrientedBox(0.5 * (region[0] + region[1]), np.eye(3), half)
        pilot = line_block("r4", "tangent", self.box, 0, _PILOT, _PILOT)
        hits = len(self._hits(pilot)[0])
        self.area = hits * float(pilot.weights[0]) / math.pi

    def random(self, n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Return about ``n`` points, not all of them independent, and their unit normals."""
        if not self.area > 0.0:
            return np.empty((0, 3)), np.empty((0, 3))
        lines = lines_through_box(rng.random((math.ceil(0.5 * n * self.box.surface / self.area), 4)), self.box)
        points, directions, cosines = self._hits(lines)
        near = _NEAR * float(np.linalg.norm(self.region[1] - self.region[0]))
        normals, known = normals_at(self.shape, points, directions, cosines, np.full(len(points), near))
        return points[known], normals[known]

    def _hits(self, lines: Lines) -> tuple[Floats, Floats, Floats]:
        found = self.shape._cross(lines)
        finite = np.isfinite(found.t)
        which, t = found.lines[finite], found.t[finite]
        points = lines.origins[which] + t[:, None] * lines.directions[which]
        here = ((points >= self.region[0]) & (points <= self.region[1])).all(axis=1)
        return points[here], lines.directions[which[here]], found.cosine[finite][here]


def normals_at(
    shape: Shape, points: Floats, towards: Floats, cosines: Floats, near: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the normals of a surface at places on it, told by the cosines with three lines through each.

    Parameters
    ----------
    shape : Shape
        Anything that lines cross.
    points, towards : Floats, shape (m, 3)
        Places on the surface, and unit directions in which lines have crossed it there.
    cosines : Floats, shape (m,)
        With the outward normal, of these crossings.
    near : Floats, shape (m,)
        So far before a place does the search along another line begin.

    Returns
    -------
    normals : Floats, shape (m, 3)
        Unit normals; where none was found, ``towards`` on the side that its cosine tells.
    known : NDArray[np.bool_], shape (m,)
        Where the three cosines agree with a normal of length 1: not on edges.
    """
    normals = towards * np.where(cosines < 0.0, -1.0, 1.0)[:, None]
    known = np.zeros(len(points), bool)
    for tilt in _TILTS:
        rows = np.flatnonzero(~known)
        if not len(rows):
            break
        found, good = _by_three_lines(shape, points[rows], towards[rows], cosines[rows], near[rows], tilt)
        normals[rows[good]], known[rows[good]] = found[good], True
    return normals, known


def _by_three_lines(
    shape: Shape, points: Floats, towards: Floats, cosines: Floats, near: Floats, tilt: float
) -> tuple[Floats, NDArray[np.bool_]]:
    directions, along = [towards], [cosines]
    good = np.ones(len(points), bool)
    for beside in _beside(towards):
        tilted = towards + tilt * beside
        tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
        t, cosine, hit = nearest_hit(shape, points - near[:, None] * tilted, tilted, near)
        good &= hit & (np.abs(t - near) < _SAME_PLACE * near)
        directions.append(tilted)
        along.append(cosine)
    normals = np.linalg.solve(np.stack(directions, axis=1), np.stack(along, axis=1)[..., None])[..., 0]
    length = np.linalg.norm(normals, axis=1)
    good &= np.abs(length - 1.0) < _UNIT
    return normals / np.where(good, length, 1.0)[:, None], good


def nearest_hit(
    shape: Shape, origins: Floats, directions: Floats, expected: Floats
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return t and cosine of that crossing of each line which is nearest to where it is expected, and if there is one.

    Parameters
    ----------
    shape : Shape
        Anything that lines cross.
    origins, directions : Floats, shape (m, 3)
        The lines; directions of length 1.
    expected : Floats, shape (m,)
        A t on each line.
    """
    m = len(origins)
    found = shape._cross(Lines(origins, np.ascontiguousarray(directions), np.ones(m)))
    good = np.isfinite(found.t)
    line, t, cosine = found.lines[good], found.t[good], found.cosine[good]
    order = np.lexsort((np.abs(t - expected[line]), line))
    line, first = np.unique(line[order], return_index=True)
    chosen = order[first]
    hit, at, slope = np.zeros(m, bool), np.zeros(m), np.ones(m)
    hit[line], at[line], slope[line] = True, t[chosen], cosine[chosen]
    return at, slope, hit


def _beside(unit: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors at right angles to each and to each other."""
    helper = np.where(np.abs(unit[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = np.cross(unit, helper)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    return across, np.cross(unit, across)
