"""Lines: what travels from the samplers to whatever can be crossed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from surfel.core.cast import Floats, as_points, as_rows
from surfel.core.errors import InputError


@dataclass(frozen=True, eq=False)
class Lines:
    """A batch of weighted infinite lines.

    With the invariant measure dL of lines, ``weights`` holds the measure that each line stands for, so that for any
    surface of area s that is crossed m times by a line (Cauchy-Crofton, ``int m dL = pi s``)::

        area = sum(weights * crossings) / pi

    Parameters
    ----------
    origins : Floats, shape (m, 3)
        A point on each line.
    directions : Floats, shape (m, 3)
        Unit vectors.
    weights : Floats, shape (m,)
        The line measure that each line stands for, in squared units of length.
    """

    origins: Floats
    directions: Floats
    weights: Floats

    @classmethod
    def of(cls, origins: ArrayLike, directions: ArrayLike, weights: ArrayLike) -> Lines:
        """Validate and cast; one weight may serve every line.

        Raises
        ------
        InputError
            If a shape does not fit or a direction is zero or not finite.
        """
        start = as_points(origins, "origins")
        along = as_rows(directions, "directions", len(start))
        length = np.linalg.norm(along, axis=1, keepdims=True)
        if not (np.isfinite(length).all() and (length > 0.0).all()):
            raise InputError("directions must be finite and none of them zero")
        share = np.broadcast_to(np.asarray(weights, dtype=np.float64), (len(start),))
        return cls(start, along / length, np.ascontiguousarray(share))

    def __len__(self) -> int:
        return len(self.origins)
