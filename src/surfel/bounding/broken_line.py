"""Broken-line surrogate: a spline above a broken line with uniform knots (Myles and Peters, sec. 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import inner, kernel
from surfel.bounding.enclosure import BOUNDARIES, as_coefficients, second
from surfel.core.cast import Floats, as_choice
from surfel.core.errors import InputError

MOST_SOLVES = 40
"""Solves after which the contraction takes over; two or three are the rule."""

FLAT = 1e-13
"""Second differences below this share of the largest coefficient count as zero: rounding decides their sign."""


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
    b, work = np.empty(len(line)), np.empty((5, len(line)))
    solves = int(_broken_line(line, mask, is_open, b, work))
    return CurveFit(b, abs(solves), solves < 0)


def as_free(free: ArrayLike | None, n: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return labels of free abscissae as booleans of shape (n,); none where there are no labels."""
    mask = np.zeros(n, dtype=np.bool_) if free is None else np.array(free)
    if mask.shape != (n,) or mask.dtype != np.bool_:
        raise InputError(f"free must be {n} booleans, one for each coefficient; got {mask.dtype} of shape {mask.shape}")
    return mask


@kernel
def _broken_line(line, free, is_open, b, work):
    return broken_line(line, free, is_open, b, work)


@inner
def broken_line(line, free, is_open, b, work):
    """Solve for b; ``work`` is (5, n). Returns the number of solves, negative if the contraction had to end it."""
    n = line.shape[0]
    low, high, known = np.inf, -np.inf, 0
    for i in range(n):
        if not free[i]:
            known += 1
            low, high = min(low, line[i]), max(high, line[i])
    if known == 0 or low == high:
        b[:] = 0.0 if known == 0 else low
        return 0
    sign = work[4]
    for i in range(n):
        sign[i] = 1.0 if not free[i] and second(line, i, is_open) < 0.0 else 0.0
    for solve in range(1, MOST_SOLVES + 1):
        _solve_signs(line, free, is_open, sign, b, work)
        if _agree(free, is_open, sign, b):
            return solve
    _contract(line, free, is_open, b, work[0])
    return -MOST_SOLVES


@inner
def _solve_signs(line, free, is_open, sign, b, work):
    # Eq. (4) with given signs. Rows are diagonally dominant (2/3 against 1/6 + 1/6), so no pivoting is needed.
    n = line.shape[0]
    lower, diagonal, upper, right = work[0], work[1], work[2], work[3]
    for i in range(n):
        end = i == 0 or i == n - 1
        lower[i] = upper[i] = 0.0
        if free[i]:
            right[i], diagonal[i] = 0.0, -1.0 if end else -2.0
            lower[i] = 1.0 if i > 0 else 0.0
            upper[i] = 1.0 if i < n - 1 else 0.0
        else:
            right[i], diagonal[i] = line[i], 1.0
            if sign[i] > 0.0 and not (end and is_open):
                diagonal[i] -= (1.0 if end else 2.0) / 6.0
                lower[i] = 1.0 / 6.0 if i > 0 else 0.0
                upper[i] = 1.0 / 6.0 if i < n - 1 else 0.0
    for i in range(1, n):
        factor = lower[i] / diagonal[i - 1]
        diagonal[i] -= factor * upper[i - 1]
        right[i] -= factor * right[i - 1]
    b[n - 1] = right[n - 1] / diagonal[n - 1]
    for i in range(n - 2, -1, -1):
        b[i] = (right[i] - upper[i] * b[i + 1]) / diagonal[i]


@inner
def _agree(free, is_open, sign, b):
    largest = 0.0
    for i in range(b.shape[0]):
        largest = max(largest, abs(b[i]))
    agreed = True
    for i in range(b.shape[0]):
        found = 1.0 if not free[i] and second(b, i, is_open) < -FLAT * largest else 0.0
        if found != sign[i]:
            agreed = False
            sign[i] = found
    return agreed


@kernel
def _contract(line, free, is_open, b, before):
    # b <- l - min(D b, 0) / 6; free runs are filled once, in straight lines, and then taken as data.
    _fill(line, free, b)
    filled = b.copy()
    for _ in range(200):
        before[:] = b
        moved = 0.0
        for i in range(b.shape[0]):
            b[i] = filled[i] - min(second(before, i, is_open), 0.0) / 6.0
            moved = max(moved, abs(b[i] - before[i]))
        if moved == 0.0:
            break


@inner
def _fill(line, free, b):
    """Copy the line and fill its free runs: straight between data, flat beyond them."""
    n, last = line.shape[0], -1
    for i in range(n):
        if free[i]:
            continue
        b[i] = line[i]
        for j in range(last + 1, i):
            share = (j - last) / (i - last)
            b[j] = line[i] if last < 0 else line[last] + share * (line[i] - line[last])
        last = i
    for j in range(last + 1, n):
        b[j] = line[last]
