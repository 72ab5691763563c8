"""Local coordinates: kernels see points near the origin and of size one, wherever and however large the points are."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from surfel.core.cast import Floats


class Local(NamedTuple):
    """``(point - middle) / unit``: the middle of the points' bounds (3,), and a power of two near half their size.

    Dividing by a power of two rounds nothing, and squares of local coordinates neither overflow nor vanish. ``unit`` is
    0 where all points are equal.
    """

    middle: Floats
    unit: float

    @classmethod
    def of(cls, points: Floats) -> Local:
        """Return the local coordinates of at least one point."""
        columns = points.T  # numpy reduces three long columns much faster than many rows of three
        low = np.array([column.min() for column in columns])
        high = np.array([column.max() for column in columns])
        size = float((0.5 * high - 0.5 * low).max())
        unit = 2.0 ** min(max(math.frexp(size)[1], -1000), 1000) if size > 0.0 else 0.0
        return cls(0.5 * low + 0.5 * high, unit)
