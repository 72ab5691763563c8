"""Curved sheets: where lines of sight pass the smooth surface that the points and normals of a cloud tell of.

Triangles between the points lie below a convex surface, and a line that just misses them may still pass it. Here the
surface is that of :mod:`surfel.inside.sheets`: one curved sheet, or two that meet in an edge. It has no end of its own,
so a passage counts where the triangles of the cloud lie below it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.surfaces import SheetSurface
from surfel.core.cast import Booleans, Floats
from surfel.core.execute import blocks
from surfel.core.lines import Lines
from surfel.inside.operand import Operand
from surfel.rendering.cast import FARTHEST, Sight
from surfel.rendering.near_lines import Balls, balls_round, next_runs
from surfel.shapes.surfels import Surfels

_NEIGHBOUR, _REACH = 8, 1.25  # the balls round surfels reach so many times as far as this neighbour: over all holes
_STEP = 0.25  # of the radius of the least ball
_MOST = 1 << 10  # steps of one run
_HALVINGS = 3  # of a step, before a last one by the heights
_SURE = 0.02  # over the radius of a ball: how high a passage may lie over the sheet; where sheets change, heights jump
_DEEP = 0.25  # dips to less than this share of the height at the step nearest to them are looked at
_BELOW = 0.5  # how far below, over the radius of a ball: where triangles cut edges off
_OPPOSED = 0.3  # where the mean of normals is shorter, surfels of both sides are near
_PLACES = 1 << 20  # looked at together
_BLOCK = 1 << 16

Keeps = Callable[[NDArray[np.int64], Floats, Floats], Booleans]
"""Which of some passages are seen: rows of lines, t, and the cosine's sign."""


class Passages(NamedTuple):
    """Where lines pass a surface: rows of lines, t, and -1 where they go in, 1 where they come out."""

    line: NDArray[np.int64]
    t: Floats
    side: Floats


