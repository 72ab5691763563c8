"""Classes: what a classifier says about each place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Booleans, Floats

OUT, IN, ON_SAME, ON_OPPOSED = 0, 1, 2, 3
"""Outside, inside, on the surface with a normal that agrees, on the surface with an opposed one."""


class Classes(NamedTuple):
    """What a classifier says about each of q places.

    Parameters
    ----------
    kind : NDArray[np.int8], shape (q,)
        :data:`OUT`, :data:`IN`, :data:`ON_SAME` or :data:`ON_OPPOSED`.
    near : Booleans, shape (q,)
        Whether the place is near the surface: in a cell that a disk meets, or within the ``reach`` asked for of one.
    judged : NDArray[np.int64], shape (m,)
        The rows that a judge had to look at, ascending.
    value : Floats, shape (m,)
        What it found there, negative inside.
    """

    kind: NDArray[np.int8]
    near: Booleans
    judged: NDArray[np.int64]
    value: Floats

    @property
    def inside(self) -> Booleans:
        """Which places are inside; those on the surface are not."""
        return np.asarray(self.kind == IN)

    @property
    def on(self) -> Booleans:
        """Which places are on the surface, with either normal."""
        return np.asarray(self.kind >= ON_SAME)

    @classmethod
    def outside(cls, count: int) -> Classes:
        """Return that all places are outside and far, as they are of an empty cloud."""
        return cls(np.zeros(count, np.int8), np.zeros(count, bool), np.empty(0, np.int64), np.empty(0))
