"""Where the surface of an exact solid cuts surfels: lines in their tangent planes, crossed exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.cells import frames_of
from surfel.booleans.leaf import Leaf
from surfel.booleans.model import MOST, Model
from surfel.booleans.part import Part
from surfel.booleans.probes import beside, most
from surfel.booleans.sides import IN, OPPOSED, OUT, SAME
from surfel.core.cast import Floats
from surfel.core.lines import Lines
from surfel.inside.coincidence import ALIGNED, DISTANCE, LEAST, WIDER
from surfel.shapes.base import Shape

_EXACT = 1e-6
"""Surfels drawn from an exact surface are on another one if that is nearer than this, in spacings."""

_LOWERED = 0.05
"""So far are they moved into it, in spacings, to find its edges; far enough not to feel that it bends."""

_STEEP = 0.3
"""Least sine between a face that ends a coincident one and the surfel."""

_ROOT2 = 1.4143
_OFF = 0.08  # a hit farther than this share of the reach from all lines asks for a line of its own
_CHORDS = np.array([-0.55, 0.0, 0.55])
_ANGLES = np.pi * np.arange(4) / 4.0
_ROUND, _SHEET = 8, 0.8  # neighbours of a surfel, and the least cosine with those on its sheet
_PROBES = 7


class SolidLeaf(Leaf):
    """An exact solid or a closed mesh."""

    def __init__(self, shape: Shape, box: Floats) -> None:
        self.shape = shape
        self.box = box

    def judge(self, part: Part) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """Ask for the inside; a surfel may be cut where one of two lines in its plane crosses the surface near by."""
        n = len(part)
        sides = np.zeros(n, np.uint8)
        reach = float(part.reach.max(initial=0.0))
        inside_box = ((part.points >= self.box[0] - 2.0 * reach) & (part.points <= self.box[1] + 2.0 * reach)).all(
            axis=1
        )
        rows = np.flatnonzero(inside_box)
        if not len(rows):
            return sides, rows
        points, normals = part.points[rows], part.normals[rows]
        sides[rows] = np.where(self.shape._contains(points), IN, OUT)
        self._find_coincident(part, rows, points, normals, sides)
        across, along = frames_of(part.normals[rows])
        limit = _ROOT2 * part.reach[rows]
        crossed = np.zeros(len(rows), bool)
        for which, centres in self._planes(part, rows, sides):
            for direction in (across[which], along[which]):
                line, t, _ = self._hits(centres, direction)
                crossed[which[line[np.abs(t) <= limit[which[line]]]]] = True
        return sides, rows[crossed]

    def sift(self, points: Floats, normals: Floats, reach: float) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Ask for the inside, and cross the surface with three lines through each place."""
        sides, near = np.zeros(len(points), np.uint8), np.zeros(len(points), bool)
        box = self.box + _ROOT2 * reach * np.array([[-1.0], [1.0]])
        rows = np.flatnonzero(((points >= box[0]) & (points <= box[1])).all(axis=1))
        if len(rows):
            sides[rows] = np.where(self.shape._contains(points[rows]), IN, OUT)
            for direction in (normals[rows], *frames_of(normals[rows])):
                line, t, _ = self._hits(points[rows], direction)
                near[rows[line[np.abs(t) <= _ROOT2 * reach]]] = True
        return sides, near

    def _find_coincident(
        self, part: Part, rows: NDArray[np.int64], points: Floats, normals: Floats, sides: NDArray[np.uint8]
    ) -> None:
        """Mark surfels that lie on the surface: their normal crosses it near by, and about at right angles."""
        line, t, cosine = self._hits(points, normals)
        within = self._depth(part, rows)[line]
        on = np.flatnonzero((np.abs(t) <= within) & (np.abs(cosine) > ALIGNED))
        if not part.exact:
            on = on[1.0 - np.abs(cosine[on]) <= WIDER * _spread(part, rows[line[on]]) + LEAST]
        sides[rows[line[on]]] = np.where(cosine[on] > 0.0, SAME, OPPOSED)

    def _depth(self, part: Part, rows: NDArray[np.int64]) -> Floats:
        return (_EXACT if part.exact else DISTANCE) * part.operand.spacings[rows]

    def _offsets(self, part: Part, rows: NDArray[np.int64], sides: NDArray[np.uint8]) -> Floats:
        """Return how far below and above each surfel the two sides of it are asked for."""
        on = np.isin(sides[rows], (SAME, OPPOSED))
        share = np.where(on, _LOWERED, _EXACT) if part.exact else np.where(on, DISTANCE, 0.0)
        return np.asarray(share * part.operand.spacings[rows])

    def _planes(
        self, part: Part, rows: NDArray[np.int64], sides: NDArray[np.uint8]
    ) -> list[tuple[NDArray[np.int64], Floats]]:
        """Return where tangent planes are crossed: below the surfels, and above those that may lie in a face.

        A face that lies in the plane itself cannot be crossed there; the sides of the solid below or above it can.
        """
        offset = self._offsets(part, rows, sides)[:, None]
        step = offset * part.normals[rows]
        every, twice = np.arange(len(rows)), np.flatnonzero(offset[:, 0] > 0.0)
        planes = [(every, part.points[rows] - step)]
        return [*planes, (twice, part.points[rows][twice] + step[twice])] if len(twice) else planes

    def _hits(self, origins: Floats, directions: Floats) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Return line, distance and cosine of every crossing."""
        found = self.shape._cross(Lines(origins, np.ascontiguousarray(directions), np.ones(len(origins))))
        finite = np.isfinite(found.t)
        return found.lines[finite], found.t[finite], found.cosine[finite]

    def cut(self, part: Part, rows: NDArray[np.int64], sides: NDArray[np.uint8]) -> Model:
        """Cross each tangent plane with a dozen lines, lay tangents through what they hit, and probe between them."""
        if not len(rows):
            return Model.none()
        reach = part.reach[rows]
        across, along = frames_of(part.normals[rows])
        hits = [
            self._hits_in_planes(which, centres, across[which], along[which], reach[which])
            for which, centres in self._planes(part, rows, sides)
        ]
        row, uv, place = (np.concatenate([found[k] for found in hits]) for k in range(3))
        order = np.lexsort((np.einsum("ij,ij->i", uv, uv), row))
        on = np.isin(sides[rows], (SAME, OPPOSED))
        lines, count = self._tangents(
            across, along, reach, row[order], uv[order], place[order], np.where(on, _STEEP, 1e-3)
        )
        lines[:, :, 2] = np.where(np.arange(MOST) < count[:, None], lines[:, :, 2], np.inf)
        model = Model(rows, lines, count, self._table(part, rows, sides, across, along, lines, count))
        return model.chosen(count > 0)

    def _hits_in_planes(
        self, which: NDArray[np.int64], centres: Floats, across: Floats, along: Floats, reach: Floats
    ) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Return what lines in the tangent planes hit within reach: the surfel, and the place of each hit."""
        every, flat, places = [], [], []
        for angle in _ANGLES:
            c, s = np.cos(angle), np.sin(angle)
            direction, beside = c * across + s * along, c * along - s * across
            for chord in _CHORDS:
                start = centres + (chord * reach)[:, None] * beside
                line, t, _ = self._hits(start, direction)
                offset = chord * reach[line]
                near = t * t + offset * offset <= 1.05 * reach[line] ** 2
                line, t, offset = line[near], t[near], offset[near]
                every.append(which[line])
                flat.append(np.stack([c * t - s * offset, s * t + c * offset], axis=1))
                places.append(start[line] + t[:, None] * direction[line])
        return np.concatenate(every), np.concatenate(flat), np.concatenate(places)

    def _tangents(
        self, across: Floats, along: Floats, reach: Floats, row: NDArray[np.int64], uv: Floats, places: Floats,
        least: Floats,
    ) -> tuple[Floats, NDArray[np.int64]]:  # fmt: skip
        """Lay a line along the surface through the nearest hit, then through the nearest that is on no line yet."""
        m = len(reach)
        lines, count = np.zeros((m, MOST, 3)), np.zeros(m, np.int64)
        open_ = np.ones(len(row), bool)
        for j in range(MOST):
            left = np.flatnonzero(open_)
            if not len(left):
                break
            chosen = left[np.unique(row[left], return_index=True)[1]]
            here = row[chosen]
            slope = self._slope(places[chosen], across[here], along[here], reach[here])
            length = np.hypot(slope[:, 0], slope[:, 1])
            good = length > least[here]
            open_[chosen[~good]] = False
            here, chosen, slope, length = here[good], chosen[good], slope[good], length[good]
            unit = slope / length[:, None]
            lines[here, j, :2] = unit
            lines[here, j, 2] = np.einsum("ij,ij->i", unit, uv[chosen])
            count[here] = j + 1
            fresh = np.zeros(m, bool)
            fresh[here] = True
            off = np.abs(np.einsum("ij,ij->i", lines[row, j, :2], uv) - lines[row, j, 2])
            open_ &= ~fresh[row] | (off > _OFF * reach[row])
            open_[chosen] = False
            open_ &= count[row] == j + 1  # no line was found for the others
        return lines, count

    def _slope(self, places: Floats, across: Floats, along: Floats, reach: Floats) -> Floats:
        """Return the components in the tangent plane of the outward normal at places on the surface."""
        slope = np.zeros((len(places), 2))
        back = 0.25 * reach
        for axis, direction in enumerate((across, along)):
            line, t, cosine = self._hits(places - back[:, None] * direction, direction)
            far = np.abs(t - back[line])
            order = np.lexsort((far, line))
            line, cosine, far = line[order], cosine[order], far[order]
            first = np.unique(line, return_index=True)[1]
            first = first[far[first] <= 1e-6 * reach[line[first]]]
            slope[line[first], axis] = cosine[first]
        return slope

    def _table(
        self, part: Part, rows: NDArray[np.int64], sides: NDArray[np.uint8], across: Floats, along: Floats,
        lines: Floats, count: NDArray[np.int64],
    ) -> NDArray[np.uint8]:  # fmt: skip
        """Return the sides in each cell of the lines: what most probes there say."""
        m = len(rows)
        grid = (np.arange(_PROBES) + 0.5) / _PROBES * 2.0 - 1.0
        u, v = (axis.ravel() for axis in np.meshgrid(grid, grid))
        inside = u * u + v * v <= 1.0
        probes = np.stack([u[inside], v[inside]], axis=1)
        uv = probes[None] * part.reach[rows][:, None, None]
        uv = np.concatenate([uv, *beside(lines, part.reach[rows])], axis=1)
        at = part.points[rows][:, None] + uv[..., :1] * across[:, None] + uv[..., 1:] * along[:, None]
        depth = self._offsets(part, rows, sides)
        shift = (depth[:, None] * part.normals[rows])[:, None]
        lower = self.shape._contains((at - shift).reshape(-1, 3)).reshape(m, -1)
        upper = lower
        on = np.flatnonzero(depth > 0.0)
        if len(on):
            upper = lower.copy()
            upper[on] = self.shape._contains((at[on] + shift[on]).reshape(-1, 3)).reshape(len(on), -1)
        cell = np.zeros(lower.shape, np.int64)
        for j in range(MOST):
            above = uv[..., 0] * lines[:, None, j, 0] + uv[..., 1] * lines[:, None, j, 1] > lines[:, None, j, 2]
            cell |= (above & (count[:, None] > j)).astype(np.int64) << j
        return most(cell, lower) * np.uint8(SAME) | most(cell, upper) * np.uint8(OPPOSED)


def _spread(part: Part, rows: NDArray[np.int64]) -> Floats:
    """Return by how much the normals of the surfels round some differ from theirs: the mean of 1 - cosine."""
    every, back = np.unique(rows, return_inverse=True)
    k = min(_ROUND, len(part) - 1)
    if not len(every) or k < 1:
        return np.zeros(len(rows))
    around = part.normals[part.operand.index.knn(k, every)[1]]
    cosine = np.einsum("ikj,ij->ik", around, part.normals[every])
    here = cosine > _SHEET
    return np.asarray((np.where(here, 1.0 - cosine, 0.0).sum(axis=1) / np.maximum(here.sum(axis=1), 1))[back])
