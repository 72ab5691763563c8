"""Probes: places in the tangent planes of surfels that are asked for the inside, and what most in a cell say."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.model import MOST
from surfel.core.cast import Floats

_BESIDE = 0.03  # of the reach


def beside(lines: Floats, reach: Floats) -> list[Floats]:
    """Return a place on either side of each line, where it is nearest to the centre."""
    has = np.isfinite(lines[..., 2])
    foot = np.where(has, lines[..., 2], 0.0)
    return [
        (foot + turn * _BESIDE * reach[:, None])[..., None] * np.where(has[..., None], lines[..., :2], 0.0)
        for turn in (-1.0, 1.0)
    ]


def most(cell: NDArray[np.int64], inside: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return for each cell of the lines whether most probes in it are inside; one without probes is as those beside."""
    m, cells = len(cell), 1 << MOST
    place = (np.arange(m)[:, None] * cells + cell).ravel()
    votes = np.bincount(place, np.where(inside, 1.0, -1.0).ravel(), m * cells).reshape(m, cells)
    known = np.bincount(place, minlength=m * cells).reshape(m, cells) > 0
    beside = np.zeros_like(votes)
    for j in range(MOST):
        beside += votes[:, np.arange(cells) ^ (1 << j)]
    return np.where(known, votes > 0.0, beside > 0.0).astype(np.uint8)
