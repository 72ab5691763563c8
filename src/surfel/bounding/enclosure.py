"""Broken lines below a uniform cubic spline: eqs. (1), (3) and (5) of Myles and Peters.

A curve here has the coefficients ``b_0 .. b_{n-1}`` at the abscissae ``0 .. n - 1``; the two beyond its ends
follow from the boundary rule: ``clamped`` repeats the last one (the paper), ``open`` carries on in a straight line, so
that the second difference at the end is zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import inlined, kernel
from surfel.bounding.evaluate import cell_of
from surfel.core.cast import Floats, as_choice
from surfel.core.errors import InputError

BOUNDARIES = ("open", "clamped")


def extended(b: Floats, boundary: str = "clamped") -> Floats:
    """Return ``b_{-1}, b_0 .. b_{n-1}, b_n``: the B-spline coefficients with the two that the boundary rule adds."""
    is_open = as_choice(boundary, "boundary", BOUNDARIES) == "open"
    first = 2.0 * b[0] - b[1] if is_open else b[0]
    last = 2.0 * b[-1] - b[-2] if is_open else b[-1]
    return np.concatenate([[first], b, [last]])


def lower_broken_line(b: ArrayLike, boundary: str = "clamped") -> Floats:
    """Return the breakpoints of a broken line below the spline, eq. (3) (Lemma 4.1).

    ``l_i = b_i + min(D_i b, 0) / 6`` at the abscissae 0 .. n - 1; the spline lies above the broken line everywhere.

    Parameters
    ----------
    b : array_like, shape (n,)
        Coefficients at 0 .. n - 1, at least 2.
    boundary : str
        ``clamped`` or ``open``.

    Returns
    -------
    Floats, shape (n,)
        Heights of the breakpoints.

    Raises
    ------
    InputError
        If ``b`` is not a vector of at least two numbers, or the boundary is unknown.

    Examples
    --------
    >>> lower_broken_line([0.0, 6.0, 0.0])
    array([0., 4., 0.])
    """
    coefficients = as_coefficients(b)
    is_open = as_choice(boundary, "boundary", BOUNDARIES) == "open"
    return lower_at(coefficients, np.arange(len(coefficients), dtype=np.float64), "open" if is_open else "clamped")


def lower_at(b: ArrayLike, t: ArrayLike, boundary: str = "clamped") -> Floats:
    """Return the lower bound of the spline at chosen breakpoints, eq. (5).

    Joined by straight lines, with 0 .. n - 1 among the breakpoints, these values lie below the spline everywhere
    (Lemma 5.1); at the breakpoints themselves they do with any choice of them.

    Parameters
    ----------
    b : array_like, shape (n,)
        Coefficients at 0 .. n - 1.
    t : array_like, shape (k,)
        Breakpoints in [0, n - 1].
    boundary : str
        ``clamped`` or ``open``.

    Returns
    -------
    Floats, shape (k,)
        One for each breakpoint.

    Examples
    --------
    >>> lower_at([0.0, 6.0, 0.0, 0.0], [1.0, 0.5])
    array([4.  , 2.75])
    """
    coefficients, places = as_coefficients(b), np.array(t, dtype=np.float64)
    is_open = as_choice(boundary, "boundary", BOUNDARIES) == "open"
    if places.ndim != 1 or not ((places >= 0.0) & (places <= len(coefficients) - 1)).all():
        raise InputError(f"t must be a vector of numbers in [0, {len(coefficients) - 1}]")
    out = np.empty(len(places))
    _lower_at_all(coefficients, places, is_open, out)
    return out


def as_coefficients(b: ArrayLike) -> Floats:
    """Return a finite vector of at least two numbers that may be written."""
    try:
        array = np.array(b, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise InputError(f"coefficients must be real numbers; {error}") from error
    if array.ndim != 1 or len(array) < 2 or not np.isfinite(array).all():
        raise InputError(f"coefficients must be a vector of at least 2 finite numbers; got shape {array.shape}")
    return array


@inlined
def second(b, i, is_open):
    """Return the second difference D_i b = b_{i-1} - 2 b_i + b_{i+1}, with the boundary rule at both ends."""
    n = b.shape[0]
    if i == 0:
        return 0.0 if is_open else b[1] - b[0]
    if i == n - 1:
        return 0.0 if is_open else b[n - 2] - b[n - 1]
    return (b[i - 1] - b[i]) + (b[i + 1] - b[i])


@inlined
def lower_bound(b, t, is_open):
    """Return eq. (5) at t."""
    h = cell_of(t, b.shape[0] - 1)
    u = t - h
    w = 1.0 - u
    near, far = min(second(b, h, is_open), 0.0), min(second(b, h + 1, is_open), 0.0)
    return w * b[h] + u * b[h + 1] + (w * w * w * near + u * u * u * far) / 6.0


@inlined
def curve_value(b, t, is_open):
    """Return the spline at t by eq. (1)."""
    h = cell_of(t, b.shape[0] - 1)
    u = t - h
    w = 1.0 - u
    near, far = second(b, h, is_open), second(b, h + 1, is_open)
    return w * b[h] + u * b[h + 1] + (w * w * w * near + u * u * u * far) / 6.0


@kernel
def _lower_at_all(b, t, is_open, out):
    for i in range(t.shape[0]):
        out[i] = lower_bound(b, t[i], is_open)
