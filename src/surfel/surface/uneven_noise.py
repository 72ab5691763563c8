"""Noise of clouds of uneven density: it keeps its length, or grows with the spacing, or something between.

The points of a scanner err by the same length wherever they fall, and where they lie dense that is many spacings. Where
what reads as noise is relief finer than the points, it is about the same share of the spacing everywhere. So the level
is asked for in the dense, the middle and the sparse third of the cloud, and a power of the spacing is laid through.
"""

from __future__ import annotations

import math

import numpy as np

from surfel.core.cast import Floats
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import SAMPLE, noise_level, sample_rows

UNEVEN = 1.6
"""How much the spacing must differ between the sparse and the dense third for the level to be asked of each."""

LEAST = 0.05
"""A level below this in any third is as likely relief: the noise is then taken for as many spacings everywhere."""

_THIRDS = 3


def uneven_level(hood: Neighbourhoods, level: float) -> tuple[float, float]:
    """Return the level at the mean spacing, and the power of the spacing, from 0 to 1, with which the level falls.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the points.
    level : float
        What the whole cloud shows; returned with the power 0 where the density is even.
    """
    if level < LEAST or len(hood) < 2 * SAMPLE:
        return level, 0.0
    chosen = sample_rows(hood.points, 2 * SAMPLE)
    place = smooth_spacing(hood)[chosen]
    thirds = np.array_split(np.argsort(place, kind="stable"), _THIRDS)
    apart = np.array([np.median(place[third]) for third in thirds])
    if apart[-1] < UNEVEN * apart[0]:
        return level, 0.0
    levels = np.array([noise_level(hood.index, np.sort(chosen[third])) for third in thirds])
    if levels.min() < LEAST:
        return level, 0.0
    share = np.log(apart / mean_spacing(hood))
    falls = float(np.clip(-np.polyfit(share, np.log(levels), 1)[0], 0.0, 1.0))
    return (math.exp(float((np.log(levels) + falls * share).mean())), falls) if falls > 0.0 else (level, 0.0)


def local_levels(hood: Neighbourhoods, level: float, falls: float) -> Floats:
    """Return the noise at every point, in spacings there."""
    if falls == 0.0:
        return np.full(len(hood), level)
    return np.asarray(level * (mean_spacing(hood) / smooth_spacing(hood)) ** falls)


def mean_spacing(hood: Neighbourhoods) -> float:
    """Return the root of the mean square of the spacing: about that of the area over the number of points."""
    return math.sqrt(float(np.square(hood.spacing).mean()))


def smooth_spacing(hood: Neighbourhoods) -> Floats:
    """Return the spacing as the mean over the neighbours of each point."""
    return np.asarray(hood.spacing[hood.near].mean(axis=1))
