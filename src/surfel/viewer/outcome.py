"""Outcome: the disks of the exact result of an expression."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.rendering.splats import eight_bit
from surfel.shapes.tree import Tree
from surfel.viewer.elements import MOST, Elements, thinned

_COVER = 1.5  # of a surfel's own radius, by which it stands for its cell: disks must overlap to leave no gaps
_PIECE = 0.6  # of the median radius: smaller disks are what a cut left, and are never thinned


def outcome_of(tree: Tree, level: int) -> tuple[Elements, NDArray[np.int64]]:
    """Return the disks of the exact result, and which leaf each comes from; away from the cut large ones are thinned.

    Parameters
    ----------
    tree : Tree
        The expression.
    level : int
        How often surfels are halved at the cut.
    """
    from surfel.booleans.combine import combine

    surfels = combine(tree, cut="split", level=level).surfels
    count = len(surfels)
    normals = np.zeros((count, 3)) if surfels.normals is None else surfels.normals
    radii = np.zeros(count) if surfels.radii is None else surfels.radii
    colors = None if surfels.colors is None else eight_bit(np.asarray(surfels.colors))
    pieces = radii < _PIECE * np.median(radii) if count else np.zeros(0, np.bool_)
    shown, rows = thinned(Elements(surfels.points, normals, _COVER * radii, colors), pieces, 2 * MOST)
    return shown, np.asarray(surfels.attributes["leaf"], np.int64)[rows]
