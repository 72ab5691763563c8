"""How far apart the surfels of a cloud lie at each of them, and which lie far off the surface that the others show."""

from __future__ import annotations

import numpy as np

from surfel.core.cast import Booleans, Floats, read_only
from surfel.index.neighbours import PointIndex
from surfel.inside.interpolation import along_the_order, mark_strays

NEIGHBOURS = 8
"""Which neighbour tells the local spacing where none was given."""

TWINS = 0.01
"""Share of surfels with another one at their place from which on the places are told apart first."""

STRIDE, FEWEST = 4, 10_000
"""In larger clouds than this, one surfel in four looks for its neighbours; two others take over what it finds."""

WIDE = 3.0
"""Where the spacing is so many times the median, each surfel looks for its neighbours: it may be a stray."""


def spacings_and_strays(index: PointIndex | None, normals: Floats) -> tuple[Floats, Booleans]:
    """Return the spacing at every surfel, and which are strays.

    The spacing is told by the neighbours of one surfel in :data:`STRIDE`, averaged over a few of these. Surfels at one
    place are taken as one. A stray takes the least spacing of its neighbours, no larger than the median.
    """
    n = 0 if index is None else len(index)
    if index is None or n < 2:
        return read_only(np.zeros(n)), read_only(np.zeros(n, bool))
    k = min(NEIGHBOURS, n - 1)
    stride = 1 if n < FEWEST else STRIDE
    asked = np.arange(0, n, stride)
    squares, near = index.knn(k, asked)
    if np.mean(squares[:, 0] == 0.0) > TWINS:
        places, of_surfel = np.unique(index.points, axis=0, return_inverse=True)
        distinct = PointIndex(places)
        of_place = np.zeros((len(places), 3))
        of_place[of_surfel.ravel()] = normals
        found, alone = np.empty(len(places)), np.empty(len(places), bool)
        found[distinct.order], alone[distinct.order] = (
            spacings_and_strays(distinct, of_place[distinct.order]) if len(places) > 1 else (0.0, False)
        )
        return read_only(found[of_surfel.ravel()]), read_only(alone[of_surfel.ravel()])
    known = np.sqrt(squares[:, k - 1] * (np.pi / k))
    spacings, trusted = along_the_order(index.points, known, stride)
    usual = float(np.median(known))
    left = np.flatnonzero(~trusted | (spacings > WIDE * usual))
    strays = np.zeros(n, bool)
    groups = [(asked, squares, near)]
    if len(left):
        groups.append((left, *index.knn(k, left)))
        spacings[left] = np.sqrt(groups[1][1][:, k - 1] * (np.pi / k))
    for _ in range(2):
        for group in groups:
            mark_strays(*group, index.points, normals, spacings, WIDE * usual, strays)
        if not strays.any():
            break
    for rows, _, neighbours in groups:
        alone = strays[rows]
        spacings[rows[alone]] = np.minimum(spacings[neighbours[alone]].min(axis=1), usual)
    return read_only(spacings), read_only(strays)
