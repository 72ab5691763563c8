"""A safe surface over a grid of corners: Heuristic(sigma, b) along the rows, then along the columns (sec. 6)."""

from __future__ import annotations

import numpy as np

from surfel._numba import kernel
from surfel.bounding.bezier import framed, over_windows
from surfel.bounding.broken_lines import LINES, WORK, broken_lines
from surfel.core.cast import Floats


def corners_of(by_cell: Floats) -> Floats:
    """Return the largest value of the cells round each corner, -inf where none has data: shape (n, m)."""
    return over_windows(framed(by_cell, 1, -np.inf), 2)


def over_corners(corner: Floats, boundary: str, symmetric: bool = False) -> tuple[Floats, int, int]:
    """Return a spline above the bilinear interpolant of values at the corners.

    By the paper's tensor argument: lines along u lie above their broken lines, and the lines along v that are fitted to
    their coefficients lie above theirs. Corners without data (-inf) are free: energy fills them.

    Parameters
    ----------
    corner : Floats, shape (n, m)
        Heights at the corners; -inf where there is nothing to bound.
    boundary : str
        ``open`` or ``clamped``.
    symmetric : bool
        The mean of both orders of u and v, which is safe as well.

    Returns
    -------
    coefficients : Floats, shape (n + 2, m + 2)
        B-spline coefficients.
    solves : int
        The most solves that a line took.
    fallbacks : int
        Lines that the contraction had to end.
    """
    inner = np.empty(corner.shape)
    solves, fallbacks = _two_sweeps(np.ascontiguousarray(corner), boundary == "open", inner)
    coefficients = extend(inner, boundary)
    if not symmetric:
        return coefficients, int(solves), int(fallbacks)
    other, more, again = over_corners(corner.T, boundary)
    mean = np.ascontiguousarray(0.5 * coefficients + 0.5 * other.T)
    return mean, max(int(solves), more), int(fallbacks) + again


def extend(inner: Floats, boundary: str) -> Floats:
    """Return all (n + 2, m + 2) coefficients from the inner (n, m), by the boundary rule in both directions."""
    if boundary == "clamped":
        return np.pad(inner, 1, mode="edge")
    along_u = np.concatenate([2.0 * inner[:1] - inner[1:2], inner, 2.0 * inner[-1:] - inner[-2:-1]])
    return np.ascontiguousarray(
        np.concatenate([2.0 * along_u[:, :1] - along_u[:, 1:2], along_u, 2.0 * along_u[:, -1:] - along_u[:, -2:-1]], 1)
    )


@kernel
def _two_sweeps(corner, is_open, out):
    # eight lines at a time; the last of them stand in for those that eight would have beyond the grid
    n, m = corner.shape
    longest = max(n, m)
    line, free, b = np.empty((longest, LINES)), np.empty((longest, LINES)), np.empty((longest, LINES))
    work = np.empty((WORK, longest, LINES))
    most = fallbacks = 0
    for first in range(0, m, LINES):
        for i in range(n):
            for k in range(LINES):
                height = corner[i, min(first + k, m - 1)]
                known = height > -np.inf
                line[i, k], free[i, k] = (height, 0.0) if known else (0.0, 1.0)
        solves, left = broken_lines(line[:n], free[:n], is_open, b[:n], work[:, :n])
        most, fallbacks = max(most, solves), fallbacks + left
        for i in range(n):
            for k in range(min(LINES, m - first)):
                out[i, first + k] = b[i, k]
    empty = np.ones(m)
    for i in range(n):
        for j in range(m):
            empty[j] = 0.0 if corner[i, j] > -np.inf else empty[j]
    for first in range(0, n, LINES):
        for k in range(LINES):
            i = min(first + k, n - 1)
            for j in range(m):
                line[j, k], free[j, k] = out[i, j], empty[j]
        solves, left = broken_lines(line[:m], free[:m], is_open, b[:m], work[:, :m])
        most, fallbacks = max(most, solves), fallbacks + left
        for k in range(min(LINES, n - first)):
            for j in range(m):
                out[first + k, j] = b[j, k]
    return most, fallbacks
