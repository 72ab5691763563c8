"""Assembling: the surfels that a tree keeps of one leaf, whole ones and cut ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.arrangement import Arrangement, arranged, end_together, sides_of_pieces
from surfel.booleans.cells import NEIGHBOURS, cells_of
from surfel.booleans.kept import Kept, both, of_parts, of_pieces, whole_ones
from surfel.booleans.leaf import Leaf
from surfel.booleans.part import Part
from surfel.booleans.pieces import Pieces, merged, parted
from surfel.booleans.seam import Seam
from surfel.booleans.sides import Rule, Sides
from surfel.booleans.splitting import levels_for, split
from surfel.core.cast import Floats

_NOTHING, _SOME = 1e-3, 0.02  # squares of the spacing
_BESIDE = 8


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
        return whole_ones(fate, np.flatnonzero(fate), 0)
    disks = part.disks(here.rows)
    cells = cells_of(part.operand, here.rows, part.boxes(here.rows))
    before = part.before(here.rows)
    end_together(part, here, cells, sides)
    every = parted(here.starts, here.lines, disks, cells, before)
    fates = rule.keeps(part.leaf, sides_of_pieces(here, every, sides), len(every.row))
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
        return whole_ones(fate, np.flatnonzero(fate), count)._replace(seam=seam)
    untouched = np.ones(len(part), bool)
    untouched[here.rows] = False
    rest = whole_ones(fate, np.flatnonzero(untouched & (fate != 0)), count)
    if how.kind == "clip":
        return both(rest, of_pieces(part, here, pieces.chosen(kept), of_piece[kept], areas))._replace(seam=seam)
    uncut = kept & (pieces.used == 0)
    rest = both(rest, of_pieces(part, here, pieces.chosen(uncut), of_piece[uncut], areas))
    levels = levels_for(part.extents[here.rows], how.level, how.tolerance)
    divided = split(here.starts, here.lines, disks, cells, before, every, fates, levels, passed)
    return both(rest, of_parts(part, here, divided, areas))._replace(seam=seam)


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
    k = min(_BESIDE if part.axes is None else NEIGHBOURS, len(part) - 1)  # ellipses reach past near neighbours
    near = part.operand.index.knn(k, every)[1] if k > 0 else np.empty((len(every), 0), np.int32)
    lonely = ~(stays[near].any(axis=1) | stays[every])[back]
    left = of_piece.copy()
    left[empty[lonely]] = 0
    return left
