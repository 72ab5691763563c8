"""Estimate: a value and how far it may be off."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from surfel.core.cast import Floats, as_number
from surfel.core.errors import InputError


@dataclass(frozen=True, eq=False)
class Estimate:
    """A number, or an array of numbers, with its standard error.

    Where no honest number exists, ``standard_error`` is infinite, ``reliable`` is False and ``reason`` says why.

    Parameters
    ----------
    value : float or Floats
        The estimate, in the units of the input (squared for an area, cubed for a volume).
    standard_error : float or Floats
        One standard deviation, of the shape of ``value``.
    reliable : bool
        Whether the interval can be trusted.
    reason : str
        Why not; empty where it can.
    freedom : float
        Degrees of freedom of the standard error: the interval is Student's for a finite number, normal for infinity.

    Examples
    --------
    >>> from surfel import Estimate
    >>> area = Estimate(0.0571287, 0.00004)
    >>> print(area)
    0.05713 +- 0.00004
    >>> low, high = area.interval(0.95)
    >>> low < 0.0571 < high
    True
    """

    value: Any
    standard_error: Any
    reliable: bool = True
    reason: str = ""
    freedom: float = math.inf

    @classmethod
    def unknown(cls, reason: str, value: Any = math.nan) -> Estimate:
        """Return the estimate that says that there is no honest number, and why."""
        error = np.full(np.shape(value), math.inf) if np.shape(value) else math.inf
        return cls(value, error, reliable=False, reason=reason)

    def interval(self, confidence: float = 0.95) -> tuple[Any, Any]:
        """Return the two-sided confidence interval.

        Parameters
        ----------
        confidence : float
            Between 0 and 1, both excluded.

        Returns
        -------
        low, high : float or Floats
            Of the shape of ``value``.

        Raises
        ------
        InputError
            If ``confidence`` is not between 0 and 1.
        """
        level = as_number(confidence, "confidence")
        if not 0.0 < level < 1.0:
            raise InputError(f"confidence must be between 0 and 1; got {level:g}")
        half = _quantile(0.5 + 0.5 * level, self.freedom) * np.asarray(self.standard_error)
        low, high = np.asarray(self.value) - half, np.asarray(self.value) + half
        return (float(low), float(high)) if low.ndim == 0 else (low, high)

    def scaled(self, factor: float) -> Estimate:
        """Return the estimate of ``factor`` times the quantity."""
        return Estimate(
            self.value * factor, self.standard_error * abs(factor), self.reliable, self.reason, self.freedom
        )

    def to_dict(self, confidence: float = 0.95) -> dict[str, Any]:
        """Return plain Python objects: value, standard_error, interval, reliable, reason; None where not finite."""
        low, high = self.interval(confidence)
        return {
            "value": _plain(self.value),
            "standard_error": _plain(self.standard_error),
            "interval": [_plain(low), _plain(high)],
            "reliable": self.reliable,
            "reason": self.reason,
        }

    def __float__(self) -> float:
        return float(self.value)

    def __str__(self) -> str:
        if np.ndim(self.value) == 0:
            return _with_error(float(self.value), float(self.standard_error))
        pairs = zip(np.ravel(self.value), np.ravel(self.standard_error), strict=True)
        return "[" + ", ".join(_with_error(float(v), float(e)) for v, e in pairs) + "]"


def at_best_halved(estimate: Estimate, before: Estimate) -> Estimate:
    """Return an estimate from twice the points, with an error of at least half of that before.

    Who doubles until an error is small stops where it happens to look small: of 95 % intervals 92 % then hold the
    truth. No error falls faster than the number of points grows, so the one before says what this one is at least.

    Parameters
    ----------
    estimate, before : Estimate
        Of the same scalar.
    """
    least = 0.5 * float(before.standard_error)
    return replace(estimate, standard_error=least) if float(estimate.standard_error) < least else estimate


def combine_errors(*errors: Floats | float) -> Any:
    """Return the root of the sum of squares of independent errors, by component."""
    total: Any = 0.0
    for error in errors:
        total = np.hypot(total, error)  # squares of single errors may over- or underflow
    return total


def _quantile(level: float, freedom: float) -> float:
    if math.isinf(freedom):
        return NormalDist().inv_cdf(level)
    from scipy.special import stdtrit

    return float(stdtrit(freedom, level))


def _with_error(value: float, error: float) -> str:
    """Round the error to one digit (two where it starts with 1) and the value to the same place."""
    if not (math.isfinite(value) and math.isfinite(error)) or error <= 0.0:
        return f"{value:.6g} +- {error:.1g}"
    place = math.floor(math.log10(error))
    if round(error / 10.0**place) == 1:
        place -= 1
    if not -12 < place < 6 or abs(value) >= 1e12:
        return f"{value:.6g} +- {error:.1g}"
    digits = max(0, -place)
    return f"{round(value, -place):.{digits}f} +- {round(error, -place):.{digits}f}"


def _plain(value: Any) -> Any:
    array = np.asarray(value, float)
    if array.ndim:
        return [_plain(v) for v in array]
    return float(array) if math.isfinite(array) else None
