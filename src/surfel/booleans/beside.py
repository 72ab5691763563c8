"""The surfels of a cloud that are nearest to some places, where the classification found those of some of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Booleans, Floats
from surfel.inside.operand import Operand
from surfel.inside.sheets import NEIGHBOURS, OverSheets

Nearest = tuple[Floats, NDArray[np.int32]]
"""Squared distances, ascending, and rows of the nearest surfels, both of shape (m, k)."""


class Beside(NamedTuple):
    """Places near a cloud.

    Parameters
    ----------
    operand : Operand
        The cloud.
    places : Floats, shape (m, 3)
        In its own coordinates, in an order in which neighbours follow each other.
    known : NDArray[np.int64], shape (j,)
        The places of which the nearest surfels are known, ascending.
    squares, near : Floats and NDArray[np.int32], shape (j, k)
        Those.
    """

    operand: Operand
    places: Floats
    known: NDArray[np.int64]
    squares: Floats
    near: NDArray[np.int32]

    @classmethod
    def of(cls, operand: Operand, places: Floats, known: NDArray[np.int64], found: OverSheets | None) -> Beside:
        """Return places of which a judge has looked at some, where it has found their neighbours."""
        if found is None:
            return cls(operand, places, known[:0], np.empty((0, NEIGHBOURS)), np.empty((0, NEIGHBOURS), np.int32))
        return cls(operand, places, known, found.squares, found.near)

    def nearest(self) -> tuple[Floats, NDArray[np.int32]]:
        """Return the squared distance and the row of the one nearest surfel of each place."""
        unknown = np.ones(len(self.places), bool)
        unknown[self.known] = False
        squares, near = nearest_to(self.operand, self.places.compress(unknown, axis=0), 1)
        every, rows = np.empty(len(self.places)), np.empty(len(self.places), np.int32)
        every[unknown], rows[unknown] = squares[:, 0], near[:, 0]
        every[self.known], rows[self.known] = self.squares[:, 0], self.near[:, 0]
        return every, rows

    def around(self, chosen: Booleans) -> Nearest:
        """Return the nearest surfels of some of the places."""
        wanted = chosen.copy()
        wanted[self.known] = False
        held = chosen[self.known]
        if not wanted.any():
            return self.squares.compress(held, axis=0), self.near.compress(held, axis=0)
        squares, near = nearest_to(self.operand, self.places.compress(wanted, axis=0))
        if not held.any():
            return squares, near
        new = wanted[chosen]
        # numpy takes whole rows many times faster than it writes chosen ones
        order = np.where(new, np.cumsum(new) - 1, len(near) + np.cumsum(~new) - 1)
        every = np.concatenate([squares, self.squares.compress(held, axis=0)])
        rows = np.concatenate([near, self.near.compress(held, axis=0)])
        return every.take(order, axis=0), rows.take(order, axis=0)


def nearest_to(operand: Operand, places: Floats, k: int = NEIGHBOURS) -> Nearest:
    """Return the squared distances to the surfels nearest to local places, and their rows."""
    order = np.arange(len(places), dtype=np.int32)
    return operand.index._nearest(places, order, min(k, len(operand)), own=False)
