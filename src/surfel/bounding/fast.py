"""Mode ``fast``: a reference spline through the upper points, and the safe surface over the residuals added to it.

For any reference spline q, ``q + safe(z - q)`` is safe. The reference takes the staircase out of the paper's scheme,
which is its main looseness: what is left to be bounded by corner values is noise and detail below a cell.
"""

from __future__ import annotations

import numpy as np

from surfel.bounding.evaluate import values
from surfel.bounding.job import Job, Outcome
from surfel.bounding.reference import least_squares

SMOOTHING = 1e-9
"""Bending energy beside a mean square of one range."""

BELOW = 0.05
"""Weight in the second least-squares fit of points that lie below the first: the reference leans on the upper ones."""


def fit_fast(job: Job) -> Outcome:
    """Return the reference spline; the residuals of all points are bounded afterwards."""
    z = job.scale.inward(job.height)
    first = least_squares(job.uv, z, job.unknowns, bending=SMOOTHING)
    weight = np.where(z > values(first, job.uv), 1.0, BELOW)
    second = least_squares(job.uv, z, job.unknowns, weight, bending=SMOOTHING)
    return Outcome(job.scale.outward(second), 2)
