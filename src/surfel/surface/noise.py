"""The noise level of a cloud: how far its points lie off the surface, in spacings."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, rows
from surfel._vec import tangent_frame
from surfel.core.cast import Floats
from surfel.surface.narrow import SINGLE_NOISY, on_two_rows
from surfel.surface.planes import plane_of_neighbours, solve_spd

SHEETS_FROM = 0.12
"""Noise, in spacings, from which it is asked whether the points form two sheets."""

TWO_SHEETS_BELOW = 1.9
"""Kurtosis of the residuals below which they do."""

SAMPLE = 1500
"""How many points the level is estimated from."""

QUANTILES = np.array([0.1, 0.2, 0.3, 0.5])
QUANTILES_OF_WHITE_NOISE = np.array([0.66, 0.75, 0.83, 0.96])
"""The level that each quantile shows for noise of level 1, measured on spheres."""

NEAR_GROWTH, FAR_SHARE = 0.37, 0.926
"""Noise along the surface widens the spacing that 16 neighbours show, by this share of the square of the level; and the
level that larger neighbourhoods show is too large (measured on spheres)."""


class NeighbourSource(Protocol):
    """What the surface estimators ask of an index: its sorted points, and neighbours as rows of them."""

    @property
    def points(self) -> Floats:
        """Points in the order of the index, shape (n, 3)."""
        ...

    def knn(self, k: int, rows: NDArray[np.int32] | None = None) -> tuple[Floats, NDArray[np.int32]]:
        """Return squared distances and rows of the k nearest neighbours, the point itself excluded."""
        ...


def sample_rows(points: Floats, count: int) -> NDArray[np.int32]:
    """Choose rows spread over the cloud; permutation and rigid motion change nothing.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Coordinates.
    count : int
        How many rows at the most.

    Returns
    -------
    NDArray[np.int32], shape (min(n, count),)
        Row numbers, ascending.
    """
    n = len(points)
    if n <= count:
        return np.arange(n, dtype=np.int32)
    place = _along_the_cloud(points)
    chosen = np.sort(place)[(np.arange(count) * n + n // 2) // count]
    nearest = np.minimum(np.searchsorted(chosen, place), count - 1)
    return np.flatnonzero(chosen[nearest] == place)[:count].astype(np.int32)


def axial_ranks(points: Floats) -> NDArray[np.int64]:
    """Return the rows in the order of their place along the cloud; permutation and rigid motion change nothing.

    Ranks that follow each other lie far apart across the axis, so that every other one is a fair half of the cloud.
    """
    return np.argsort(_along_the_cloud(points))


def _along_the_cloud(points: Floats) -> Floats:
    """Return each point's place along the axis from the centroid to the farthest point."""
    x, y, z = (column - column.mean() for column in points.T)
    far = int(np.argmax(x * x + y * y + z * z))
    return np.asarray(x * x[far] + y * y[far] + z * z[far])


