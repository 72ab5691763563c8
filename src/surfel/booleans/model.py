"""Model: how a leaf cuts the surfels of another one, each in its tangent plane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats

MOST = 3
"""Most lines in which one leaf cuts one surfel."""


class Model(NamedTuple):
    """Lines in the tangent planes of m surfels, and what lies between them.

    Parameters
    ----------
    rows : NDArray[np.int64], shape (m,)
        The surfels, ascending.
    lines : Floats, shape (m, MOST, 3)
        ``a u + b v = d`` with (a, b) of unit length, in the frame of :func:`surfel._vec.tangent_frame`.
    number : NDArray[np.int64], shape (m,)
        How many lines there are, at least one.
    table : NDArray[np.uint8], shape (m, 2**MOST)
        The sides (:mod:`surfel.booleans.sides`) of the leaf in each cell of the lines: bit j of the column is set
        where ``a u + b v > d`` for line j.
    """

    rows: NDArray[np.int64]
    lines: Floats
    number: NDArray[np.int64]
    table: NDArray[np.uint8]

    @classmethod
    def none(cls) -> Model:
        """Return that no surfel is cut."""
        return cls(
            np.empty(0, np.int64), np.empty((0, MOST, 3)), np.empty(0, np.int64), np.empty((0, 1 << MOST), np.uint8)
        )

    def chosen(self, keep: NDArray[np.bool_]) -> Model:
        """Return the model of some of the surfels."""
        return Model(self.rows[keep], self.lines[keep], self.number[keep], self.table[keep])
