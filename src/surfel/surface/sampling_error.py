"""How far the area of a cloud may be off, judged from the cloud alone.

Nothing but the cloud tells it, so the parts are of three kinds. The cloud is measured again with half of its points,
twice: what that changes is the scale of everything that depends on the density, rounding of relief and lost detail
among it. The corrections that were made are not exact, and err by a share of themselves: borders, relief between the
points, bent patches, noise. And nothing is claimed to be known exactly.

How much each part counts was fitted to clouds of known area by maximum likelihood, with a Student distribution of four
degrees of freedom, and the whole is scaled by one number so that 95 % of these clouds are held. The benchmark
``coverage clouds`` names their shapes, and counts on others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from surfel.core.cast import Floats
from surfel.surface.border import LEAST_SHARE, in_crease
from surfel.surface.gaps import gap_area
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import axial_ranks
from surfel.surface.patches import LocalPatches, local_patches

HALVES_FROM = 200
"""Fewer points are not cut in halves."""

LARGEST_PART = 100_000
"""Of larger clouds two parts of so many points are measured instead of halves, and the errors extrapolated."""

TOO_NOISY = 0.6
"""Noise, in spacings, above which the surface cannot be told from the noise."""

THINNED = 1.15
BORDER, BORDER_BIAS, CREASE, OPEN = 2.8, 0.1, 1.2, 1.6
RELIEF, BENDS, UNSEEN_NOISE = 1.8, 0.3, 17.0
LEFT_RELIEF, FLATTENED, DRAWN_IN, LEFT_NOISE, WIDENED = 0.7, 3.1, 1.7, 0.35, 1.15
FLOOR = 4e-4
GAPS = 1.25
"""How much each part counts in the half-width of a 95 % interval. The bias of a border is in cells, not in shares:
those of random points are larger, and no less certain. Of gaps narrower ones go unseen beside those that are seen."""

SCALED = 1.06
"""The number by which the whole is scaled, so that 95 % of the calibrating clouds are held."""


@dataclass(frozen=True)
class SamplingError:
    """The parts of the half-width of a 95 % interval, in units of the area.

    Parameters
    ----------
    border : float
        What the outermost points stand for.
    roughness : float
        Relief finer than the spacing, and patches that bend.
    noise : float
        What projection leaves and flattens, or what was not worth projecting.
    thinning : float
        How the area changes when half of the points are left out.
    halves : float
        How the two halves differ.
    floor : float
        What is never claimed to be known.
    gaps : float
        Triangles wider than chance makes them, which may span parts that were never scanned.
    """

    border: float
    roughness: float
    noise: float
    thinning: float
    halves: float
    floor: float
    gaps: float = 0.0

    @property
    def half_width(self) -> float:
        """The root of the sum of squares of the parts, scaled but for the gaps."""
        parts = (self.border, self.roughness, self.noise, self.thinning, self.halves, self.floor)
        return math.hypot(SCALED * math.hypot(*parts), self.gaps)

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
    thinning, halves = _thinned(hood, normals, whole)
    beyond = max(0.0, THINNED * thinning - float(whole.doubt.sum()))  # halves of a grid have another border
    parts = _border(whole), _roughness(whole), _noise(whole), beyond, THINNED * halves
    return SamplingError(*parts, FLOOR * whole.area, GAPS * gap_area(whole.hood, whole.cells))


def _border(whole: LocalPatches) -> float:
    """Return what the shares of the border points leave open: each by itself, and all of them together.

    In a crease, or where sheets nearly meet, points lack neighbours as well. These are no borders, and what is missing
    there is not what was added. Of a grid nothing tells whether its border runs through the outermost points.
    """
    bare = np.flatnonzero(whole.border > 0.0)
    shares, bias = whole.border[bare], BORDER_BIAS / max(whole.share, LEAST_SHARE)
    alone, together = BORDER * math.sqrt(float((shares**2).sum())), bias * float(shares.sum())
    there = in_crease(whole.hood.points, whole.normals, whole.hood.near, bare)
    creased = CREASE * float(shares[there].sum())
    opened = 0.0
    if not whole.random_border:
        lost = (whole.cells.closed == 0) & (whole.doubt == 0.0)
        opened = OPEN * float((whole.hood.spacing[lost] ** 2).sum())
    return math.hypot(alone, together, creased, opened, float(whole.doubt.sum()))


def _roughness(whole: LocalPatches) -> float:
    bends = BENDS * float((whole.cells.area * whole.cells.curved).sum())
    return math.hypot(bends, (LEFT_RELIEF if whole.projected else RELIEF) * whole.roughness)


def _noise(whole: LocalPatches) -> float:
    """Return a share of each thing that was set right after projection; or of what noise may do that was left alone."""
    if not whole.projected:
        return UNSEEN_NOISE * whole.area * whole.noise * whole.noise  # an upper bound: much of it may be relief
    relief, drawn_in, noise, widened = whole.restored
    return math.hypot(FLATTENED * relief, DRAWN_IN * drawn_in, LEFT_NOISE * noise, WIDENED * widened)


def _thinned(hood: Neighbourhoods, normals: Floats | None, whole: LocalPatches) -> tuple[float, float]:
    """Return by how much halving the points changes the area, and by how much the halves differ from their mean."""
    part = min(len(hood) // 2, LARGEST_PART)
    first, second = _parts(hood, normals, whole, part)
    if not math.isfinite(first + second):
        return whole.area, 0.0
    sparser = len(hood) / part  # from here the error at n points is extrapolated; both factors are 1 at 2
    change = abs(whole.area - 0.5 * (first + second)) * (2.0**0.75 - 1.0) / (sparser**0.75 - 1.0)
    return change, 0.5 * abs(first - second) * math.sqrt(2.0 / sparser)


def _parts(hood: Neighbourhoods, normals: Floats | None, whole: LocalPatches, size: int) -> tuple[float, float]:
    """Return the areas of two disjoint parts of the points; which point goes where depends on its place alone."""
    n = len(hood)
    if n < HALVES_FROM:
        return math.nan, math.nan
    ranks = axial_ranks(hood.points)
    noise = whole.noise * math.sqrt(size / n)
    areas = []
    for part in (0, 1):
        chosen = ranks[np.minimum((np.arange(size) * n) // size + part * max(1, n // (2 * size)), n - 1)]
        thinned = hood.subset(np.sort(chosen))
        areas.append(local_patches(thinned, normals, noise, sheets=whole.sheets, falls=whole.falls).area)
    return areas[0], areas[1]
