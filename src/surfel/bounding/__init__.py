"""Smooth surfaces with every point of a cloud on one side, guaranteed; curves likewise, and the paper's own pieces.

A. Myles and J. Peters, *Fast Safe Spline Surrogates for Large Point Clouds*. What is behind a name is imported when the
name is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from surfel.bounding.broken_line import CurveFit, broken_line_surrogate
    from surfel.bounding.corners import over_corners
    from surfel.bounding.curve import SafeCurve, bound_curve
    from surfel.bounding.doors import bound
    from surfel.bounding.enclosure import lower_at, lower_broken_line
    from surfel.bounding.pairs import sandwich
    from surfel.bounding.report import FitReport
    from surfel.bounding.scattered import scattered_surrogate
    from surfel.bounding.spline import SafeSpline
    from surfel.bounding.trial import trial_and_error

__all__ = [
    "CurveFit",
    "FitReport",
    "SafeCurve",
    "SafeSpline",
    "bound",
    "bound_curve",
    "broken_line_surrogate",
    "lower_at",
    "lower_broken_line",
    "over_corners",
    "sandwich",
    "scattered_surrogate",
    "trial_and_error",
]

_HOME = {
    "CurveFit": "broken_line",
    "FitReport": "report",
    "SafeCurve": "curve",
    "SafeSpline": "spline",
    "bound": "doors",
    "bound_curve": "curve",
    "broken_line_surrogate": "broken_line",
    "lower_at": "enclosure",
    "lower_broken_line": "enclosure",
    "over_corners": "corners",
    "sandwich": "pairs",
    "scattered_surrogate": "scattered",
    "trial_and_error": "trial",
}


def __getattr__(name: str) -> object:
    """Import what is behind a public name when it is first asked for (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module 'surfel.bounding' has no attribute {name!r}")
    from importlib import import_module

    value: object = getattr(import_module(f"surfel.bounding.{_HOME[name]}"), name)
    globals()[name] = value
    return value
