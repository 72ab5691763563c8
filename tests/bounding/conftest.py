"""Safe splines of any shape, made without a fit."""

from __future__ import annotations

import numpy as np
import pytest

from surfel.bounding.frame import Frame, rotation_onto
from surfel.bounding.report import FitReport
from surfel.bounding.spline import SafeSpline
from surfel.bounding.trim import trimmed
from surfel.core.cast import as_direction


@pytest.fixture
def make_spline():
    """Return what makes a spline from coefficients (random ones by default) over cells that have data."""

    def make(
        coefficients=None,
        *,
        shape=(9, 7),
        direction=(0, 0, 1),
        side="above",
        occupancy=None,
        low=(0.0, 0.0),
        scale=None,
    ):
        if coefficients is None:
            coefficients = np.random.default_rng(0).normal(size=(shape[0] + 2, shape[1] + 2))
        n, m = np.subtract(np.shape(coefficients), 2)
        cells = np.array([n - 1, m - 1])
        occupancy = np.full(cells, 15, np.uint8) if occupancy is None else np.asarray(occupancy, np.uint8)
        scale = np.ones(2) if scale is None else np.asarray(scale, float)
        frame = Frame(rotation_onto(as_direction(direction, "direction")), np.asarray(low, float), scale, cells)
        report = FitReport("fast", 0, 0.0, 0.0, 0, 0.0)
        return SafeSpline(frame, np.asarray(coefficients, float), side, "open", occupancy, trimmed(occupancy), report)

    return make
