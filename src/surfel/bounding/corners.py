"""A safe surface over a grid of corners: Heuristic(sigma, b) along the rows, then along the columns (sec. 6)."""

from __future__ import annotations

import numpy as np

from surfel._numba import kernel
from surfel.bounding.bezier import framed, over_windows
from surfel.bounding.broken_line import broken_line
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
    n, m = corner.shape
    longest = max(n, m)
    work = np.empty((5, longest))
    line, b, free = np.empty(longest), np.empty(longest), np.empty(longest, np.bool_)
    empty = np.empty(m, np.bool_)
    most = fallbacks = 0
    for j in range(m):
        known = 0
        for i in range(n):
            free[i] = not corner[i, j] > -np.inf
            line[i] = 0.0 if free[i] else corner[i, j]
            known += 0 if free[i] else 1
        empty[j] = known == 0
        solves = broken_line(line[:n], free[:n], is_open, b[:n], work[:, :n])
        fallbacks += 1 if solves < 0 else 0
        most = max(most, abs(solves))
        for i in range(n):
            out[i, j] = b[i]
    for i in range(n):
        for j in range(m):
            line[j] = out[i, j]
        solves = broken_line(line[:m], empty, is_open, b[:m], work[:, :m])
        fallbacks += 1 if solves < 0 else 0
        most = max(most, abs(solves))
        for j in range(m):
            out[i, j] = b[j]
    return most, fallbacks
