"""bound_curve(): a smooth curve with every point of a plane cloud on one side, guaranteed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import kernel
from surfel.bounding.broken_line import CurveFit, as_free
from surfel.bounding.certify import EPS, LEAST, ROUNDS
from surfel.bounding.enclosure import BOUNDARIES, extended
from surfel.bounding.evaluate import cell_of, weights
from surfel.bounding.report import FitReport
from surfel.bounding.scattered import as_data, scattered_surrogate
from surfel.bounding.trial import trial_and_error
from surfel.core.cast import Floats, as_choice, as_count, read_only
from surfel.core.errors import InputError

METHODS = {"scattered": scattered_surrogate, "trial": trial_and_error}


@dataclass(frozen=True, eq=False)
class SafeCurve:
    """A uniform cubic spline over a line, safe for the points it was fitted to. Made by :func:`surfel.bound_curve`.

    Parameters
    ----------
    coefficients : Floats, shape (n + 2,)
        B-spline coefficients with the integer knots ``-3 .. n + 2``.
    low, scale : float
        The parameter of x is ``(x - low) * scale``.
    side, boundary : str
        As for :class:`SafeSpline`.
    report : FitReport
        How it was made and how close it lies.
    """

    coefficients: Floats
    low: float
    scale: float
    side: str
    boundary: str
    report: FitReport

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", read_only(np.array(self.coefficients)))

    def to_domain(self, x: ArrayLike) -> Floats:
        """Return the parameters of abscissae; the domain is ``[0, n - 1]``."""
        return np.asarray((np.asarray(x, dtype=np.float64) - self.low) * self.scale)

    def __call__(self, x: ArrayLike) -> Floats:
        """Return the heights over abscissae, NaN outside the domain."""
        place = np.atleast_1d(self.to_domain(x))
        out = np.empty(place.shape)
        _values(self.coefficients.copy(), place.ravel(), out.ravel())
        return out.reshape(np.shape(x))

    def verify(self, x: ArrayLike, y: ArrayLike) -> tuple[int, float]:
        """Return how many points lie on the wrong side or outside the domain, and by how much the worst does."""
        excess = np.asarray(y, dtype=np.float64) - self(x)
        if self.side == "below":
            excess = -excess
        bad = ~(excess <= 0.0)
        worst = np.where(np.isnan(excess[bad]), np.inf, excess[bad]).max(initial=0.0)
        return int(bad.sum()), float(worst)

    def to_scipy(self) -> Any:
        """Return the spline as a :class:`scipy.interpolate.BSpline` of the parameter, NaN outside the domain."""
        from scipy.interpolate import BSpline

        n = len(self.coefficients) - 2
        return BSpline(np.arange(-3.0, n + 3.0), self.coefficients, 3, extrapolate=False)


def bound_curve(
    x: ArrayLike,
    y: ArrayLike,
    n: int = 20,
    side: str = "above",
    method: str = "scattered",
    boundary: str = "open",
    free: ArrayLike | None = None,
) -> SafeCurve:
    """Fit a smooth curve that has every point of the plane on one side (Myles and Peters, secs. 3 to 5).

    Parameters
    ----------
    x, y : array_like, shape (k,)
        The points; the curve is a function of x.
    n : int
        Coefficients, at least 4; ``open`` and ``clamped`` both add one at each end by their rule.
    side : {"above", "below"}
        Where the curve lies.
    method : {"scattered", "trial"}
        Sec. 5, or the trial and error of sec. 3.
    boundary : {"open", "clamped"}
        A straight end, or the paper's repeated coefficient.
    free : array_like of bool, shape (n,), optional
        Segments labelled free: there energy shapes the curve, not the data. It is raised over them all the same.

    Returns
    -------
    SafeCurve
        ``verify(x, y)`` is (0, 0.0).

    Raises
    ------
    InputError
        If there are no points, some are not finite, or an option is unknown.

    Examples
    --------
    >>> import numpy as np, surfel
    >>> x = np.linspace(0.0, 1.0, 500)
    >>> curve = surfel.bound_curve(x, np.sin(9.0 * x), n=16)
    >>> curve.verify(x, np.sin(9.0 * x))
    (0, 0.0)
    """
    count = as_count(n, "n", 4)
    sign = 1.0 if as_choice(side, "side", ("above", "below")) == "above" else -1.0
    fit = METHODS[as_choice(method, "method", tuple(METHODS))]
    as_choice(boundary, "boundary", BOUNDARIES)
    place, height = _as_plane(x, y)
    low, scale = _placed(place, count)
    t = (place - low) * scale
    unit = float(np.abs(height).max()) or 1.0
    found = fit(t, sign * height / unit, count, as_free(free, count), boundary)
    return _certified(
        SafeCurve(extended(found.b, boundary) * unit, low, scale, side, boundary, _blank()), found, t, height
    )


def _as_plane(x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
    place = np.asarray(x, dtype=np.float64) if np.ndim(x) == 1 else np.empty(0)
    if place.size == 0:
        raise InputError(f"x and y must be vectors of one length, at least 1; got shape {np.shape(x)}")
    _, height, _ = as_data(np.zeros(len(place)), y, 2)
    if not np.isfinite(place).all():
        raise InputError("x must be finite; drop the other points first")
    if max(np.abs(place).max(), np.abs(height).max()) > 1e300:
        raise InputError("coordinates beyond 1e300 cannot be bounded in double precision; scale them down")
    return place, height


def _placed(x: Floats, n: int) -> tuple[float, float]:
    """Return where parameters begin and their scale: all x come to lie in [0, n - 1]."""
    low, high = float(x.min()), float(x.max())
    width = high - low
    if not width > max(abs(low), abs(high)) * 1e-15 + 1e-290:
        width = max(1.0, abs(low) * 1e-9)
        low -= 0.5 * width
    scale = (n - 1) / width
    while (high - low) * scale > n - 1:
        scale = float(np.nextafter(scale, 0.0))
    return low, scale


def _blank() -> FitReport:
    return FitReport("", 0, 0.0, 0.0, 0, 0.0)


def _certified(curve: SafeCurve, found: CurveFit, t: Floats, y: Floats) -> SafeCurve:
    """Raise the curve over every point, add the slack, verify, and turn it to its side."""
    sign = 1.0 if curve.side == "above" else -1.0
    c, z = curve.coefficients.copy(), sign * y
    value, slack = np.empty(len(t)), 0.0
    lifts = 0
    for lifts in range(ROUNDS):
        _values(c, t, value)
        excess = z - value
        if lifts > 0 and not excess.max() > 0.0:
            break
        c = _raised(c, t, excess, curve.boundary)
        size = np.pad(np.abs(c), 3, constant_values=0.0)
        extra = 32.0 * EPS * np.max([size[i : i + len(c)] for i in range(7)], axis=0) + LEAST
        if curve.boundary == "clamped":
            extra[[0, 1]], extra[[-2, -1]] = max(extra[0], extra[1]), max(extra[-2], extra[-1])
        slack = max(slack, float(extra.max()))
        c = c + extra
    else:
        c = c + 2.0 * max(float(excess.max()), 0.0) + 64.0 * EPS * float(np.abs(c).max())
        _values(c, t, value)
    gap = value - z
    report = FitReport(
        mode="curve",
        points=len(t),
        gap_mean=float(gap.mean()),
        gap_max=float(gap.max()),
        rounds=found.solves,
        slack=slack,
        fallbacks=int(found.fallback),
        compression=2.0 * len(t) / len(c),
    )
    return replace(curve, coefficients=sign * c, report=report)


def _raised(c: Floats, t: Floats, excess: Floats, boundary: str) -> Floats:
    """Return coefficients raised by the largest excess over the cells of their support."""
    cells = len(c) - 3
    by_cell = np.zeros(cells)
    np.maximum.at(by_cell, np.minimum(t.astype(np.int64), cells - 1), excess)
    lift = np.zeros(len(c))
    for i in range(4):
        np.maximum(lift[i : i + cells], by_cell, out=lift[i : i + cells])
    if boundary == "clamped":
        lift[1], lift[-2] = max(lift[0], lift[1]), max(lift[-1], lift[-2])
        lift[0], lift[-1] = lift[1], lift[-2]
    return np.asarray(c + lift)


@kernel
def _values(c, t, out):
    cells = c.shape[0] - 3
    for i in range(t.shape[0]):
        if not (t[i] >= 0.0 and t[i] <= cells):
            out[i] = np.nan
            continue
        h = cell_of(t[i], cells)
        w0, w1, w2, w3 = weights(t[i] - h)
        out[i] = ((w0 * c[h] + w1 * c[h + 1]) + (w2 * c[h + 2] + w3 * c[h + 3])) / 6.0
