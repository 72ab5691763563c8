"""Scattered surrogate: a spline above data of any parameters (Myles and Peters, sec. 5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import inner, kernel
from surfel.bounding.banded import COLUMNS, solve_banded
from surfel.bounding.broken_line import CurveFit, as_free, broken_line
from surfel.bounding.broken_lines import FLAT
from surfel.bounding.enclosure import BOUNDARIES, second
from surfel.bounding.evaluate import cell_of
from surfel.core.cast import Floats, as_choice, as_count
from surfel.core.errors import InputError

MOST_SOLVES = 50
"""Banded solves after which the plain scheme takes over; the paper saw up to 20."""

WILD = 6.0
"""Coefficients further than this many ranges from the middle of the data are given up: a surface stays within ten."""

AGREED = 1e-10
"""An excess below this share of the range ends the exchange; the last raise of a fit takes care of it."""


def scattered_surrogate(
    t: ArrayLike, y: ArrayLike, n: int, free: ArrayLike | None = None, boundary: str = "clamped"
) -> CurveFit:
    """Heuristic(sigma, b, lambda): a spline whose lower bound, eq. (5), lies above scattered data.

    Each abscissa j chooses one datum of parameters that round to it; eq. (7) makes the lower bound meet the chosen
    data. Then every abscissa takes the datum with the largest excess over the bound (all at once, where the paper
    exchanges one a round), until none is left. After 50 solves, or where coefficients leave six ranges, the plain
    scheme answers instead: the largest datum of each interval at both its ends, and Heuristic(sigma, b) above them.

    Parameters
    ----------
    t : array_like, shape (k,)
        Parameters in [0, n - 1].
    y : array_like, shape (k,)
        Heights.
    n : int
        Coefficients, at least 2.
    free : array_like of bool, shape (n,), optional
        Abscissae whose data are left alone, so that energy shapes the curve there. Abscissae without data are free
        anyway. Data near labelled ones may lie above the curve: :func:`bound_curve` raises it over them.
    boundary : str
        ``clamped`` (the paper) or ``open``.

    Returns
    -------
    CurveFit
        ``f >= l >= data`` but for 1e-10 of the range, wherever no label forbids it.

    Raises
    ------
    InputError
        If the data are not finite vectors of one length, or a parameter lies outside [0, n - 1].

    Examples
    --------
    >>> from surfel.bounding.enclosure import lower_at
    >>> fit = scattered_surrogate([0.2, 1.4, 2.9], [1.0, 2.0, 0.0], 4)
    >>> bool((lower_at(fit.b, [0.2, 1.4, 2.9]) >= [1.0 - 1e-9, 2.0 - 1e-9, -1e-9]).all())
    True
    """
    places, heights, count = as_data(t, y, n)
    is_open = as_choice(boundary, "boundary", BOUNDARIES) == "open"
    b = np.empty(count)
    labels = as_free(free, count)
    solves, fallback = _scattered(places, heights, labels, is_open, b)
    return CurveFit(b, int(solves), bool(fallback))


def as_data(t: ArrayLike, y: ArrayLike, n: int) -> tuple[Floats, Floats, int]:
    """Return parameters, heights and the number of coefficients, validated."""
    count = as_count(n, "n", 2)
    try:
        places, heights = np.array(t, dtype=np.float64), np.array(y, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"t and y must be vectors of real numbers; {error}") from error
    if places.ndim != 1 or places.shape != heights.shape or len(places) == 0:
        raise InputError(f"t and y must be vectors of one length, at least 1; got {places.shape} and {heights.shape}")
    if not (np.isfinite(places).all() and np.isfinite(heights).all()):
        raise InputError("t and y must be finite; drop the others first")
    if places.min() < 0.0 or places.max() > count - 1:
        raise InputError(f"t must lie in [0, {count - 1}]; got {places.min():g} to {places.max():g}")
    return places, heights, count


@kernel
def _scattered(t, y, labels, is_open, b):
    n = b.shape[0]
    chosen, worst_at = np.empty(n, np.int64), np.empty(n, np.int64)
    work, rows = np.empty((2, n)), np.empty((n, COLUMNS))
    return scattered(t, y, labels, is_open, b, chosen, np.ones(n), False, worst_at, work, rows)


@inner
def nearest(t, n):
    """Return the abscissa to which a parameter belongs: round(t), halves upwards."""
    return min(np.int64(t + 0.5), n - 1)


@inner
def scattered(t, y, labels, is_open, b, chosen, sign, known_before, worst_at, work, rows):
    """Solve for b; returns the number of solves and whether the plain scheme had to answer.

    Where there was a solution before data were appended, the exchange goes on from its b, choice and signs.
    """
    n = b.shape[0]
    low, high = np.inf, -np.inf
    if not known_before:
        chosen[:], sign[:] = -1, 1.0
    for i in range(t.shape[0]):
        low, high = min(low, y[i]), max(high, y[i])
        if not known_before:
            j = nearest(t[i], n)
            if not labels[j] and (chosen[j] < 0 or y[i] > y[chosen[j]]):
                chosen[j] = i
    known = 0
    for j in range(n):
        known += 1 if chosen[j] >= 0 else 0
    if known == 0 or low == high:
        b[:] = high if t.shape[0] > 0 else 0.0
        return 0, False
    middle, spread = 0.5 * low + 0.5 * high, high - low
    solves = 0
    if known_before and not _exchange(t, y, labels, is_open, b, chosen, work, worst_at, AGREED * spread):
        return solves, False
    while solves < MOST_SOLVES:
        agreed = False
        while not agreed and solves < MOST_SOLVES:
            solves += 1
            if solve_chosen(t, y, chosen, is_open, sign, b, rows) == 0.0:
                plain(t, y, is_open, b)
                return solves, True
            agreed = _signs_agree(chosen, is_open, sign, b, spread)
        for j in range(n):
            if not abs(b[j] - middle) <= WILD * spread:
                plain(t, y, is_open, b)
                return solves, True
        if agreed and not _exchange(t, y, labels, is_open, b, chosen, work, worst_at, AGREED * spread):
            return solves, False
    plain(t, y, is_open, b)
    return solves, True


@inner
def solve_chosen(t, y, chosen, is_open, sign, b, rows):
    """Solve eq. (7) for the chosen data and given signs; free rows make the second difference zero."""
    n = b.shape[0]
    rows[:] = 0.0
    for j in range(n):
        if chosen[j] < 0:
            b[j] = 0.0
            _add_second(rows, j, j, 1.0, n, False)
        else:
            b[j] = y[chosen[j]]
            h = cell_of(t[chosen[j]], n - 1)
            u = t[chosen[j]] - h
            w = 1.0 - u
            rows[j, h - j + 2] += w
            rows[j, h - j + 3] += u
            if sign[h] > 0.0:
                _add_second(rows, j, h, w * w * w / 6.0, n, is_open)
            if sign[h + 1] > 0.0:
                _add_second(rows, j, h + 1, u * u * u / 6.0, n, is_open)
    return solve_banded(rows, b)


@inner
def _add_second(rows, j, i, factor, n, is_open):
    """Add ``factor * D_i`` to row j."""
    if i == 0 or i == n - 1:
        if not is_open:
            rows[j, i - j + 2] -= factor
            rows[j, (1 if i == 0 else n - 2) - j + 2] += factor
        return
    rows[j, i - 1 - j + 2] += factor
    rows[j, i - j + 2] -= 2.0 * factor
    rows[j, i + 1 - j + 2] += factor


@inner
def _signs_agree(chosen, is_open, sign, b, spread):
    agreed = True
    for j in range(b.shape[0]):
        found = 1.0 if chosen[j] >= 0 and second(b, j, is_open) < -FLAT * (abs(b[j]) + spread) else 0.0
        if found != sign[j]:
            agreed = False
            sign[j] = found
    return agreed


@inner
def _exchange(t, y, labels, is_open, b, chosen, work, worst_at, tolerance):
    """Let every abscissa choose its datum of largest excess over eq. (5); False if there is none."""
    n = b.shape[0]
    worst, bent = work[0], work[1]
    for j in range(n):
        worst[j], worst_at[j] = tolerance, -1
        bent[j] = min(second(b, j, is_open), 0.0)
    for i in range(t.shape[0]):
        h = cell_of(t[i], n - 1)
        u = t[i] - h
        w = 1.0 - u
        low = w * b[h] + u * b[h + 1] + (w * w * w * bent[h] + u * u * u * bent[h + 1]) / 6.0
        j = nearest(t[i], n)
        if y[i] - low > worst[j] and not labels[j]:
            worst[j], worst_at[j] = y[i] - low, i
    found = False
    for j in range(n):
        if worst_at[j] >= 0:
            chosen[j] = worst_at[j]
            found = True
    return found


@inner
def plain(t, y, is_open, b):
    """Answer by the scheme that always ends: the largest datum of an interval at both its ends, then sec. 4."""
    n = b.shape[0]
    line = np.full(n, -np.inf)
    free = np.zeros(n, np.bool_)
    for i in range(t.shape[0]):
        h = cell_of(t[i], n - 1)
        line[h], line[h + 1] = max(line[h], y[i]), max(line[h + 1], y[i])
    for j in range(n):
        if line[j] == -np.inf:
            free[j], line[j] = True, 0.0
    broken_line(line, free, is_open, b)
