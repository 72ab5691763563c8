"""Changes of basis to the Bernstein form, each exact to the last digits."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import inlined, rows, threads_for
from surfel._vec import two_product, two_sum
from surfel.core.cast import Floats, as_number, read_only
from surfel.core.errors import InputError


def as_polynomials(value: ArrayLike) -> Floats:
    """Return a copy of ``value`` as polynomials, one a row, shape (m, n + 1), or say what is wrong with it."""
    try:
        array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise InputError(f"coefficients must be an array of real numbers ({error})") from error
    if array.ndim != 2 or array.shape[1] < 1:
        raise InputError(f"coefficients must have shape (m, n + 1), one polynomial a row; got shape {array.shape}")
    if not np.isfinite(array).all():
        raise InputError("coefficients must be finite")
    return array


def power_to_bernstein(coefficients: ArrayLike, low: float, high: float) -> Floats:
    """Return the Bernstein form on [low, high] of polynomials in powers.

    Computed with twice the usual digits: what cancels (in a wide interval far from 0 all digits may) cancels there.

    Parameters
    ----------
    coefficients : array_like, shape (m, n + 1)
        ``sum_k c_k x^k``, one polynomial a row, the constant first.
    low, high : float
        The interval.

    Returns
    -------
    Floats, shape (m, n + 1)
        b with ``p(low + (high - low) u) = sum_k b_k binom(n, k) u^k (1 - u)^(n - k)``.

    Raises
    ------
    InputError
        If the shape does not fit, a number is not finite or the interval is empty.

    Examples
    --------
    >>> from surfel.roots.bernstein_basis import power_to_bernstein
    >>> power_to_bernstein([[1.0, 0.0, 1.0]], 0.0, 2.0)  # 1 + x^2
    array([[1., 1., 5.]])
    """
    form = as_polynomials(coefficients)
    start, end = as_number(low, "low"), as_number(high, "high")
    if not start < end:
        raise InputError(f"the interval must not be empty: low < high; got {start:g} and {end:g}")
    with threads_for(len(form) * 50):
        _to_bernstein(len(form), form, np.float64(start), np.float64(end))
    return form


@lru_cache(maxsize=64)
def lobatto_nodes(degree: int) -> Floats:
    """Return the ``degree + 1`` Chebyshev-Lobatto nodes of [0, 1], ascending, both ends among them."""
    return read_only(np.array([math.sin(0.5 * math.pi * k / degree) ** 2 for k in range(degree)] + [1.0]))


@lru_cache(maxsize=64)
def values_to_bernstein(degree: int) -> Floats:
    """Return the matrix that takes values at :func:`lobatto_nodes` to Bernstein coefficients on [0, 1].

    Found in whole numbers for the nodes as they are in floating point, and rounded once. The norm grows with the
    degree, and with it the rounding of the coefficients: 1e1 for degree 3, 1e2 for 6, 1e6 for 20.

    Parameters
    ----------
    degree : int
        At least 1.

    Returns
    -------
    Floats, shape (degree + 1, degree + 1)
        One row for each coefficient.
    """
    unit = 1 << 60
    nodes = [round(x * unit) for x in lobatto_nodes(degree).tolist()]
    matrix = np.empty((degree + 1, degree + 1))
    for j, node in enumerate(nodes):
        scaled, below = [1], 1  # the product of (u - u_i) / (u_j - u_i), with coefficients binom(n, k) b_k
        for other in nodes[:j] + nodes[j + 1 :]:
            left = [-other * c for c in scaled] + [0]
            right = [0] + [(unit - other) * c for c in scaled]
            scaled = [a + b for a, b in zip(left, right, strict=True)]
            below *= node - other
        for k, c in enumerate(scaled):
            matrix[k, j] = _ratio(c, below * math.comb(degree, k))
    return read_only(matrix)


def _ratio(above: int, below: int) -> float:
    """Return a ratio of whole numbers, rounded once."""
    return above / below  # Python divides whole numbers of any size correctly


@rows
def _to_bernstein(first, last, form, low, high):
    """Shift to ``low`` (Horner), scale to the interval, and sum to the Bernstein form, in pairs of numbers."""
    n = form.shape[1] - 1
    head, tail = np.empty(n + 1), np.empty(n + 1)
    width, rest = two_sum(high, -low)
    for i in range(first, last):
        for k in range(n + 1):
            head[k], tail[k] = form[i, k], 0.0
        for k in range(n):
            for j in range(n - 1, k - 1, -1):
                a, b = _product(head[j + 1], tail[j + 1], low, 0.0)
                head[j], tail[j] = _sum(head[j], tail[j], a, b)
        scale, scale_rest, binomial = 1.0, 0.0, 1.0
        for k in range(n + 1):
            a, b = _product(head[k], tail[k], scale, scale_rest)
            head[k], tail[k] = _quotient(a, b, binomial)
            scale, scale_rest = _product(scale, scale_rest, width, rest)
            binomial = binomial * (n - k) / (k + 1)
        for k in range(n):
            for j in range(n, k, -1):
                head[j], tail[j] = _sum(head[j], tail[j], head[j - 1], tail[j - 1])
        for k in range(n + 1):
            form[i, k] = head[k] + tail[k]


@inlined
def _sum(a, a_rest, b, b_rest):
    """Return the sum of two pairs; the rests are summed exactly too, so that it holds where the heads cancel."""
    head, rest = two_sum(a, b)
    second, third = two_sum(a_rest, b_rest)
    head, rest = two_sum(head, rest + second)
    return two_sum(head, rest + third)


@inlined
def _product(a, a_rest, b, b_rest):
    head, rest = two_product(a, b)
    return two_sum(head, rest + (a * b_rest + a_rest * b))


@inlined
def _quotient(a, a_rest, b):
    """Return a pair divided by a number."""
    head = a / b
    product, error = two_product(head, b)
    return two_sum(head, (((a - product) - error) + a_rest) / b)
