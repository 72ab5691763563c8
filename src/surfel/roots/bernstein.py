"""All real roots of a polynomial in an interval, from its Bernstein form there: none missed, none twice.

The coefficients' changes of sign bound the number of roots in the open interval and have its parity (Descartes' rule
in Bernstein form: Lane and Riesenfeld, *Bounds on a polynomial*, BIT 21, 1981). No change: no root. One: one root. Else
the interval is halved (de Casteljau), which never adds a change, in floating point neither, because a mean of two
numbers of one sign has that sign.

**Zero counts as positive**, everywhere: what is solved is the polynomial plus an infinitely small positive number. A
double root that is touched from above thus counts 0 times, one from below twice, one of odd multiplicity once, and a
root at an end only where the polynomial is negative beside it. So the number of roots is odd exactly if the signs at
the two ends differ. Roots that halving thirty times does not part count as one (odd) or none (even).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import inlined, inner, rows, threads_for
from surfel.core.cast import Floats
from surfel.roots.bernstein_basis import as_polynomials, power_to_bernstein

DEEPEST = 30
"""Halvings: two roots nearer than 2^-30 of the interval are below what rounding leaves of a double root."""

STACK = DEEPEST + 2
"""Rows of scratch that :func:`roots_of` and :func:`count_of` need, each of n + 3 numbers for degree n."""

_NARROWEST = 2.0**-DEEPEST
_WORK = 20  # a polynomial is as much work as this many items of a simple loop


class Roots(NamedTuple):
    """The real roots of a batch of polynomials, as compressed rows.

    Parameters
    ----------
    offsets : NDArray[np.int64], shape (m + 1,)
        The roots of polynomial i are the rows ``offsets[i]:offsets[i + 1]``.
    at : Floats, shape (k,)
        The roots, ascending for each polynomial.
    """

    offsets: NDArray[np.int64]
    at: Floats


def bernstein_roots(coefficients: ArrayLike) -> Roots:
    """Return all real roots in [0, 1] of polynomials in Bernstein form.

    Parameters
    ----------
    coefficients : array_like, shape (m, n + 1)
        ``sum_k c_k binom(n, k) u^k (1 - u)^(n - k)``, one polynomial a row.

    Returns
    -------
    Roots
        Ascending. Zero counts as positive: see the text of this module for ends and double roots.

    Raises
    ------
    InputError
        If the shape does not fit or a coefficient is not finite.

    Examples
    --------
    >>> from surfel.roots.bernstein import bernstein_roots
    >>> bernstein_roots([[-1.0, 0.0, 2.0]]).at  # u^2 + 2 u - 1
    array([0.41421356])
    """
    form = as_polynomials(coefficients)
    counts = np.zeros(len(form), np.int64)
    found = np.empty((len(form), max(form.shape[1] - 1, 1)))
    with threads_for(len(form) * _WORK):
        _solve_each(len(form), form, found, counts)
    offsets = np.zeros(len(form) + 1, np.int64)
    np.cumsum(counts, out=offsets[1:])
    return Roots(offsets, found[np.arange(found.shape[1]) < counts[:, None]])


def count_bernstein_roots(coefficients: ArrayLike) -> NDArray[np.int64]:
    """Return how many roots :func:`bernstein_roots` would find, shape (m,), without finding them."""
    form = as_polynomials(coefficients)
    counts = np.zeros(len(form), np.int64)
    with threads_for(len(form) * _WORK):
        _count_each(len(form), form, counts)
    return counts


def polynomial_roots(coefficients: ArrayLike, low: float, high: float) -> Roots:
    """Return all real roots in [low, high] of polynomials in powers.

    Parameters
    ----------
    coefficients : array_like, shape (m, n + 1)
        ``sum_k c_k x^k``, one polynomial a row, the constant first.
    low, high : float
        The interval.

    Returns
    -------
    Roots
        Ascending, as those of :func:`bernstein_roots`.

    Raises
    ------
    InputError
        If the shape does not fit, a number is not finite or the interval is empty.

    Examples
    --------
    >>> from surfel.roots.bernstein import polynomial_roots
    >>> polynomial_roots([[-6.0, 11.0, -6.0, 1.0]], 0.5, 3.5).at  # (x - 1) (x - 2) (x - 3)
    array([1., 2., 3.])
    """
    offsets, at = bernstein_roots(power_to_bernstein(coefficients, low, high))
    return Roots(offsets, low + (high - low) * at)


def count_polynomial_roots(coefficients: ArrayLike, low: float, high: float) -> NDArray[np.int64]:
    """Return how many roots :func:`polynomial_roots` would find, shape (m,), without finding them."""
    return count_bernstein_roots(power_to_bernstein(coefficients, low, high))


@rows
def _solve_each(first, last, form, found, counts):
    n = form.shape[1] - 1
    parts = np.empty((STACK, n + 3))
    for i in range(first, last):
        for k in range(n + 1):
            parts[0, k] = form[i, k]
        counts[i] = roots_of(n, parts, 1e-16, found[i])


@rows
def _count_each(first, last, form, counts):
    n = form.shape[1] - 1
    parts = np.empty((STACK, n + 3))
    for i in range(first, last):
        for k in range(n + 1):
            parts[0, k] = form[i, k]
        counts[i] = count_of(n, parts)


@inner
def roots_of(n, parts, tolerance, out):
    """Write the roots in [0, 1] into ``out`` (n of them fit), ascending, and return how many there are.

    The Bernstein coefficients are ``parts[0, : n + 1]``; ``parts`` is overwritten. Each root is bracketed, and exact
    to ``tolerance`` (absolute) where rounding lets it.
    """
    parts[0, n + 1], parts[0, n + 2] = 0.0, 1.0
    found = 0
    row = 0
    while row >= 0:
        part = parts[row]
        a, b = part[n + 1], part[n + 2]
        changes = sign_changes(n, part)
        if changes > 1 and b - a > _NARROWEST:
            halve(n, parts, row)
            row += 1
            continue
        if changes % 2 == 1:
            out[found] = a + (b - a) * only_root(n, part, tolerance / (b - a))
            found += 1
        row -= 1
    return found


@inner
def count_of(n, parts):
    """Return how many roots in [0, 1] there are; as :func:`roots_of`, which would find as many."""
    parts[0, n + 1], parts[0, n + 2] = 0.0, 1.0
    found = 0
    row = 0
    while row >= 0:
        part = parts[row]
        changes = sign_changes(n, part)
        if changes > 1 and part[n + 2] - part[n + 1] > _NARROWEST:
            halve(n, parts, row)
            row += 1
            continue
        found += changes % 2
        row -= 1
    return found


@inlined
def sign_changes(n, part):
    """Count the changes of sign of part[0 : n + 1], zero counted as positive."""
    changes = 0
    for k in range(n):
        changes += (part[k] < 0.0) != (part[k + 1] < 0.0)
    return changes


@inlined
def halve(n, parts, row):
    """Cut the part in a row of the stack at its middle: the left half into the row above, the right one in place."""
    right, left = parts[row], parts[row + 1]
    a, b = right[n + 1], right[n + 2]
    middle = 0.5 * (a + b)
    for k in range(n):
        left[k] = right[0]
        for j in range(n - k):
            right[j] = 0.5 * right[j] + 0.5 * right[j + 1]
    left[n] = right[0]
    left[n + 1], left[n + 2] = a, middle
    right[n + 1] = middle


@inner
def only_root(n, part, tolerance):
    """Return where in [0, 1] the sign changes, given that it differs at the ends; ``part`` is overwritten.

    Divided by (1 - u)^n the polynomial is one in r = u / (1 - u) with coefficients binom(n, k) c_k, and divided by u^n
    one in 1 / r; r serves in the left half and 1 / r in the right one, so that both are in [0, 1]. Newton's method,
    with a bisection wherever it leaves the bracket or does not halve its step.
    """
    binomial = 1.0
    whole = 0.0
    for k in range(n + 1):
        part[k] *= binomial
        whole += part[k]
        binomial = binomial * (n - k) / (k + 1)
    below = part[0] < 0.0
    mirrored = (whole < 0.0) == below
    if mirrored:
        for k in range((n + 1) // 2):
            part[k], part[n - k] = part[n - k], part[k]
        below = not below
    r = _sign_change(n, part, whole, below, tolerance)
    return 1.0 / (1.0 + r) if mirrored else r / (1.0 + r)


@inlined
def _sign_change(n, part, at_one, below, tolerance):
    """Return where in [0, 1] ``sum_k part[k] r^k`` changes its sign; ``below`` says that it is negative at 0."""
    low, high = 0.0, 1.0
    r = 0.5
    if at_one != part[0]:
        r = part[0] / (part[0] - at_one)
    step = 1.0
    for _ in range(100):
        value = part[n]
        slope = 0.0
        for k in range(n - 1, -1, -1):
            slope = slope * r + value
            value = value * r + part[k]
        if value == 0.0 and slope != 0.0 and (slope > 0.0) == below:  # else it is zero here, and changes its sign later
            return r
        if (value < 0.0) == below:
            low = r
        else:
            high = r
        new = r - value / slope if slope != 0.0 else low
        if not low < new < high or abs(new - r) > 0.5 * step:
            new = 0.5 * (low + high)
        step = abs(new - r)
        r = new
        if step <= tolerance or high - low <= tolerance:
            return r
    return r
