"""Arrangement: the lines in which all other leaves cut the surfels of one, and the sides in what lies between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.cells import Cells
from surfel.booleans.model import Model
from surfel.booleans.part import Part
from surfel.booleans.pieces import LINES, Pieces
from surfel.booleans.sides import OPPOSED, SAME, Sides
from surfel.core.cast import Floats

_TOGETHER, _PARALLEL, _AWAY = 0.35, 0.9, 1e300


class Arrangement(NamedTuple):
    """The lines of all leaves in the tangent planes of the surfels that any of them cuts.

    Parameters
    ----------
    rows : NDArray[np.int64], shape (m,)
        The surfels, ascending.
    starts : NDArray[np.int64], shape (m + 1,)
        Where the lines of each start.
    lines : Floats, shape (k, 3)
        All lines.
    owners : NDArray[np.int64], shape (k,)
        The leaf that each comes from.
    models : list of (leaf, model, place, first)
        For each leaf its model, the row here of each of its surfels, and the number of its first line there.
    """

    rows: NDArray[np.int64]
    starts: NDArray[np.int64]
    lines: Floats
    owners: NDArray[np.int64]
    models: list[tuple[int, Model, NDArray[np.int64], NDArray[np.int64]]]

    def sides_at(
        self, model: Model, place: NDArray[np.int64], first: NDArray[np.int64], whole: Sides, at: Pieces
    ) -> Sides:
        """Return the sides of a leaf in each piece: from its lines, or those of the whole surfel where it has none."""
        own = np.full(len(self.rows), -1)
        own[place] = np.arange(len(place))
        which = own[at.row]
        sides = np.broadcast_to(np.asarray(whole, np.uint8), len(at.row)).copy()
        cut = np.flatnonzero(which >= 0)
        here = which[cut]
        cell = (at.above[cut] >> first[here]) & ((1 << model.number[here]) - 1)
        sides[cut] = model.table[here, cell]
        return sides


def arranged(models: dict[int, Model]) -> Arrangement:
    """Put the lines of all leaves together, surfel by surfel."""
    every = [model.rows for model in models.values()]
    rows = np.unique(np.concatenate(every)) if every else np.empty(0, np.int64)
    total = np.zeros(len(rows), np.int64)
    placed = []
    for leaf, model in models.items():
        place = np.searchsorted(rows, model.rows)
        fits = total[place] + model.number <= LINES
        model, place = model.chosen(fits), place[fits]
        placed.append((leaf, model, place, total[place]))
        total[place] += model.number
    starts = np.concatenate([[0], np.cumsum(total)])
    lines, owners = np.empty((int(starts[-1]), 3)), np.empty(int(starts[-1]), np.int64)
    for leaf, model, place, first in placed:
        for j in range(model.lines.shape[1]):
            has = model.number > j
            to = starts[place[has]] + first[has] + j
            lines[to], owners[to] = model.lines[has, j], leaf
    return Arrangement(rows, starts, lines, owners, placed)


def end_together(part: Part, here: Arrangement, cells: Cells, sides: dict[int, Sides]) -> None:
    """Move lines out of the way where a coincident surface ends in the same sharp edge as the surfel's own."""
    for leaf, model, place, first in here.models:
        whole = sides[leaf]
        at = np.asarray(whole if isinstance(whole, int) else whole[model.rows])
        on = np.flatnonzero((at == SAME) | (at == OPPOSED))
        for j in range(model.lines.shape[1]):
            rows = on[model.number[on] > j]
            edges, line = cells.edges[place[rows]], here.starts[place[rows]] + first[rows] + j
            a, b, d = here.lines[line].T
            cosine = edges[..., 0] * a[:, None] + edges[..., 1] * b[:, None]
            gap = np.abs(edges[..., 2] - d[:, None] * np.sign(cosine))
            near = _TOGETHER * part.operand.spacings[model.rows[rows]][:, None]
            same = ((np.abs(cosine) > _PARALLEL) & (gap < near)).any(axis=1)
            here.lines[line[same], 2] = np.where(d[same] >= 0.0, _AWAY, -_AWAY)


def sides_of_pieces(here: Arrangement, pieces: Pieces, sides: dict[int, Sides]) -> dict[int, Sides]:
    """Return the sides of every leaf in every piece."""
    found: dict[int, Sides] = {k: _at(whole, here.rows[pieces.row]) for k, whole in sides.items()}
    for leaf, model, place, first in here.models:
        found[leaf] = here.sides_at(model, place, first, found[leaf], pieces)
    return found


def _at(whole: Sides, rows: NDArray[np.int64]) -> Sides:
    return whole if isinstance(whole, int) else whole[rows]
