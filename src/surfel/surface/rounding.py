"""Rounded coordinates: files of few digits, integers with a scale, single precision far from the origin.

Coordinates that were rounded are whole multiples of a step. That is noise of a known size, and it can be read off even
where noise cannot be seen in the points: flat parts along an axis stay flat, and only what is oblique gets rough. Grids
of heights are multiples of a step as well, along the axes of the grid; there it is the distance of the points, and the
coordinates are right.
"""

from __future__ import annotations

import math

import numpy as np

from surfel.core.cast import Floats
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import sample_rows

SMALLEST = 0.01
"""A step of fewer spacings does not matter."""

EXACT = 0.001
"""How far coordinates may lie off the multiples of the smallest step, as a share of it."""

GRID_FROM, ON_A_GRID = 0.3, 0.9
"""Steps of so many spacings are rows of a grid, where so many of the points have their nearest neighbour in the same
row, or column."""

ALL_TAKEN = 1.5
"""A step is none of a rounding where most places are more than so many of it from the next: a grid has one step between
its places, and another to where a face happens to lie."""

_POINTS = 4000
_FEW, _GAPS = 8, 64  # places that tell nothing; gaps that are looked at
_OFF = 0.1  # how far a place may lie off the multiples of the step, in steps
_OF_A_STEP = 1.0 / math.sqrt(12.0)  # standard deviation of what rounding to a step leaves


def rounding_level(hood: Neighbourhoods) -> float:
    """Return the noise, in spacings, that rounding of the coordinates made; 0 where they were not rounded.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the points as they came, but for a shift and a scale; rounded coordinates that were turned are not told.
    """
    spacing = float(np.median(hood.spacing))
    if not spacing > 0.0:
        return 0.0
    chosen = sample_rows(hood.points, _POINTS)
    place = hood.points[chosen]
    steps = np.array([_step_of(column, SMALLEST * spacing) for column in place.T])
    for axis in np.flatnonzero(steps):
        steps[axis] *= _is_taken(place[:, axis], float(steps[axis]))
    wide = steps >= GRID_FROM * spacing
    apart = np.abs(hood.points[hood.near[chosen, 0]] - place)[:, wide]
    if wide.any() and ((apart > 0.5 * steps[wide]).sum(axis=1) <= 1).mean() > ON_A_GRID:
        steps[wide] = 0.0
    return _OF_A_STEP * float(steps.max()) / spacing


def _step_of(values: Floats, least: float) -> float:
    """Return the step, of ``least`` or more, of which all values but for a shift are multiples; 0 if there is none."""
    places = np.unique(values)
    blur = EXACT * least  # what sums of rounded numbers are off
    gaps = np.sort(np.diff(places))
    gaps = gaps[gaps > blur]
    if len(gaps) < _FEW:
        return 0.0
    step = 0.0
    for gap in gaps[:: max(1, len(gaps) // _GAPS)]:
        step = _common(float(gap), step, blur)
        if step < least:
            return 0.0
    extent = float(places[-1] - places[0])
    turns = (places - places[0]) * (round(extent / step) / extent)
    return step if float(np.abs(turns - np.round(turns)).max()) < _OFF else 0.0


def _is_taken(values: Floats, step: float) -> bool:
    """Tell whether most multiples of the step are among the values, as far as so few can show it."""
    places = np.unique(np.round(values / step))
    return 2.0 * (places[-1] - places[0]) > len(values) or float(np.median(np.diff(places))) < ALL_TAKEN


def _common(large: float, small: float, blur: float) -> float:
    """Return the greatest common divisor of two lengths that are not exact."""
    while small > blur:
        rest = large % small
        large, small = small, min(rest, small - rest)
    return large