def noise_level(index: NeighbourSource, chosen: NDArray[np.int32] | None = None) -> float:
    """Estimate the standard deviation of the points off the surface, in spacings.

    Quadrics are fitted to small and to three times larger neighbourhoods; the residual of white noise is the same in
    both, that of curvature grows with the third power of the radius, so that with residuals s and S in local spacings
    ``sigma^2 = (3^1.5 s^2 - S^2) / (3^1.5 - 1)``. Where the residual is large against the radius the
    neighbourhoods grow; so they do where the nearest lie on two rows of points, which anything fits.

    Noise is everywhere, relief is not: the level is taken from several quantiles of the residuals, each scaled by what
    it is for white noise, and the second smallest counts. A level far above what the flattest tenth of the cloud
    shows is structure, too.

    Parameters
    ----------
    index : NeighbourSource
        Of the cloud.
    chosen : NDArray[np.int32], optional
        The rows that are asked; a sample of all by default.

    Returns
    -------
    float
        Standard deviation in spacings; 0 where the cloud is too small to tell.
    """
    n = len(index.points)
    if n <= 4 * 48:
        return 0.0
    if chosen is None:
        chosen = sample_rows(index.points, SAMPLE)
    level, flattest = 0.0, math.inf
    wide = 48
    while wide < n // 4 and wide <= 432:
        near = index.knn(wide, chosen)[1]
        if _in_rows(index.points, chosen, near, wide // 3):
            wide *= 3
            continue
        residual = np.empty((len(chosen), 3))
        _quadric_residuals(len(chosen), index.points, chosen, near, wide // 3, residual)
        level = _white_part(residual[:, 0], residual[:, 1])
        level *= 1.0 + NEAR_GROWTH * min(level, 1.0) ** 2 if wide == 48 else FAR_SHARE
        if wide == 48 and not _in_rows(index.points, chosen, near, _FLAT):
            flattest = float(np.quantile(residual[:, 2], 0.10)) / 0.5
        if np.median(residual[:, 0]) * math.sqrt(math.pi / (wide // 3)) < 0.17:
            break
        wide *= 3
    return flattest if level > 8.0 * flattest else level


def is_two_sheets(index: NeighbourSource, level: float) -> bool:
    """Tell whether what reads as noise is two sheets of points, nearer to each other than their spacing.

    Off a surface fitted between two sheets the points lie at one distance to either side (kurtosis 1); noise lies
    at all distances (normal noise: 3, a little less after the fit).

    Parameters
    ----------
    index : NeighbourSource
        Of the cloud before projection.
    level : float
        What :func:`noise_level` gave; below :data:`SHEETS_FROM` nothing is asked.
    """
    n = len(index.points)
    if level < SHEETS_FROM or n <= 4 * 48:
        return False
    chosen = sample_rows(index.points, SAMPLE)
    kurtosis = np.empty(len(chosen))
    _kurtoses(len(chosen), index.points, chosen, index.knn(48, chosen)[1], kurtosis)
    return bool(np.median(kurtosis) < TWO_SHEETS_BELOW)


def _in_rows(points: Floats, chosen: NDArray[np.int32], near: NDArray[np.int32], few: int) -> bool:
    """Tell whether the nearest neighbours of most points lie on two rows of points, or on one."""
    return bool(on_two_rows(points, chosen, near, few, SINGLE_NOISY).mean() > 0.5)


_FLAT = 6  # neighbours to whom the planes are fitted that tell how flat the flattest parts are
_HUGE = 1e100  # residuals in spacings of points that nearly all share one place; larger ones have no squares


def _white_part(small: Floats, large: Floats) -> float:
    """Return the level of white noise that both residuals share, the second smallest over the quantiles."""
    growth = 3.0**1.5
    small, large = np.minimum(small, _HUGE), np.minimum(large, _HUGE)
    low, high = np.quantile(np.stack([small, large]) ** 2, QUANTILES, axis=1).T
    levels = np.sqrt(np.maximum(0.0, (growth * low - high) / (growth - 1.0))) / QUANTILES_OF_WHITE_NOISE
    return float(np.sort(levels)[1])


@rows
def _quadric_residuals(first, last, points, chosen, neighbours, small, residual):
    """Write the residuals of quadrics over ``small`` and all neighbours, and of a plane over 6, in local spacings."""
    k = neighbours.shape[1]
    f, matrix, right = np.empty(6), np.empty((6, 6)), np.empty(6)
    for row in range(first, last):
        i = chosen[row]
        last = neighbours[row, small - 1]
        dx, dy, dz = points[last, 0] - points[i, 0], points[last, 1] - points[i, 1], points[last, 2] - points[i, 2]
        h = math.sqrt((dx * dx + dy * dy + dz * dz) * math.pi / small) + 1e-300
        residual[row, 0] = quadric_residual(points, i, neighbours, row, small, f, matrix, right) / h
        residual[row, 1] = quadric_residual(points, i, neighbours, row, k, f, matrix, right) / h
        off = plane_of_neighbours(points, i, neighbours, row, np.int64(6))[3]
        last = neighbours[row, 5]
        dx, dy, dz = points[last, 0] - points[i, 0], points[last, 1] - points[i, 1], points[last, 2] - points[i, 2]
        h = math.sqrt((dx * dx + dy * dy + dz * dz) * math.pi / 6) + 1e-300
        residual[row, 2] = off * math.sqrt(7.0 / 4.0) / h


@inner
def quadric_residual(points, i, neighbours, row, k, f, matrix, right):
    """Fit a height quadric over the plane of point i and its first k neighbours; return its unbiased residual."""
    nx, ny, nz, _, cx, cy, cz = plane_of_neighbours(points, i, neighbours, row, k)
    e = tangent_frame(nx, ny, nz)
    last = neighbours[row, k - 1]
    dx, dy, dz = points[last, 0] - points[i, 0], points[last, 1] - points[i, 1], points[last, 2] - points[i, 2]
    scale = 1.0 / (math.sqrt(dx * dx + dy * dy + dz * dz) + 1e-300)
    matrix[:, :] = 0.0
    right[:] = 0.0
    square = 0.0
    for a in range(-1, k):
        j = i if a < 0 else neighbours[row, a]
        x, y, z = points[j, 0] - cx, points[j, 1] - cy, points[j, 2] - cz
        u = (x * e[0] + y * e[1] + z * e[2]) * scale
        v = (x * e[3] + y * e[4] + z * e[5]) * scale
        w = x * nx + y * ny + z * nz
        square += w * w
        f[0], f[1], f[2], f[3], f[4], f[5] = 1.0, u, v, u * u, u * v, v * v
        for p in range(6):
            right[p] += f[p] * w
            for q in range(p + 1):
                matrix[p, q] += f[p] * f[q]
    for p in range(6):
        matrix[p, p] += 1e-9
    load = right.copy()
    solve_spd(matrix, right)
    for p in range(6):
        square -= right[p] * load[p]
    return math.sqrt(max(square, 0.0) / (k - 5))


@inlined
def over_quadric(right, u, v, w):
    """Return how far a place of height w lies above the quadric that :func:`quadric_residual` left in ``right``."""
    return w - (right[0] + right[1] * u + right[2] * v + right[3] * u * u + right[4] * u * v + right[5] * v * v)


@rows
def _kurtoses(first, last, points, chosen, neighbours, kurtosis):
    """Write the kurtosis of the residuals of a quadric over each chosen point and its neighbours."""
    k = neighbours.shape[1]
    f, matrix, right = np.empty(6), np.empty((6, 6)), np.empty(6)
    for row in range(first, last):
        i = chosen[row]
        quadric_residual(points, i, neighbours, row, k, f, matrix, right)  # leaves its coefficients in ``right``
        nx, ny, nz, _, cx, cy, cz = plane_of_neighbours(points, i, neighbours, row, k)
        e = tangent_frame(nx, ny, nz)
        last_one = neighbours[row, k - 1]
        dx, dy, dz = (
            points[last_one, 0] - points[i, 0],
            points[last_one, 1] - points[i, 1],
            points[last_one, 2] - points[i, 2],
        )
        scale = 1.0 / (math.sqrt(dx * dx + dy * dy + dz * dz) + 1e-300)
        second = fourth = 0.0
        for a in range(-1, k):
            j = i if a < 0 else neighbours[row, a]
            x, y, z = points[j, 0] - cx, points[j, 1] - cy, points[j, 2] - cz
            u = (x * e[0] + y * e[1] + z * e[2]) * scale
            v = (x * e[3] + y * e[4] + z * e[5]) * scale
            off = over_quadric(right, u, v, x * nx + y * ny + z * nz)
            second += off * off
            fourth += off * off * off * off
        kurtosis[row] = (k + 1) * fourth / (second * second) if second > 0.0 else 3.0
