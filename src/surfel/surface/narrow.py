"""Neighbourhoods of two rows: along the border of a grid whose rows lie apart, and wherever scan lines do.

Two rows of points show how a surface slopes across them, or how it bends, but not one apart from the other; a single
row shows neither. What is fitted to such neighbours may stand at right angles to the surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats

NARROW = 0.003
"""How much of the squared offsets across a row of points the offsets themselves leave open, as a share of the largest
one squared, below which the neighbours lie on two rows."""

SINGLE, SINGLE_NOISY = 0.15, 0.5
"""Largest squared offset across a row, in mean squared distances, of neighbours that all lie on it: rows bend, too. And
the same where points are off by noise, for what most of a cloud shows alone."""

_CHANCE = 2  # so many of a sample may lie so by chance


def narrow_rows(points: Floats, near: NDArray[np.int32], few: int, sample: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the points whose ``few`` nearest neighbours lie on two rows; none where hardly any of a sample do."""
    few = min(few, near.shape[1])
    if few < 6 or on_two_rows(points, sample, near[sample], few).sum() <= _CHANCE:
        return np.empty(0, np.int32)
    everyone = np.arange(len(points), dtype=np.int32)
    return everyone[on_two_rows(points, everyone, near, few)]


def on_two_rows(
    points: Floats, chosen: NDArray[np.int32], neighbours: NDArray[np.int32], few: int, single: float = SINGLE
) -> NDArray[np.bool_]:
    """Tell for each chosen point whether its ``few`` nearest neighbours lie on two rows, or on one.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Coordinates.
    chosen : NDArray[np.int32], shape (m,)
        Which points.
    neighbours : NDArray[np.int32], shape (m, k)
        Their nearest neighbours, ascending by distance.
    few : int
        How many of them are asked, at most k.
    single : float
        How far off a row its points may lie, see :data:`SINGLE`.
    """
    found = np.zeros(len(chosen), np.bool_)
    with threads_for(2 * len(chosen)):
        _on_two_rows(len(chosen), points, chosen, neighbours, np.int64(few), single, found)
    return found


@rows
def _on_two_rows(first, last, points, chosen, neighbours, few, single, found):
    x, y, z = np.empty(few), np.empty(few), np.empty(few)
    for row in range(first, last):
        i, j = chosen[row], neighbours[row, 0]  # along a row points lie nearest
        ex, ey, ez = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        inverse = 1.0 / (ex * ex + ey * ey + ez * ez + 1e-300)
        total = farthest = fx = fy = fz = 0.0
        for a in range(few):
            j = neighbours[row, a]
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            total += dx * dx + dy * dy + dz * dz
            along = (dx * ex + dy * ey + dz * ez) * inverse
            x[a], y[a], z[a] = dx - along * ex, dy - along * ey, dz - along * ez
            square = x[a] * x[a] + y[a] * y[a] + z[a] * z[a]
            if square > farthest:
                farthest, fx, fy, fz = square, x[a], y[a], z[a]
        if few * farthest <= single * total:
            found[row] = True
            continue
        s1 = s2 = s3 = s4 = 0.0
        for a in range(few):  # offsets v across the row: what v tells of v^2 is no bend
            v = (x[a] * fx + y[a] * fy + z[a] * fz) / farthest
            s1 += v
            s2 += v * v
            s3 += v * v * v
            s4 += v * v * v * v
        m = 1.0 / (few + 1)
        s1, s2, s3, s4 = s1 * m, s2 * m, s3 * m, s4 * m
        spread, joint = s2 - s1 * s1, s3 - s1 * s2
        found[row] = (s4 - s2 * s2) * spread - joint * joint < NARROW * spread
