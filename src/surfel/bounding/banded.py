"""Systems with two bands on each side of the diagonal, solved with partial pivoting."""

from __future__ import annotations

from surfel._numba import inner

COLUMNS = 7
"""Entries kept of each row: columns ``i - 2 .. i + 4``; row exchanges fill two more above the band."""


@inner
def solve_banded(a, right):
    """Solve in place; ``a[i, c - i + 2]`` holds column c of row i. Returns the least pivot over the largest entry.

    Zero means that the system is singular; ``right`` is then useless.
    """
    n = right.shape[0]
    largest, least = 0.0, 1e300
    for i in range(n):
        for c in range(COLUMNS):
            largest = max(largest, abs(a[i, c]))
    for k in range(n):
        best = k
        for i in range(k + 1, min(n, k + 3)):
            if abs(a[i, k - i + 2]) > abs(a[best, k - best + 2]):
                best = i
        if best != k:
            for c in range(k, min(n, k + 5)):
                here, there = a[k, c - k + 2], a[best, c - best + 2]
                a[k, c - k + 2], a[best, c - best + 2] = there, here
            right[k], right[best] = right[best], right[k]
        pivot = a[k, 2]
        least = min(least, abs(pivot))
        if not abs(pivot) > 1e-13 * largest:
            return 0.0
        for i in range(k + 1, min(n, k + 3)):
            factor = a[i, k - i + 2] / pivot
            if factor != 0.0:
                for c in range(k, min(n, k + 5)):
                    a[i, c - i + 2] -= factor * a[k, c - k + 2]
                right[i] -= factor * right[k]
    for k in range(n - 1, -1, -1):
        total = right[k]
        for c in range(k + 1, min(n, k + 5)):
            total -= a[k, c - k + 2] * right[c]
        right[k] = total / a[k, 2]
    return least / largest