class Curved:
    """The curved sheets of a cloud, ready to be looked at.

    Parameters
    ----------
    cloud : Surfels
        Any. What cleaning leaves out shows nothing, and noise is off the points, as for measuring.
    """

    def __init__(self, cloud: Surfels) -> None:
        self.cloud = cloud
        rows = cloud.surface.rows
        self._operand: Operand | None = None
        if len(rows) <= _NEIGHBOUR or cloud.surface.local is None:
            return
        patches = cloud.surface.patches
        self._operand = Operand.of(patches.points[rows], patches.normals[rows])
        squares, _ = self._operand.index.knn(_NEIGHBOUR)
        self._surface = SheetSurface(self._operand)
        self._balls: Balls = balls_round(self._operand.points, _REACH * np.sqrt(squares[:, -1]))

    def first(self, looking: Sight, keeps: Keeps) -> tuple[Floats, Floats]:
        """Return the first passage of each line that counts, infinite where there is none, and its side.

        Parameters
        ----------
        looking : Sight
            Lines of sight.
        keeps : callable
            Asked for each passage whether it counts.
        """
        t, side = np.full(looking.number, np.inf), np.zeros(looking.number)
        if self._operand is None:
            return t, side
        for first, last in blocks(looking.number, _BLOCK):
            rows = np.arange(first, last)
            after = looking.start[rows]
            while len(rows):
                lines = _some(looking.lines, rows)
                begin, end, least = next_runs(
                    self._balls, lines.origins - self._operand.origin, lines.directions, after
                )
                some = np.flatnonzero(begin < FARTHEST)
                rows, after = rows[some], end[some]
                found = self._passages(_some(looking.lines, rows), begin[some], after, least[some])
                good = np.flatnonzero(keeps(rows[found.line], found.t, found.side))
                line, at = np.unique(found.line[good], return_index=True)
                t[rows[line]], side[rows[line]] = found.t[good[at]], found.side[good[at]]
                left = np.isinf(t[rows])
                rows, after = rows[left], after[left]
        return t, side

    def _passages(self, lines: Lines, begin: Floats, end: Floats, reach: Floats) -> Passages:
        """Return the passages of lines within one run of each, in ascending order."""
        counts = np.minimum(np.ceil((end - begin) / (_STEP * reach)).astype(np.int64), _MOST) + 1
        sums = np.concatenate([[0], np.cumsum(counts)])
        parts = [Passages(np.empty(0, np.int64), np.empty(0), np.empty(0))]
        first = 0
        while first < len(counts):
            last = max(first + 1, int(np.searchsorted(sums, sums[first] + _PLACES, "right")) - 1)
            row = np.repeat(np.arange(first, last), counts[first:last])
            share = (np.arange(len(row)) + sums[first] - sums[row]) / (counts[row] - 1)
            parts.append(self._among(lines, row, begin[row] + share * (end - begin)[row], reach))
            first = last
        return Passages(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def _among(self, lines: Lines, row: NDArray[np.int64], t: Floats, reach: Floats) -> Passages:
        """Return where the height over the sheets changes its sign between places that follow each other."""
        row, t, height = self._with_dips(lines, row, t, self._over(lines, row, t))
        before = np.flatnonzero((row[1:] == row[:-1]) & ((height[1:] < 0.0) != (height[:-1] < 0.0)))
        line, low, high, one, other = row[before], t[before], t[before + 1], height[before], height[before + 1]
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            here = self._over(lines, line, middle)
            same = (here < 0.0) == (one < 0.0)
            low, one = np.where(same, middle, low), np.where(same, here, one)
            high, other = np.where(same, high, middle), np.where(same, other, here)
        t = (low * other - high * one) / (other - one)
        good = np.flatnonzero(np.abs(self._over(lines, line, t)) < _SURE * reach[line])
        good = good[self._covered(lines, line[good], t[good], reach[line[good]])]
        return Passages(line[good], t[good], np.where(one < 0.0, 1.0, -1.0)[good])

    def _with_dips(
        self, lines: Lines, row: NDArray[np.int64], t: Floats, height: Floats
    ) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Add the places where lines come nearest to the surface between steps, as parabolas through three tell."""
        a, b, c = height[:-2], height[1:-1], height[2:]
        dip = np.flatnonzero((row[2:] == row[:-2]) & (b > 0.0) & (a > b) & (c >= b)) + 1
        a, b, c = height[dip - 1], height[dip], height[dip + 1]
        away = 0.5 * (a - c) / (a - 2.0 * b + c)
        deep = np.flatnonzero(b - 0.25 * (a - c) * away < _DEEP * b)
        dip, away = dip[deep], away[deep]
        between = t[dip] + away * (t[dip + 1] - t[dip])
        spot, lines_of = dip + (away > 0.0), row[dip]
        found = self._over(lines, lines_of, between)
        return np.insert(row, spot, lines_of), np.insert(t, spot, between), np.insert(height, spot, found)

    def _covered(self, lines: Lines, line: NDArray[np.int64], t: Floats, reach: Floats) -> Booleans:
        """Tell below which places triangles of the cloud lie, seen against the mean of the normals of surfels near."""
        assert self._operand is not None
        places = lines.origins[line] + t[:, None] * lines.directions[line]
        _, near = self._operand.index.knn_of(places, _NEIGHBOUR)
        along = self._operand.normals[near].mean(axis=1)
        size = np.linalg.norm(along, axis=1)
        opposed = size < _OPPOSED
        along = np.where(opposed[:, None], lines.directions[line], along / np.where(opposed, 1.0, size)[:, None])
        hits = self.cloud._cross(Lines(places, along, np.ones(len(places))))
        covered = np.zeros(len(places), np.bool_)
        covered[hits.lines[np.abs(hits.t) < _BELOW * reach[hits.lines]]] = True
        return covered

    def _over(self, lines: Lines, row: NDArray[np.int64], t: Floats) -> Floats:
        """Return how high places on lines lie over the sheet that decides."""
        along = lines.directions[row]
        return self._surface.over(lines.origins[row] + t[:, None] * along, along)[0]


def _some(lines: Lines, rows: NDArray[np.int64]) -> Lines:
    """Return some of the lines."""
    return Lines(lines.origins[rows], lines.directions[rows], lines.weights[rows])
