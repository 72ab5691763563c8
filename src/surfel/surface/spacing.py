"""Spacing: how far apart the points of a cloud lie."""

from __future__ import annotations

import math

import numpy as np

from surfel.core.cast import Floats

NEIGHBOURS = 12
"""Which neighbour tells the local spacing."""


def local_spacing(squared: Floats) -> Floats:
    """Return the side of the square that a point has to itself, from the distance to its 12th neighbour.

    ``k`` points in a disk of radius d have a density of ``k / (pi d^2)``, hence ``h = d_k sqrt(pi / k)``.

    Parameters
    ----------
    squared : Floats, shape (n, k)
        Squared distances to the nearest neighbours, ascending.

    Returns
    -------
    Floats, shape (n,)
        In the units of the points.
    """
    k = min(NEIGHBOURS, squared.shape[1])
    return np.asarray(np.sqrt(squared[:, k - 1] * (math.pi / k)))


def regularity(squared: Floats, spacing: Floats) -> float:
    """Return the mean of nearest distance over spacing: 0.5 for random points, 0.8 for blue noise, 1 for a grid."""
    ratio = np.sqrt(squared[:, 0]) / np.where(spacing > 0.0, spacing, 1.0)
    return float(ratio.mean())
