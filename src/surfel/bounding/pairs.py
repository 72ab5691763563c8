"""sandwich(): two smooth surfaces with all points between them, that provably do not cross."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from surfel.bounding.bezier import bezier_nets
from surfel.bounding.certify import EPS, raised
from surfel.bounding.doors import as_options, fit
from surfel.bounding.source import Source
from surfel.bounding.spline import SafeSpline
from surfel.core.cast import Floats
from surfel.core.errors import SurfelError
from surfel.core.execute import Progress

_TURNS = 16  # by the last one depths of rounding have been multiplied by thousands


def sandwich(
    points: Any,
    direction: ArrayLike = (0.0, 0.0, 1.0),
    shape: tuple[int, int] | int = (20, 20),
    mode: str = "fast",
    boundary: str = "open",
    symmetric: bool = False,
    progress: Progress | None = None,
) -> tuple[SafeSpline, SafeSpline]:
    """Fit one surface above all points and one below, that do not cross anywhere on the domain.

    The paper claims that two safe surfaces never cross. Between the points they may: each is safe at the points only.
    So the lower one follows the upper one through cells without points. Then the Bezier coefficients of their
    difference are computed for every cell, and where one is negative both surfaces give way by half of it, which only
    takes them farther from the points.

    Parameters
    ----------
    points, direction, shape, mode, boundary, symmetric, progress
        As for :func:`surfel.bound`. Chunks are passed over four times.

    Returns
    -------
    upper, lower : SafeSpline
        On one grid. Every Bezier coefficient of ``upper - lower`` is at least 0, in exact arithmetic.

    Raises
    ------
    InputError
        As :func:`surfel.bound`.

    Examples
    --------
    >>> import numpy as np, surfel
    >>> p = np.random.default_rng(0).random((1000, 3))
    >>> upper, lower = surfel.sandwich(p, shape=(8, 8))
    >>> bool((upper.coefficients - lower.coefficients).mean() > 1.0)
    True
    """
    tell = progress or (lambda share, what: None)
    source = Source(points)
    above = as_options(direction, shape, "above", mode, boundary, symmetric)
    upper = fit(source, above, lambda share, what: tell(0.5 * share, what))
    below = replace(above, side="below")
    lower = fit(source, below, lambda share, what: tell(0.5 + 0.5 * share, what), upper.coefficients)
    return apart(upper, lower)


def apart(upper: SafeSpline, lower: SafeSpline) -> tuple[SafeSpline, SafeSpline]:
    """Return two surfaces of one grid, moved from each other where the Bezier net of their difference is negative."""
    top, bottom = upper.coefficients, lower.coefficients
    clamped = upper.boundary == "clamped"
    for turn in range(_TURNS):
        depth = overlap(top, bottom)
        if not depth.max() > 0.0:
            return _moved(upper, top), _moved(lower, bottom)
        lift = 0.51 * 2.0**turn * depth  # a depth of a few units of rounding may be rounded away when it is added
        top, bottom = raised(top, lift, clamped), -raised(-bottom, lift, clamped)
    raise SurfelError("two surfaces could not be moved apart; please report this with the points")


def overlap(top: Floats, bottom: Floats) -> Floats:
    """Return how far the Bezier net of ``top - bottom`` of each cell may reach below zero, rounding included.

    Parameters
    ----------
    top, bottom : Floats, shape (n + 2, m + 2)
        Coefficients of two splines of one grid.

    Returns
    -------
    Floats, shape (n - 1, m - 1)
        Positive where the nets do not prove that the surfaces are apart.
    """
    windows = np.lib.stride_tricks.sliding_window_view(np.maximum(np.abs(top), np.abs(bottom)), (4, 4))
    rounding = 32.0 * EPS * windows.max(axis=(2, 3))
    return np.asarray(rounding - bezier_nets(top - bottom).min(axis=(2, 3)))


def _moved(spline: SafeSpline, coefficients: Floats) -> SafeSpline:
    moved = np.abs(coefficients - spline.coefficients)
    if not moved.any():
        return spline
    sign = 1.0 if spline.side == "above" else -1.0
    memory, report = spline.memory, spline.report
    gap = report.gap_mean
    if memory is not None:
        gap = memory.mean_gap(coefficients, sign)
    report = replace(report, gap_mean=gap, gap_max=report.gap_max + float(moved.max()))
    return replace(spline, coefficients=coefficients, report=report)
