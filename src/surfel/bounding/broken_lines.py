"""Heuristic(sigma, b) for eight lines side by side: the solver behind :mod:`broken_line` and :mod:`corners`.

What is done to an abscissa is done to its eight numbers at once; a line whose signs agree is solved again, to the same
end, until those of all do. All but the contraction is called by kernels alone.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import inner, kernel
from surfel.bounding.lanes import larger

LINES = 8
"""Lines that are solved side by side."""

WORK = 3
"""Arrays of the shape of the lines that :func:`broken_lines` needs as scratch."""

MOST_SOLVES = 40
"""Solves after which the contraction takes over; two or three are the rule."""

FLAT = 1e-13
"""Second differences below this share of the largest coefficient count as zero: rounding decides their sign."""


@inner
def broken_lines(line, free, is_open, b, work):
    """Solve for b; ``line``, ``free`` (1 where there is nothing to bound, else 0) and b have the shape (n, LINES).

    Returns the most solves that a line took, and how many lines the contraction had to end. A line with one datum is
    constant, one without any is zero.
    """
    n = line.shape[0]
    low, high, plain = np.full(LINES, np.inf), np.full(LINES, -np.inf), np.empty(LINES, np.bool_)
    left, agreed = 0, np.empty(LINES, np.bool_)
    for i in range(n):
        for k in range(LINES):
            if free[i, k] == 0.0:
                low[k], high[k] = min(low[k], line[i, k]), max(high[k], line[i, k])
    for k in range(LINES):
        plain[k] = not low[k] < high[k]
        left += 0 if plain[k] else 1
    solves = 0
    if left > 0:
        sign = work[0]
        _first_signs(line, free, is_open, sign)
        while solves < MOST_SOLVES and left > 0:
            solves += 1
            _solve_signs(line, free, is_open, sign, b, work)
            _agree(free, is_open, sign, b, agreed)
            left = 0
            for k in range(LINES):
                left += 0 if plain[k] or agreed[k] else 1
        if left > 0:
            for k in range(LINES):
                if not (plain[k] or agreed[k]):
                    contract(line, free, is_open, b, k)
    for k in range(LINES):
        if plain[k]:
            for i in range(n):
                b[i, k] = 0.0 if low[k] == np.inf else low[k]
    return solves, left


@inner
def _first_signs(line, free, is_open, sign):
    n = line.shape[0]
    for i in range(n):
        for k in range(LINES):
            sign[i, k] = 1.0 if _second(line, i, k, is_open) < 0.0 and free[i, k] == 0.0 else 0.0


@inner
def _second(b, i, k, is_open):
    # D_i b, with the boundary rule at both ends
    n = b.shape[0]
    if i == 0:
        return 0.0 if is_open else b[1, k] - b[0, k]
    if i == n - 1:
        return 0.0 if is_open else b[n - 2, k] - b[n - 1, k]
    return (b[i - 1, k] - b[i, k]) + (b[i + 1, k] - b[i, k])


@inner
def _solve_signs(line, free, is_open, sign, b, work):
    # Eq. (4) with given signs. Rows are diagonally dominant (2/3 against 1/6 + 1/6), so no pivoting is needed. Free
    # rows make the second difference zero instead: their diagonal is -2, and -1 at the ends.
    n = line.shape[0]
    diagonal, above = work[1], work[2]
    for i in range(n):
        end = i == 0 or i == n - 1
        many = 1.0 if end else 2.0
        bound = 0.0 if end and is_open else 1.0 / 6.0
        for k in range(LINES):
            beside = free[i, k] + sign[i, k] * bound
            diagonal[i, k] = (1.0 - free[i, k]) - many * beside
            above[i, k] = beside if i < n - 1 else 0.0
            b[i, k] = (1.0 - free[i, k]) * line[i, k]
            if i > 0:
                factor = beside / diagonal[i - 1, k]
                diagonal[i, k] -= factor * above[i - 1, k]
                b[i, k] -= factor * b[i - 1, k]
    for k in range(LINES):
        b[n - 1, k] = b[n - 1, k] / diagonal[n - 1, k]
    for i in range(n - 2, -1, -1):
        for k in range(LINES):
            b[i, k] = (b[i, k] - above[i, k] * b[i + 1, k]) / diagonal[i, k]


@inner
def _agree(free, is_open, sign, b, agreed):
    n = b.shape[0]
    largest = np.zeros(LINES)
    for i in range(n):
        for k in range(LINES):
            largest[k] = larger(largest[k], abs(b[i, k]))
    changed = np.zeros(LINES)
    for i in range(n):
        for k in range(LINES):
            bent = _second(b, i, k, is_open) < -FLAT * largest[k] and free[i, k] == 0.0
            found = 1.0 if bent else 0.0
            changed[k] += abs(found - sign[i, k])
            sign[i, k] = found
    for k in range(LINES):
        agreed[k] = changed[k] == 0.0


@kernel
def contract(line, free, is_open, b, k):
    """Solve for line k by ``b <- l - min(D b, 0) / 6``.

    Free runs are filled once, in straight lines, and then taken as data.
    """
    n = b.shape[0]
    _fill(line, free, b, k)
    filled, before = b.copy(), b.copy()
    for _ in range(200):
        moved = 0.0
        for i in range(n):
            before[i, k] = b[i, k]
        for i in range(n):
            b[i, k] = filled[i, k] - min(_second(before, i, k, is_open), 0.0) / 6.0
            moved = max(moved, abs(b[i, k] - before[i, k]))
        if moved == 0.0:
            break


@inner
def _fill(line, free, b, k):
    """Copy a line and fill its free runs: straight between data, flat beyond them."""
    n, last = line.shape[0], -1
    for i in range(n):
        if free[i, k] != 0.0:
            continue
        b[i, k] = line[i, k]
        for j in range(last + 1, i):
            share = (j - last) / (i - last)
            b[j, k] = line[i, k] if last < 0 else line[last, k] + share * (line[i, k] - line[last, k])
        last = i
    for j in range(last + 1, n):
        b[j, k] = line[last, k]
