"""How far the area of a cloud may be off, judged from the cloud alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from surfel.core.cast import Floats
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import axial_ranks
from surfel.surface.patches import LocalPatches, local_patches

FLOOR = 3e-4
"""No interval is narrower than this share of the area."""

HALVES_FROM = 200
"""Fewer points are not cut in halves."""

LARGEST_PART = 100_000
"""Of larger clouds two parts of so many points are measured instead of halves, and the errors extrapolated."""

TOO_NOISY = 0.6
"""Noise, in spacings, above which the surface cannot be told from the noise."""


@dataclass(frozen=True)
class SamplingError:
    """The parts of the half-width of a 95 % interval, in units of the area.

    Parameters
    ----------
    border : float
        What the outermost points stand for.
    roughness : float
        Relief finer than the spacing.
    noise : float
        What projection leaves, or what was not worth projecting.
    thinning : float
        How the area changes when half of the points are left out.
    halves : float
        How the two halves differ.
    floor : float
        What is never claimed to be known.
    """

    border: float
    roughness: float
    noise: float
    thinning: float
    halves: float
    floor: float

    @property
    def half_width(self) -> float:
        """The root of the sum of squares of the parts, doubled: calibrated on shapes, see the benchmarks."""
        parts = (self.border, self.roughness, self.noise, 2.0 * self.thinning, self.halves, self.floor)
        return 2.0 * math.sqrt(sum(part * part for part in parts))

    @property
    def standard_error(self) -> float:
        """The half-width as a standard deviation of a normal error."""
        return self.half_width / 1.959964


def sampling_error(hood: Neighbourhoods, normals: Floats | None, whole: LocalPatches) -> SamplingError:
    """Judge the error of the area of ``whole``.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the cleaned points before projection.
    normals : Floats, shape (m, 3), optional
        In the order of the original cloud.
    whole : LocalPatches
        Of all points.

    Returns
    -------
    SamplingError
        The parts of the half-width.
    """
    area, noise = whole.area, whole.noise
    opened = whole.cells.closed == 0
    bare = whole.border > 0.0
    border = math.sqrt(float((whole.border[bare] ** 2).sum())) + 0.15 * float(whole.border.sum())
    if not whole.random_border:
        border = math.hypot(border, 0.5 * float((whole.hood.spacing[opened] ** 2).sum()))
    if whole.projected:
        roughness, noisy = 0.0, area * 0.015 * noise + 0.5 * whole.roughness
    else:
        roughness, noisy = 0.5 * whole.roughness, area * 27.0 * noise * noise
    part = min(len(hood) // 2, LARGEST_PART)
    first, second = _parts(hood, normals, noise, part)
    thinning, halves = area, 0.0
    if math.isfinite(first + second):
        sparser = len(hood) / part  # from here the error at n points is extrapolated; both factors are 1 at 2
        thinning = abs(area - 0.5 * (first + second)) * (2.0**0.75 - 1.0) / (sparser**0.75 - 1.0)
        halves = 0.5 * abs(first - second) * math.sqrt(2.0 / sparser)
    return SamplingError(border, roughness, noisy, thinning, halves, FLOOR * area)


def _parts(hood: Neighbourhoods, normals: Floats | None, noise: float, size: int) -> tuple[float, float]:
    """Return the areas of two disjoint parts of the points; which point goes where depends on its place alone."""
    n = len(hood)
    if n < HALVES_FROM:
        return math.nan, math.nan
    ranks = axial_ranks(hood.points)
    areas = []
    for part in (0, 1):
        chosen = ranks[np.minimum((np.arange(size) * n) // size + part * max(1, n // (2 * size)), n - 1)]
        thinned = hood.subset(np.sort(chosen))
        areas.append(local_patches(thinned, normals, noise * math.sqrt(size / n)).area)
    return areas[0], areas[1]
