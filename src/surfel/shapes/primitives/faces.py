"""Points of a unit square shared out to the faces of a surface, each as its area has it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats


def choose_face(u: Floats, areas: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Cut [0, 1) into strips as wide as the shares of the faces.

    Parameters
    ----------
    u : Floats, shape (n,)
        In [0, 1).
    areas : Floats, shape (k,)
        Not negative, one for each face.

    Returns
    -------
    face : NDArray[np.int64], shape (n,)
        The strip of each point, never one without area.
    within : Floats, shape (n,)
        Where it lies in its strip, in [0, 1).
    """
    ends = np.cumsum(areas) / np.sum(areas)
    last = int(np.flatnonzero(areas)[-1])
    face = np.minimum(np.searchsorted(ends, u, side="right"), last)
    starts = np.concatenate([[0.0], ends[:-1]])
    width = np.where(areas > 0.0, ends - starts, 1.0)
    within = (u - starts[face]) / width[face]
    return face, np.clip(within, 0.0, np.nextafter(1.0, 0.0))


def disk(radius: float, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Map points of the unit square evenly to a disk: angle by u, radius by v."""
    angle, out = 2.0 * np.pi * u, radius * np.sqrt(v)
    return out * np.cos(angle), out * np.sin(angle)
