"""Assembling: the surfels that a tree keeps of one leaf, whole ones and cut ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.cells import Cells, cells_of, frames_of
from surfel.booleans.leaf import Leaf
from surfel.booleans.model import Model
from surfel.booleans.part import Part
from surfel.booleans.pieces import LINES, Pieces, merged, parted
from surfel.booleans.seam import Seam
from surfel.booleans.sides import OPPOSED, SAME, Rule, Sides
from surfel.booleans.splitting import Parts, levels_for, split
from surfel.core.cast import Floats

_NOTHING, _SOME = 1e-3, 0.02  # squares of the spacing
_BESIDE = 8
_TOGETHER, _PARALLEL, _AWAY = 0.35, 0.9, 1e300


class Kept(NamedTuple):
    """What is left of a part; one row for each surfel or piece of one that survives.

    Parameters
    ----------
    rows : NDArray[np.int64], shape (q,)
        Rows of the part.
    turned : NDArray[np.bool_], shape (q,)
        Whether the surfel is turned over.
    offsets : NDArray[np.int64], shape (q + 1,)
        Where the planes of each start.
    planes : Floats, shape (p, 4)
        Of the cut: ``n . (x - centre) <= d``.
    shares : Floats, shape (q,)
        What part of its cell is left.
    places : Floats, shape (q, 3)
        From the centre to the middle of that.
    cut : int
        How many surfels the cut passes.
    born : Born or None
        Rows that were split off their surfel, where there are any.
    seam : Seam or None
        Where the kept pieces end, for the curve.
    """

    rows: NDArray[np.int64]
    turned: NDArray[np.bool_]
    offsets: NDArray[np.int64]
    planes: Floats
    shares: Floats
    places: Floats
    cut: int
    born: Born | None = None
    seam: Seam | None = None


class Born(NamedTuple):
    """Surfels that were split off.

    Parameters
    ----------
    rows : NDArray[np.int64], shape (s,)
        Which rows of the :class:`Kept` they are.
    centres : Floats, shape (s, 3)
        Where they lie.
    radii : Floats, shape (s,)
        Their radii.
    """

    rows: NDArray[np.int64]
    centres: Floats
    radii: Floats


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


class Cut(NamedTuple):
    """How surfels at the cut are treated."""

    kind: str = "clip"
    level: int | None = None
    tolerance: float | None = None


def assembled(part: Part, leaves: dict[int, Leaf], rule: Rule, how: Cut) -> Kept:
    """Judge every surfel of a part by the tree, and cut those that the surface of another leaf passes.

    Parameters
    ----------
    part : Part
        The surfels of one leaf.
    leaves : dict of int to Leaf
        The others that may lie there.
    rule : Rule
        The tree.
    how : Cut
        ``none`` lets the centres decide.
    """
    judged = {k: leaf.judge(part) for k, leaf in leaves.items()}
    sides: dict[int, Sides] = {k: found for k, (found, _) in judged.items()}
    fate = rule.keeps(part.leaf, sides, len(part))
    models = {k: leaf.cut(part, judged[k][1], judged[k][0]) for k, leaf in leaves.items()}
    here = arranged({k: model for k, model in models.items() if len(model.rows)})
    if not len(here.rows):
        return _whole(fate, np.flatnonzero(fate), 0)
    cells = cells_of(part.operand, here.rows)
    before = part.before(here.rows)
    _end_together(part, here, cells, sides)
    every = parted(here.starts, here.lines, part.reach[here.rows], cells, before)
    fates = rule.keeps(part.leaf, _sides_of_pieces(here, every, sides), len(every.row))
    areas: Floats = np.bincount(every.row, every.area, len(here.rows)).astype(np.float64)
    pieces, of_piece = merged(every, fates)
    of_piece = _beside_kept(part, here, pieces, of_piece, fate)
    kept = of_piece != 0
    whole_left = np.bincount(pieces.row[kept & (pieces.used == 0)], minlength=len(here.rows)) > 0
    some_left = np.bincount(pieces.row[kept], minlength=len(here.rows)) > 0
    passed = some_left & ~whole_left
    count = int(passed.sum())
    seam = Seam(
        part.points[here.rows], part.normals[here.rows], here.starts, here.lines, here.owners, cells,
        pieces.chosen(kept),
    )  # fmt: skip
    if how.kind == "none":
        return _whole(fate, np.flatnonzero(fate), count)._replace(seam=seam)
    untouched = np.ones(len(part), bool)
    untouched[here.rows] = False
    rest = _whole(fate, np.flatnonzero(untouched & (fate != 0)), count)
    if how.kind == "clip":
        return _joined(rest, _of_pieces(part, here, pieces.chosen(kept), of_piece[kept], areas))._replace(seam=seam)
    uncut = kept & (pieces.used == 0)
    rest = _joined(rest, _of_pieces(part, here, pieces.chosen(uncut), of_piece[uncut], areas))
    levels = levels_for(part.radii[here.rows], how.level, how.tolerance)
    divided = split(here.starts, here.lines, part.radii[here.rows], cells, before, every, fates, levels, passed)
    return _joined(rest, _of_parts(part, here, divided, areas))._replace(seam=seam)


def _end_together(part: Part, here: Arrangement, cells: Cells, sides: dict[int, Sides]) -> None:
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


def _beside_kept(
    part: Part, here: Arrangement, pieces: Pieces, of_piece: NDArray[np.int8], fate: NDArray[np.int8]
) -> NDArray[np.int8]:
    """Drop pieces of disks without any of the cell where no surfel beside them stays: they cover no gap there."""
    square = part.operand.spacings[here.rows[pieces.row]] ** 2
    empty = np.flatnonzero((of_piece != 0) & (pieces.area <= _NOTHING * square))
    if not len(empty):
        return of_piece
    stays = fate != 0
    stays[here.rows] = False
    held = (of_piece != 0) & (pieces.area > _SOME * square)
    stays[here.rows[pieces.row[held]]] = True
    rows = here.rows[pieces.row[empty]]
    every, back = np.unique(rows, return_inverse=True)
    k = min(_BESIDE, len(part) - 1)
    near = part.operand.index.knn(k, every)[1] if k > 0 else np.empty((len(every), 0), np.int32)
    lonely = ~(stays[near].any(axis=1) | stays[every])[back]
    left = of_piece.copy()
    left[empty[lonely]] = 0
    return left


def _sides_of_pieces(here: Arrangement, pieces: Pieces, sides: dict[int, Sides]) -> dict[int, Sides]:
    """Return the sides of every leaf in every piece."""
    found: dict[int, Sides] = {k: _at(whole, here.rows[pieces.row]) for k, whole in sides.items()}
    for leaf, model, place, first in here.models:
        found[leaf] = here.sides_at(model, place, first, found[leaf], pieces)
    return found


def _at(whole: Sides, rows: NDArray[np.int64]) -> Sides:
    return whole if isinstance(whole, int) else whole[rows]


def _whole(fate: NDArray[np.int8], rows: NDArray[np.int64], cut: int) -> Kept:
    q = len(rows)
    return Kept(rows, fate[rows] < 0, np.zeros(q + 1, np.int64), np.empty((0, 4)), np.ones(q), np.zeros((q, 3)), cut)


def _of_pieces(part: Part, here: Arrangement, pieces: Pieces, fate: NDArray[np.int8], cell_areas: Floats) -> Kept:
    """Turn pieces into surfels with planes."""
    rows = here.rows[pieces.row]
    across, along = frames_of(part.normals[here.rows])
    bits = [np.flatnonzero(pieces.used >> j & 1) for j in range(int(pieces.used.max(initial=0)).bit_length())]
    counts = np.zeros(len(rows), np.int64)
    for holders in bits:
        counts[holders] += 1
    offsets = np.concatenate([[0], np.cumsum(counts)])
    planes = np.empty((int(offsets[-1]), 4))
    written = np.zeros(len(rows), np.int64)
    for j, holders in enumerate(bits):
        surfel = pieces.row[holders]
        a, b, d = here.lines[here.starts[surfel] + j].T
        sign = np.where(pieces.above[holders] >> j & 1, -1.0, 1.0)
        to = offsets[holders] + written[holders]
        planes[to, :3] = sign[:, None] * (a[:, None] * across[surfel] + b[:, None] * along[surfel])
        planes[to, 3] = sign * d
        written[holders] += 1
    whole = cell_areas[pieces.row]
    share = np.divide(pieces.area, whole, out=np.zeros(len(rows)), where=whole > 0.0)
    u, v = pieces.middle.T
    places = u[:, None] * across[pieces.row] + v[:, None] * along[pieces.row]
    places[counts == 0] = 0.0
    return Kept(rows, fate < 0, offsets, planes, share, places, 0)


def _of_parts(part: Part, here: Arrangement, found: Parts, cell_areas: Floats) -> Kept:
    """Turn squares into small surfels."""
    rows = here.rows[found.row]
    across, along = frames_of(part.normals[rows])
    centres = part.points[rows] + found.middle[:, :1] * across + found.middle[:, 1:] * along
    whole = cell_areas[found.row]
    share = np.divide(found.area, whole, out=np.zeros(len(rows)), where=whole > 0.0)
    q = len(rows)
    born = Born(np.arange(q), centres, found.radius)
    return Kept(rows, found.fate < 0, np.zeros(q + 1, np.int64), np.empty((0, 4)), share, np.zeros((q, 3)), 0, born)


def _joined(a: Kept, b: Kept) -> Kept:
    """Put whole surfels and pieces together, in the order of the part."""
    rows = np.concatenate([a.rows, b.rows])
    order = np.argsort(rows, kind="stable")
    counts = np.concatenate([np.diff(a.offsets), np.diff(b.offsets)])[order]
    offsets = np.concatenate([[0], np.cumsum(counts)])
    starts = np.concatenate([a.offsets[:-1], len(a.planes) + b.offsets[:-1]])[order]
    take = np.repeat(starts - offsets[:-1], counts) + np.arange(int(offsets[-1]))
    born = b.born
    if born is not None:
        to = np.empty(len(rows), np.int64)
        to[order] = np.arange(len(rows))
        born = born._replace(rows=to[len(a.rows) + born.rows])
    return Kept(
        rows[order],
        np.concatenate([a.turned, b.turned])[order],
        offsets,
        np.concatenate([a.planes, b.planes])[take],
        np.concatenate([a.shares, b.shares])[order],
        np.concatenate([a.places, b.places])[order],
        a.cut + b.cut,
        born,
    )
