"""Trial and error: interpolate the most constraining data (Myles and Peters, sec. 3). Often ends; not always safe."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import inner, kernel
from surfel.bounding.banded import COLUMNS
from surfel.bounding.broken_line import CurveFit, as_free
from surfel.bounding.enclosure import BOUNDARIES, curve_value
from surfel.bounding.scattered import AGREED, MOST_SOLVES, WILD, as_data, nearest, plain, solve_chosen
from surfel.core.cast import as_choice


def trial_and_error(
    t: ArrayLike, y: ArrayLike, n: int, free: ArrayLike | None = None, boundary: str = "clamped"
) -> CurveFit:
    """Sec. 3: interpolate one datum near each abscissa, and exchange the datum that lies farthest above the curve.

    Steps 1 to 4 of the paper, one exchange a solve. The paper leaves open whether it ends; after 50 solves, or where a
    datum would replace itself, the curve of the plain scheme is returned instead (see :func:`scattered_surrogate`).

    Parameters
    ----------
    t, y : array_like, shape (k,)
        Parameters in [0, n - 1], and heights.
    n : int
        Coefficients, at least 2.
    free : array_like of bool, shape (n,), optional
        Abscissae whose data are left alone.
    boundary : str
        ``clamped`` (the paper) or ``open``.

    Returns
    -------
    CurveFit
        Above the data but for 1e-10 of the range, wherever no label forbids it.

    Raises
    ------
    InputError
        As :func:`scattered_surrogate`.

    Examples
    --------
    >>> trial_and_error([0.0, 1.0, 2.0], [0.0, 1.0, 0.0], 3).b.round(6).tolist()
    [-0.333333, 1.666667, -0.333333]
    """
    places, heights, count = as_data(t, y, n)
    is_open = as_choice(boundary, "boundary", BOUNDARIES) == "open"
    b = np.empty(count)
    solves, fallback = _trial(places, heights, as_free(free, count), is_open, b)
    return CurveFit(b, int(solves), bool(fallback))


@kernel
def _trial(t, y, labels, is_open, b):
    n = b.shape[0]
    chosen, sign = np.full(n, -1, np.int64), np.ones(n)
    rows = np.empty((n, COLUMNS))
    low, high, known = np.inf, -np.inf, 0
    for i in range(t.shape[0]):
        low, high = min(low, y[i]), max(high, y[i])
        j = nearest(t[i], n)
        if not labels[j] and (chosen[j] < 0 or y[i] > y[chosen[j]]):
            known += 1
            chosen[j] = i
    if known == 0 or low == high:
        b[:] = high
        return 0, False
    middle, spread = 0.5 * low + 0.5 * high, high - low
    for solve in range(1, MOST_SOLVES + 1):
        if solve_chosen(t, y, chosen, is_open, sign, b, rows) == 0.0:
            break
        if not _tame(b, middle, WILD * spread):
            break
        worst = _worst(t, y, labels, is_open, b, AGREED * spread)
        if worst < 0:
            return solve, False
        j = nearest(t[worst], n)
        if chosen[j] == worst:
            break
        chosen[j] = worst
    plain(t, y, is_open, b)
    return solve, True


@inner
def _tame(b, middle, reach):
    tame = True
    for j in range(b.shape[0]):
        tame = tame and abs(b[j] - middle) <= reach
    return tame


@inner
def _worst(t, y, labels, is_open, b, tolerance):
    most, at = tolerance, -1
    for i in range(t.shape[0]):
        excess = y[i] - curve_value(b, t[i], is_open)
        if excess > most and not labels[nearest(t[i], b.shape[0])]:
            most, at = excess, i
    return at
