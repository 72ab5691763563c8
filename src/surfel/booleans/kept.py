"""Kept: what is left of the surfels of a leaf, whole ones, pieces with planes, and smaller ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.arrangement import Arrangement
from surfel.booleans.cells import frames_of
from surfel.booleans.part import Part
from surfel.booleans.pieces import Pieces
from surfel.booleans.seam import Seam
from surfel.booleans.splitting import Parts
from surfel.core.cast import Floats


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


def whole_ones(fate: NDArray[np.int8], rows: NDArray[np.int64], cut: int) -> Kept:
    """Return surfels that stay as they are, of a part of which ``cut`` are cut."""
    q = len(rows)
    return Kept(rows, fate[rows] < 0, np.zeros(q + 1, np.int64), np.empty((0, 4)), np.ones(q), np.zeros((q, 3)), cut)


def of_pieces(part: Part, here: Arrangement, pieces: Pieces, fate: NDArray[np.int8], cell_areas: Floats) -> Kept:
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


def of_parts(part: Part, here: Arrangement, found: Parts, cell_areas: Floats) -> Kept:
    """Turn squares into small surfels."""
    rows = here.rows[found.row]
    across, along = frames_of(part.normals[rows])
    centres = part.points[rows] + found.middle[:, :1] * across + found.middle[:, 1:] * along
    whole = cell_areas[found.row]
    share = np.divide(found.area, whole, out=np.zeros(len(rows)), where=whole > 0.0)
    q = len(rows)
    born = Born(np.arange(q), centres, found.radius)
    return Kept(rows, found.fate < 0, np.zeros(q + 1, np.int64), np.empty((0, 4)), share, np.zeros((q, 3)), 0, born)


def both(a: Kept, b: Kept) -> Kept:
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
        np.concatenate([a.planes, b.planes]).take(take, axis=0),
        np.concatenate([a.shares, b.shares])[order],
        np.concatenate([a.places, b.places]).take(order, axis=0),
        a.cut + b.cut,
        born,
    )
