"""Real roots of quartics: between two of its stationary points there is one at most."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import inlined, inner, rows, threads_for
from surfel._vec import two_product, two_sum
from surfel.core.cast import Floats, as_rows
from surfel.core.errors import InputError
from surfel.roots.quadratic import solve_quadratic

_STEPS = 128


def quartic_roots(coefficients: ArrayLike) -> tuple[NDArray[np.int32], Floats]:
    """Return the real roots of quartics c0 + c1 x + c2 x^2 + c3 x^3 + c4 x^4.

    A root is where the sign changes. So a root of even multiplicity counts twice or not at all, as rounding has it,
    and one of odd multiplicity an odd number of times: the count is even always.

    Parameters
    ----------
    coefficients : array_like, shape (n, 5)
        c0 to c4; c4 not zero.

    Returns
    -------
    counts : NDArray[np.int32], shape (n,)
        0, 2 or 4.
    roots : Floats, shape (n, 4)
        The first ``counts[i]`` of row i, ascending; the others are NaN.

    Raises
    ------
    InputError
        If the shape does not fit, a coefficient is not finite or a leading one is zero.

    Notes
    -----
    Between two roots of its derivative a polynomial has one root where it changes its sign, else none: so those of the
    second derivative, a quadratic, lead to those of the first, and these to the roots. Values are summed with their
    rounding errors (Graillat, Langlois and Louvet, *Compensated Horner scheme*, 2005): signs hold next to clusters too.

    Examples
    --------
    >>> from surfel.roots.quartic import quartic_roots
    >>> counts, roots = quartic_roots([[24, -50, 35, -10, 1]])
    >>> counts.tolist(), roots.round(12).tolist()
    ([4], [[1.0, 2.0, 3.0, 4.0]])
    """
    table = np.asarray(coefficients, dtype=np.float64)
    table = as_rows(coefficients, "coefficients", len(table) if table.ndim == 2 else 1, 5).copy()
    if not np.isfinite(table).all():
        raise InputError("coefficients must be finite")
    if not (table[:, 4] != 0.0).all():
        raise InputError("the last coefficient, that of x^4, must not be zero")
    counts, roots = np.zeros(len(table), np.int32), np.full((len(table), 4), np.nan)
    with threads_for(16 * len(table)):
        _solve(len(table), table, counts, roots)
    return counts, roots


@rows
def _solve(first, last, table, counts, roots):
    cubic, bends, levels = np.empty(4), np.empty(2), np.empty(3)
    for i in range(first, last):
        quartic = table[i]
        size = 0.0  # no root, nor one of a derivative, is larger (Fujiwara, and Gauss and Lucas)
        for k in range(4):
            size = max(size, 2.0 * abs(quartic[k] / quartic[4]) ** (1.0 / (4 - k)))
            cubic[k] = (k + 1) * quartic[k + 1]
        bend, bends[0], bends[1] = solve_quadratic(3.0 * cubic[3], cubic[2], cubic[1])
        level = _between(cubic, bends, bend, size, levels)
        counts[i] = _between(quartic, levels, level, size, roots[i])


@inner
def _between(c, turns, count, size, found):
    """Write where a polynomial changes its sign, given the places where its derivative does; return how often."""
    lead = 1.0 if c[-1] > 0.0 else -1.0
    roots, before, below = 0, -2.0 * size, len(c) % 2 == 0
    for k in range(count + 1):
        place, now_below = 2.0 * size, False
        if k < count:
            place = turns[k]
            now_below = _value(c, place)[0] * lead < 0.0
        if now_below != below:
            found[roots] = _root_between(c, place if now_below else before, before if now_below else place)
            roots += 1
        before, below = place, now_below
    return roots


@inlined
def stationary_points(p, q):
    """Return how many stationary points x^4 + p x^2 + q x has, 1 or 3, and where, ascending.

    They are the roots of x^3 + 3 h x + 2 g with h = p / 6 and g = q / 8: one by Cardano's formula, written without
    cancellation, or three by Viete's. An inflection with a level tangent is none: no sign changes on both sides of it.
    """
    h, g = p / 6.0, 0.125 * q
    rest = g * g + h * h * h
    if rest >= 0.0:
        w = np.cbrt(abs(g) + math.sqrt(rest))
        if w == 0.0:
            return 1, 0.0, 0.0, 0.0
        v = h / w
        root = 2.0 * abs(g) / (w * w + h + v * v) if h > 0.0 else w - v
        return 1, math.copysign(root, -g), 0.0, 0.0
    radius = math.sqrt(-h)
    third = math.atan2(math.sqrt(-rest), -g) / 3.0
    along, across = radius * math.cos(third), math.sqrt(3.0) * radius * math.sin(third)
    return 3, -along - across, across - along, 2.0 * along


@inlined
def _value(c, x):
    """Return the polynomial and its derivative at x, the first as if computed in twice the precision."""
    value, rest, slope = c[-1], 0.0, 0.0
    for k in range(len(c) - 2, -1, -1):
        slope = slope * x + value
        product, lost = two_product(value, x)
        value, more = two_sum(product, c[k])
        rest = rest * x + (lost + more)
    return value + rest, slope


@inner
def _root_between(c, below, above):
    """Return where the sign changes between two places, by Newton's steps kept within the bracket, else by halving."""
    sign = 1.0 if c[-1] > 0.0 else -1.0
    x = 0.5 * (below + above)
    width = abs(above - below)
    for _ in range(_STEPS):
        value, slope = _value(c, x)
        if sign * value < 0.0:
            below = x
        else:
            above = x
        step = value / slope if slope != 0.0 else math.inf
        y = x - step
        half = 0.5 * (below + above)
        if not min(below, above) < y < max(below, above) or abs(step) > 0.75 * width:
            y = half
        width = abs(y - x)
        if y == x or (half in (below, above)):
            return y
        x = y
    return x
