"""Denoising: how wide the fit is, how often it is made, and in which blocks."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.execute import blocks
from surfel.surface.narrow import narrow_rows
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import SAMPLE, sample_rows
from surfel.surface.normals import ROUGH, WIDE, Planes, choose_planes, fit_planes
from surfel.surface.projection import project
from surfel.surface.uneven_noise import local_levels

LEAST_RANDOM, LEAST_REGULAR = 0.012, 0.04
"""Noise, in spacings, below which points are left where they are: where they lie at random, and in good order.

Between two points that happen to lie close together noise makes a steep step. Regular points have no such pairs, and
lose more by being smoothed than by a little noise.
"""

TWICE_FROM = 0.15
"""Noise, in spacings, from which points are projected twice."""

_ROWS = 1 << 17  # wide neighbourhoods are looked up for so many points at a time, and never stored whole


def matters(noise: float, order: float) -> bool:
    """Tell whether noise of a level is worth taking off points of a given regularity (0.5 random, 0.8 blue noise)."""
    return noise > float(np.interp(order, [0.55, 0.75], [LEAST_RANDOM, LEAST_REGULAR]))


def fit_widths(levels: Floats, points: int, twice: bool) -> NDArray[np.int32]:
    """Return how many neighbours the quadrics are fitted to, for the noise at each point, in spacings there.

    24 where they are fitted once; where twice 18, 6 + 52 sigma, or 130 sigma^2, whichever is most.
    """
    wide = np.full(len(levels), 24.0)
    if twice:
        wide = np.maximum(np.maximum(18.0, 6.0 + 52.0 * levels), 130.0 * np.square(levels))
    return np.asarray(np.minimum(np.minimum(wide, 500.0), max(points // 8, 6)), np.int32)


class Denoised(NamedTuple):
    """Projected points, and their normals, sums of principal curvatures, and noise that they had, in spacings there.

    All are in the order of the new index.
    """

    hood: Neighbourhoods
    normals: Floats
    bend: Floats
    levels: Floats


def denoise(hood: Neighbourhoods, noise: float, falls: float = 0.0) -> Denoised:
    """Project every point onto its moving-least-squares quadric: once, or twice above 0.15 spacings of noise.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the noisy points.
    noise : float
        Their standard deviation off the surface, in mean spacings.
    falls : float
        The power of the spacing with which the noise, in spacings, falls: 0 if it grows with the spacing, 1 if it keeps
        its length.

    Returns
    -------
    Denoised
        The normals are those of the fitted quadrics.
    """
    levels = local_levels(hood, noise, falls)
    counts = fit_widths(levels, len(hood), noise >= TWICE_FROM)
    narrow = narrow_rows(hood.points, hood.near, int(counts.min()), sample_rows(hood.points, SAMPLE))
    counts[narrow] = np.maximum(counts[narrow], min(WIDE, max(len(hood) // 8, 6)))
    rough = np.maximum(ROUGH, 1.5 * levels) * hood.spacing
    normals, bend = _wide_normals(hood, counts, rough), np.zeros(len(hood))
    for _ in range(1 if noise < TWICE_FROM else 2):
        moved, turned, bend = _project_all(hood, normals, counts)
        rows, moved = hood.rows, moved + hood.index.origin
        del hood  # before the next one takes its place
        hood = Neighbourhoods.of(moved, np.arange(len(rows)))
        here = hood.rows
        normals, bend, levels, counts = turned[here], bend[here], levels[here], counts[here]
        hood = replace(hood, rows=rows[here])
    return Denoised(hood, normals, bend, levels)


def _wide_normals(hood: Neighbourhoods, counts: NDArray[np.int32], rough: Floats) -> Floats:
    planes = Planes.empty(len(hood))
    for rows in _row_blocks(len(hood)):
        fit_planes(hood.points, rows, _wide(hood, counts, rows), counts[rows], planes)
    return choose_planes(hood.points, hood.near, rough, planes, better=0.7)


def _project_all(hood: Neighbourhoods, normals: Floats, counts: NDArray[np.int32]) -> tuple[Floats, Floats, Floats]:
    blocks_of_rows = _row_blocks(len(hood))
    parts = [project(hood.points, normals, rows, _wide(hood, counts, rows), counts[rows]) for rows in blocks_of_rows]
    moved, turned, bend = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return moved, turned, bend


def _wide(hood: Neighbourhoods, counts: NDArray[np.int32], rows: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return as many neighbours of some rows as most of them need; those that are kept already are used again."""
    k = int(counts[rows].max())
    if k <= hood.near.shape[1]:
        return np.ascontiguousarray(hood.near[rows[0] : rows[-1] + 1])
    return hood.index.knn(k, rows)[1]


def _row_blocks(n: int) -> list[NDArray[np.int32]]:
    return [np.arange(start, stop, dtype=np.int32) for start, stop in blocks(n, _ROWS)]
