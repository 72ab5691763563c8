"""Neighbourhoods: a cloud's index with every point's nearest neighbours, cleaned of what is no surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.execute import blocks
from surfel.index.neighbours import PointIndex
from surfel.surface.apart import strays_apart
from surfel.surface.clean import duplicate_rows
from surfel.surface.left_strays import NONE_LEFT, LeftStrays, left_strays
from surfel.surface.near_strays import near_strays
from surfel.surface.spacing import local_spacing, regularity
from surfel.surface.strays import COLUMNS, stray_rows

NEAR = 24
"""How many neighbours are kept with each point; they settle most cells."""

_ROWS = 1 << 16  # for so many points at a time are all distances looked up, in room that stays in the cache


@dataclass(frozen=True, eq=False)
class Neighbourhoods:
    """An index and the nearest neighbours of every point, in the order of the index.

    Parameters
    ----------
    index : PointIndex
        Of the points.
    rows : NDArray[np.int64], shape (n,)
        The row of the original cloud that each row of the index stands for.
    squared : Floats, shape (n, c)
        Squared distances to the nearest of them, ascending; to more than one only while a cloud is cleaned.
    near : NDArray[np.int32], shape (n, k)
        Their rows in the index.
    spacing : Floats, shape (n,)
        Local spacing.
    left : LeftStrays
        What strays like those that were found, but not told from the surface, are likely to add to the area.
    """

    index: PointIndex
    rows: NDArray[np.int64]
    squared: Floats
    near: NDArray[np.int32]
    spacing: Floats
    left: LeftStrays = NONE_LEFT

    @classmethod
    def of(cls, points: Floats, rows: NDArray[np.int64], columns: int = 1) -> Neighbourhoods:
        """Index the points, at least two of them; ``rows`` says which row of the original cloud each is.

        Distances are looked up in blocks, and no more than ``columns`` of them are kept with each point: all of them
        would be most of the memory of a large cloud, and of the time to read a column.
        """
        index = PointIndex(points)
        n, k = len(points), min(NEAR, len(points) - 1)
        near, squared, spacing = np.empty((n, k), np.int32), np.empty((n, min(columns, k))), np.empty(n)
        room = np.empty((min(n, _ROWS), k))
        for start, stop in blocks(n, _ROWS):
            found = room[: stop - start]
            index.knn(k, np.arange(start, stop, dtype=np.int32), out=(found, near[start:stop]))
            squared[start:stop] = found[:, :columns]
            spacing[start:stop] = local_spacing(found)
        return cls(index, rows[index.order], squared, near, spacing)

    @property
    def points(self) -> Floats:
        """The points in the order of the index, minus its origin, shape (n, 3)."""
        return self.index.points

    @cached_property
    def order(self) -> float:
        """How regularly the points lie: 0.5 at random, 0.8 blue noise, 1 on a grid."""
        return regularity(self.squared, self.spacing)

    def subset(self, chosen: NDArray[np.int64], columns: int = 1) -> Neighbourhoods:
        """Index some of the points anew."""
        return Neighbourhoods.of(self.points[chosen] + self.index.origin, self.rows[chosen], columns)

    def slim(self) -> Neighbourhoods:
        """Return the same with the distance to the nearest neighbour alone."""
        return replace(self, squared=self.squared[:, :1].copy())

    def __len__(self) -> int:
        return len(self.rows)


def cleaned(points: Floats, normals: Floats | None) -> tuple[Neighbourhoods | None, dict[str, int]]:
    """Index a cloud without its duplicates and strays.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Scaled so that their extent is about 1.
    normals : Floats, shape (n, 3), optional
        In the order of the points.

    Returns
    -------
    Neighbourhoods or None
        None where fewer than four distinct points are left.
    dict of str to int
        How many ``duplicates`` and ``strays`` were left out.
    """
    counts = {"duplicates": 0, "strays": 0}
    if len(points) < 2:
        return None, counts
    hood = Neighbourhoods.of(points, np.arange(len(points)), COLUMNS)
    doubled = duplicate_rows(hood.points, None if normals is None else normals[hood.rows], hood.squared)
    counts["duplicates"] = len(doubled)
    if len(points) - len(doubled) < 4:
        return None, counts
    if len(doubled):
        hood = hood.subset(np.delete(np.arange(len(hood)), doubled), COLUMNS)
    strays, left = _strays(hood)
    counts["strays"] = len(strays)
    if len(strays):
        hood = replace(hood.subset(np.delete(np.arange(len(hood)), strays)), left=left)
    return hood.slim(), counts


def _strays(hood: Neighbourhoods) -> tuple[NDArray[np.int64], LeftStrays]:
    """Return the rows of the strays, of both kinds, and what is left of them."""
    sparse = stray_rows(hood.points, hood.squared, hood.near)
    far, above = strays_apart(hood.points, hood.squared, hood.near, hood.spacing, sparse)
    known = np.concatenate([sparse, far, above.rows])
    found = near_strays(hood.points, hood.squared, hood.near, known)
    found = found.joined(above.where(~np.isin(above.rows, found.rows)))
    dropped = np.zeros(len(hood), np.uint8)
    dropped[known] = dropped[found.rows] = 1
    rows = np.flatnonzero(dropped)
    if not len(rows):
        return rows, NONE_LEFT
    return rows, left_strays(hood.index, hood.near, hood.spacing, dropped, found)
