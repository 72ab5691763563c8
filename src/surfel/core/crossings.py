"""Crossings: where lines meet a shape, as compressed rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats


@dataclass(frozen=True, eq=False)
class Crossings:
    """Every hit of a batch of lines on a shape, sorted along each line.

    Parameters
    ----------
    offsets : NDArray[np.int64], shape (m + 1,)
        The hits of line l are the rows ``offsets[l]:offsets[l + 1]``.
    t : Floats, shape (k,)
        Signed distance from the line's origin, ascending within a line.
    cosine : Floats, shape (k,)
        Direction . outward normal: negative where the line enters, positive where it leaves.
    weight : Floats, shape (k,)
        1 on an exact surface, a share of a sheet on a cloud; for areas only.
    leaf : NDArray[np.int32], shape (k,)
        Which leaf of the tree was hit.
    """

    offsets: NDArray[np.int64]
    t: Floats
    cosine: Floats
    weight: Floats
    leaf: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def counts(self) -> NDArray[np.int64]:
        """How many hits each line has, shape (m,)."""
        return np.diff(self.offsets)

    @property
    def lines(self) -> NDArray[np.int64]:
        """The line of each hit, shape (k,)."""
        return np.repeat(np.arange(len(self)), self.counts)

    def weight_per_line(self) -> Floats:
        """Return the sum of the hits' weights of each line, shape (m,), added in the order of t."""
        total = np.zeros(len(self))
        np.add.at(total, self.lines, self.weight)
        return total
