"""The surfels nearest to places that are local and in order already."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.inside.operand import Operand


def neighbours_of(operand: Operand, places: Floats, k: int) -> tuple[Floats, NDArray[np.int32]]:
    """Return squared distances and rows of the k nearest surfels of each place, both (m, k), ascending by distance.

    Parameters
    ----------
    operand : Operand
        A cloud of at least k surfels.
    places : Floats, shape (m, 3)
        Minus the operand's origin, in an order in which neighbours follow each other: they share the search.
    k : int
        How many.
    """
    order = np.arange(len(places), dtype=np.int32)
    return operand.index._nearest(places, order, k, own=False)
