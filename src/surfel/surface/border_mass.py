"""What the open points of a cloud stand for beyond their cells: along borders, in creases, and on grids."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.execute import blocks
from surfel.surface.border import (
    GRID,
    ORDERLY,
    along_border,
    border_cells,
    border_share,
    doubtful_share,
    in_crease,
    nearby_cells,
    unevenness,
    unstirred,
)
from surfel.surface.cells import UNCOVERED, Cells
from surfel.surface.neighbourhoods import Neighbourhoods

INSIDE = 0.4
"""Share of the open points that are uncovered, above which they look as if they lay inside the border by chance."""

_ROWS = 1 << 18  # wide neighbourhoods are looked up for so many points at a time, and never stored whole


class BorderMass(NamedTuple):
    """What open points stand for.

    ``mass``, ``doubt``: shape (n,), what each adds, and by how much more or less that may be where the points may be
    those of a grid. ``share``: of a cell that each along a border adds. ``inside``: whether the points lie inside a
    border by chance, not on it.
    """

    mass: Floats
    doubt: Floats
    share: float
    inside: bool


def border_mass(hood: Neighbourhoods, normals: Floats, cells: Cells, noise: float, *, gaps: bool) -> BorderMass:
    """Tell what open points stand for beyond their cells.

    Along a border each adds a share of a cell. Elsewhere cells are open where sheets crowd in a crease and some
    neighbours are not told to be such.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the points.
    normals : Floats, shape (n, 3)
        Unit normals of either sign.
    cells : Cells
        Of the points.
    noise : float
        In mean spacings; it moves points along the surface, too.
    gaps : bool
        Whether what cells in creases lack of a whole one is added: normals must be given for that.
    """
    mass, doubt = np.zeros((2, len(hood)))
    opened = cells.closed == 0
    if not opened.any() or not cells.area.any():  # points on a line have no cell, and no border either
        return BorderMass(mass, doubt, 0.0, False)
    uncovered = (cells.uncovered & UNCOVERED) > 0
    uneven = unevenness(cells.area, cells.closed, hood.near)
    before = unstirred(uneven, noise)
    share, other = border_share(max(before, min(uneven, ORDERLY))), doubtful_share(before)
    for rows in in_blocks(np.flatnonzero(opened).astype(np.int32)):
        wide = hood.index.knn(min(48, len(hood) - 1), rows)[1]
        size = nearby_cells(rows, wide, cells.area, cells.closed, hood.spacing)
        crowded = in_crease(hood.points, normals, hood.near, rows)
        straight, told = along_border(rows, wide, opened, uncovered)
        clear = told & ~crowded
        mass[rows] = share * size * told
        mass[rows[clear]] = share * border_cells(hood.points, rows[clear], wide[clear], cells.area, cells.closed)
        doubt[rows] = other * size * (told | (straight & ~crowded))
        if gaps:
            mass[rows] += (crowded & ~told) * np.maximum(0.0, size - cells.area[rows])
    return BorderMass(mass, doubt, share, bool(uncovered[opened].mean() > INSIDE and uneven > GRID))


def in_blocks(rows: NDArray[np.int32]) -> list[NDArray[np.int32]]:
    """Return the rows in blocks of bounded size."""
    return [rows[start:stop] for start, stop in blocks(len(rows), _ROWS)]
