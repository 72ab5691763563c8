"""Broken-line surrogate: a spline above a broken line with uniform knots (Myles and Peters, sec. 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import inner, kernel
from surfel.bounding.broken_lines import LINES, WORK, broken_lines
from surfel.bounding.enclosure import BOUNDARIES, as_coefficients
from surfel.core.cast import Floats, as_choice
from surfel.core.errors import InputError


@dataclass(frozen=True)
class CurveFit:
    """Coefficients of a curve and how they were found.

    Parameters
    ----------
    b : Floats, shape (n,)
        Coefficients at the abscissae 0 .. n - 1.
    solves : int
        Banded systems that were solved.
    fallback : bool
        Whether the plain scheme that always ends had to step in.
    """

    b: Floats
    solves: int
    fallback: bool


def broken_line_surrogate(heights: ArrayLike, free: ArrayLike | None = None, boundary: str = "clamped") -> CurveFit:
    """Heuristic(sigma, b): the spline whose lower broken line, eq. (3), is the given one.

    Signs of the second differences are guessed, eq. (4) is solved for the coefficients, and the signs are set anew
    until they agree. Should they cycle, the map ``b <- l - min(D b, 0) / 6`` ends it: it contracts by 2/3, because
    ``|D| <= 4``, so the solution is unique and is always reached.

    Parameters
    ----------
    heights : array_like, shape (n,)
        The broken line l at the abscissae 0 .. n - 1.
    free : array_like of bool, shape (n,), optional
        Abscissae without data: there the second difference is made zero instead (at the ends the first). A line with
        one datum is constant, one without any is zero.
    boundary : str
        ``clamped`` (the paper) or ``open``.

    Returns
    -------
    CurveFit
        The spline lies on or above the broken line wherever neither end of an interval is free.

    Raises
    ------
    InputError
        If the heights are not at least two finite numbers or ``free`` does not fit.

    Examples
    --------
    >>> fit = broken_line_surrogate([0.0, 4.0, 0.0])
    >>> fit.b.round(6).tolist(), fit.solves
    ([0.0, 6.0, 0.0], 1)
    """
    line = as_coefficients(heights)
    is_open = as_choice(boundary, "boundary", BOUNDARIES) == "open"
    mask = as_free(free, len(line))
    b = np.empty(len(line))
    solves = int(_broken_line(line, mask, is_open, b))
    return CurveFit(b, abs(solves), solves < 0)


def as_free(free: ArrayLike | None, n: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return labels of free abscissae as booleans of shape (n,); none where there are no labels."""
    mask = np.zeros(n, dtype=np.bool_) if free is None else np.array(free)
    if mask.shape != (n,) or mask.dtype != np.bool_:
        raise InputError(f"free must be {n} booleans, one for each coefficient; got {mask.dtype} of shape {mask.shape}")
    return mask


@kernel
def _broken_line(line, free, is_open, b):
    return broken_line(line, free, is_open, b)


@inner
def broken_line(line, free, is_open, b):
    """Solve for b. Returns the number of solves, negative if the contraction had to end it."""
    n = line.shape[0]
    lines, gaps, found = np.empty((n, LINES)), np.empty((n, LINES)), np.empty((n, LINES))
    for i in range(n):
        lines[i] = line[i]
        gaps[i] = 1.0 if free[i] else 0.0
    solves, left = broken_lines(lines, gaps, is_open, found, np.empty((WORK, n, LINES)))
    for i in range(n):
        b[i] = found[i, 0]
    return -solves if left > 0 else solves
