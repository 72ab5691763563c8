"""Denoising: how wide the fit is, how often it is made, and in which blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.execute import blocks
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.normals import Planes, choose_planes, fit_planes
from surfel.surface.projection import project

LEAST_RANDOM, LEAST_REGULAR = 0.012, 0.04
"""Noise, in spacings, below which points are left where they are: where they lie at random, and in good order.

Between two points that happen to lie close together noise makes a steep step. Regular points have no such pairs, and
lose more by being smoothed than by a little noise.
"""

TWICE_FROM = 0.15
"""Noise, in spacings, from which points are projected twice."""

LEFT_ONCE, LEFT_TWICE = 0.12, 0.043
"""Roughness of a plane after one or two projections over 24 neighbours, in squares of the noise."""

_ROWS = 1 << 17  # wide neighbourhoods are looked up for so many points at a time, and never stored whole


def matters(noise: float, order: float) -> bool:
    """Tell whether noise of a level is worth taking off points of a given regularity (0.5 random, 0.8 blue noise)."""
    return noise > float(np.interp(order, [0.55, 0.75], [LEAST_RANDOM, LEAST_REGULAR]))


def fit_width(noise: float, points: int) -> int:
    """Return how many neighbours the quadric is fitted to: 150 sigma^2, at least 24."""
    return int(min(np.clip(150.0 * noise * noise, 24, 500), max(points // 8, 6)))


def left_over(noise: float, points: int) -> float:
    """Return the roughness that the noise left by projection has on a plane; it falls with the cube of the width."""
    width = fit_width(noise, points) / 24.0
    return (LEFT_ONCE if noise < TWICE_FROM else LEFT_TWICE) * noise * noise / width**3


def denoise(hood: Neighbourhoods, noise: float) -> tuple[Neighbourhoods, Floats]:
    """Project every point onto its moving-least-squares quadric: once, or twice above 0.15 spacings of noise.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the noisy points.
    noise : float
        Their standard deviation off the surface, in spacings.

    Returns
    -------
    hood : Neighbourhoods
        Of the projected points.
    normals : Floats, shape (n, 3)
        Of the fitted quadrics, in the order of the new index.
    """
    k = fit_width(noise, len(hood))
    normals = _wide_normals(hood, k, noise)
    for _ in range(1 if noise < TWICE_FROM else 2):
        moved, turned = _project_all(hood, normals, k)
        rows, moved = hood.rows, moved + hood.index.origin
        del hood  # before the next one takes its place
        hood = Neighbourhoods.of(moved, np.arange(len(rows)))
        normals = turned[hood.rows]
        hood = replace(hood, rows=rows[hood.rows])
    return hood, normals


def _wide_normals(hood: Neighbourhoods, k: int, noise: float) -> Floats:
    planes = Planes.empty(len(hood))
    for rows in _row_blocks(len(hood)):
        fit_planes(hood.points, rows, _wide(hood, k, rows), k, planes)
    return choose_planes(hood.points, hood.near, hood.spacing, planes, rough=max(0.1, 1.5 * noise), better=0.7)


def _project_all(hood: Neighbourhoods, normals: Floats, k: int) -> tuple[Floats, Floats]:
    parts = [project(hood.points, normals, rows, _wide(hood, k, rows)) for rows in _row_blocks(len(hood))]
    return np.concatenate([moved for moved, _ in parts]), np.concatenate([turned for _, turned in parts])


def _wide(hood: Neighbourhoods, k: int, rows: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the k nearest neighbours of some rows; those that are kept already are not looked up again."""
    if k <= hood.near.shape[1]:
        return np.ascontiguousarray(hood.near[rows[0] : rows[-1] + 1, :k])
    return hood.index.knn(k, rows)[1]


def _row_blocks(n: int) -> list[NDArray[np.int32]]:
    return [np.arange(start, stop, dtype=np.int32) for start, stop in blocks(n, _ROWS)]
