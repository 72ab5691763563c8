"""Niederreiter's low-discrepancy sequence in base 2, with random access and all 53 bits of a float64.

Bratley, Fox and Niederreiter, *Algorithm 738: Programs to generate Niederreiter's low-discrepancy sequences*, ACM TOMS
20(4), 1994, and *Implementation and tests of low-discrepancy sequences*, ACM TOMACS 2(3), 1992.

Digit j of coordinate i of point n is the scalar product over GF(2) of the binary digits of n (here of its Gray code,
which only reorders the points within each aligned run of 2^m) with row j of a generator matrix. With j - 1 = q e + u,
e the degree of the i-th irreducible polynomial p and 0 <= u < e, the row holds the coefficients of x^-1, x^-2, ... of

    x^u g(x) / p(x)^(q + 1).

g is free as long as p does not divide it; it is chosen so that the points are those of Algorithm 738, bit for bit.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from surfel._numba import kernel
from surfel.core.cast import Floats, Integers, as_count

BITS = 53
"""Digits of a coordinate, and digits of an index: all that a float64 in [0, 1) can hold."""

MOST_DIMENSIONS = 20
_LOW = 8  # points are made in runs of 2^8 from a table


def niederreiter(count: int, dimension: int, start: int = 0) -> Floats:
    """Return points ``start`` to ``start + count - 1`` of Niederreiter's sequence in base 2.

    Any aligned run of 2^m points is a (t, m, s)-net in base 2: t is 0, 0, 1, 3, 5, 8, ... for s = 1, 2, 3, 4, 5, 6.

    Parameters
    ----------
    count : int
        How many points, 0 or more.
    dimension : int
        s, from 1 to 20.
    start : int
        Index of the first point; point 0 is the origin. Access is random: a late start costs nothing.

    Returns
    -------
    Floats, shape (count, dimension)
        In [0, 1), multiples of 2^-53.

    Raises
    ------
    InputError
        If a number is out of its range, or the sequence's 2^53 points end before the last one asked for.

    Examples
    --------
    >>> from surfel.lines.niederreiter import niederreiter
    >>> niederreiter(4, 2).tolist()
    [[0.0, 0.0], [0.5, 0.5], [0.75, 0.25], [0.25, 0.75]]
    """
    size = as_count(dimension, "dimension", 1, MOST_DIMENSIONS)
    first = as_count(start, "start", 0, 2**BITS)
    number = as_count(count, "count", 0, 2**BITS - first)
    points = np.empty((number, size))
    columns, table = _tables(size)
    _fill(points, first, columns, table)
    return points


def direction_numbers(dimension: int) -> Integers:
    """Return the columns of the generator matrices as integers of 53 bits, shape (53, dimension).

    Column r is what bit r of the Gray code of an index adds (exclusive or) to each coordinate times 2^53.
    """
    columns = np.zeros((BITS, dimension), np.int64)
    for i, p in enumerate(_irreducible_polynomials(dimension)):
        rows = _generator_rows(p)
        for j, row in enumerate(rows):
            for r in range(BITS):
                columns[r, i] |= ((row >> (BITS - 1 - r)) & 1) << (BITS - 1 - j)
    return columns


@cache
def _tables(dimension: int) -> tuple[Integers, Integers]:
    """Return the direction numbers, and the first 2^8 points as integers."""
    columns = direction_numbers(dimension)
    table = np.zeros((1 << _LOW, dimension), np.int64)
    for n in range(1, 1 << _LOW):
        table[n] = table[n - 1] ^ columns[(n & -n).bit_length() - 1]
    return columns, table


# Polynomials over GF(2) are Python integers: bit k is the coefficient of x^k.


def _irreducible_polynomials(number: int) -> list[int]:
    """Return the first irreducible polynomials, ascending: x, x + 1, x^2 + x + 1, ..."""
    found: list[int] = []
    candidate = 2
    while len(found) < number:
        half = (candidate.bit_length() - 1) // 2
        if all(_divide(candidate, p)[1] for p in found if p.bit_length() - 1 <= half):
            found.append(candidate)
        candidate += 1
    return found


def _generator_rows(p: int) -> list[int]:
    """Return the rows of the generator matrix of ``p``: bit 52 - r of a row is its coefficient of x^-(r + 1)."""
    degree = p.bit_length() - 1
    rows: list[int] = []
    power = 1
    while len(rows) < BITS:
        power = _multiply(power, p)
        # g: the polynomial part of p^(q + 1) times the run of e ones that Algorithm 738 starts its recurrence with
        g = _multiply(power, (1 << degree) - 1) >> (power.bit_length() - 1)
        series, _ = _divide(g << (BITS + degree), power)
        rows.extend((series >> (degree - u)) & ((1 << BITS) - 1) for u in range(degree))
    return rows[:BITS]


def _multiply(a: int, b: int) -> int:
    product = 0
    while b:
        if b & 1:
            product ^= a
        a <<= 1
        b >>= 1
    return product


def _divide(a: int, b: int) -> tuple[int, int]:
    quotient, length = 0, b.bit_length()
    while (shift := a.bit_length() - length) >= 0:
        quotient |= 1 << shift
        a ^= b << shift
    return quotient, a


@kernel
def _fill(points, start, columns, table):
    """Write the points: the Gray code is linear over exclusive or, so a run of 2^8 is a table and one offset."""
    count, dimension = points.shape
    run = table.shape[0]
    offset = np.empty(dimension, np.int64)
    done = 0
    while done < count:
        index = start + done
        low = index & (run - 1)
        high = index - low
        take = min(run - low, count - done)
        gray = high ^ (high >> 1)
        offset[:] = 0
        r = 0
        while gray > 0:
            if gray & 1:
                for d in range(dimension):
                    offset[d] ^= columns[r, d]
            gray >>= 1
            r += 1
        for k in range(take):
            for d in range(dimension):
                points[done + k, d] = (offset[d] ^ table[low + k, d]) * 2.0**-53
        done += take
