"""Mode ``fast``: a reference spline through the upper points, and the safe surface over the residuals added to it.

For any reference spline q, ``q + safe(z - q)`` is safe. The reference takes the staircase out of the paper's scheme,
which is its main looseness: what is left to be bounded by corner values is noise and detail below a cell.
"""

from __future__ import annotations

import numpy as np

from surfel.bounding.candidates import Rows
from surfel.bounding.job import Job, Outcome
from surfel.bounding.normal import Unknowns
from surfel.bounding.reference import least_squares
from surfel.core.cast import Floats

SMOOTHING = 1e-9
"""Bending energy beside a mean square of one range."""

BELOW = 0.05
"""Weight in the second least-squares fit of points that lie below the first: the reference leans on the upper ones."""

WIDE = 80
"""Systems of a broader band are solved by steps instead of factors."""


def fit_fast(job: Job) -> Outcome:
    """Return the reference spline; the residuals of all points are bounded afterwards."""
    z = job.scale.inward(job.height)
    return Outcome(job.scale.outward(upper_spline(job.uv, z, job.unknowns, job.boundary)), 2)


def upper_spline(uv: Floats, z: Floats, unknowns: Unknowns, boundary: str) -> Floats:
    """Return the coefficients of a smooth spline that leans on the upper ones of some points; z from -1 to 1."""
    if unknowns.band > WIDE:
        from surfel.bounding.iterated import upper_by_steps

        return upper_by_steps(uv, z, unknowns, boundary, SMOOTHING, BELOW)
    rows = Rows.of(uv, unknowns)
    first = least_squares(rows, z, bending=SMOOTHING)
    weight = np.where(z > rows.times(first), 1.0, BELOW)
    return unknowns.spread(least_squares(rows, z, weight, bending=SMOOTHING))
