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
    for k in range(n):  # what lies beyond the last column is zero, and is carried along
        best = k
        for i in range(k + 1, min(n, k + 3)):
            if abs(a[i, k - i + 2]) > abs(a[best, k - best + 2]):
                best = i
        if best != k:
            shift = k - best + 2
            for c in range(5):
                a[k, c + 2], a[best, c + shift] = a[best, c + shift], a[k, c + 2]
            right[k], right[best] = right[best], right[k]
        pivot = a[k, 2]
        least = min(least, abs(pivot))
        if not abs(pivot) > 1e-13 * largest:
            return 0.0
        if k + 1 < n and a[k + 1, 1] != 0.0:
            factor = a[k + 1, 1] / pivot
            for c in range(5):
                a[k + 1, c + 1] -= factor * a[k, c + 2]
            right[k + 1] -= factor * right[k]
        if k + 2 < n and a[k + 2, 0] != 0.0:
            factor = a[k + 2, 0] / pivot
            for c in range(5):
                a[k + 2, c] -= factor * a[k, c + 2]
            right[k + 2] -= factor * right[k]
    x1 = x2 = x3 = x4 = 0.0
    for k in range(n - 1, -1, -1):
        x = ((((right[k] - a[k, 3] * x1) - a[k, 4] * x2) - a[k, 5] * x3) - a[k, 6] * x4) / a[k, 2]
        right[k], x1, x2, x3, x4 = x, x, x1, x2, x3
    return least / largest
