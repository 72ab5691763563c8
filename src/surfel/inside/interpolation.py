"""Lengths known at every so many points of a curve's order, smoothed and taken over by those between them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel, rows, threads_for
from surfel.core.cast import Booleans, Floats

AGREE = 1.5
"""Lengths that differ by more than this factor from the nearest one count as if they differed by it."""

FAR = 2.5
"""A known point farther away than this many of its lengths says nothing."""

STRAY = 4.0
"""A point farther than so many of its lengths from a neighbour, and off its plane, is a stranger to it."""

OFF_PLANE = 0.35
"""Sine of the angle over the plane of a neighbour, or of that over its own, from which on the two are strangers."""

KNOWN_TO = 2
"""A point that is a stranger to all but so many of its neighbours is a stray; some of these may be strays as well."""

_APART = 4  # points between those that are averaged over


def along_the_order(points: Floats, known: Floats, stride: int) -> tuple[Floats, Booleans]:
    """Return for every point the root mean square of four lengths known near it in the order, and whether to trust it.

    The nearer one in space, of those before and after it, is what the others may not differ much from; that halves what
    chance adds to single lengths. Where it is many of its lengths away (a stray, or a leap of the curve between dense
    and sparse parts), it says nothing about the point.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Sorted along a curve.
    known : Floats, shape (ceil(n / stride),)
        The lengths at points 0, stride, 2 stride, ...
    stride : int
        At least 1.
    """
    values, trusted = np.empty(len(points)), np.empty(len(points), bool)
    with threads_for(len(points)):
        _take_over(len(points), points, known, np.int64(stride), np.int64(max(1, _APART // stride)), values, trusted)
    return values, trusted


@rows
def _take_over(first, last, points, known, stride, apart, values, trusted):
    most = len(known) - 1
    for n in range(first, last):
        before = n // stride
        after = min(before + 1, most)
        to_a = to_b = 0.0
        for axis in range(3):
            to_a += (points[n, axis] - points[before * stride, axis]) ** 2
            to_b += (points[n, axis] - points[after * stride, axis]) ** 2
        here = before if to_a <= to_b else after
        length = known[here]
        low, high = length / AGREE, length * AGREE
        total = length * length
        for step in range(-1, 3):
            if step != 0:
                other = min(max(known[min(max(here + step * apart, 0), most)], low), high)
                total += other * other
        values[n] = math.sqrt(0.25 * total)
        trusted[n] = min(to_a, to_b) <= FAR * FAR * length * length


def mark_strays(
    chosen: NDArray[np.integer[Any]], squares: Floats, near: NDArray[np.int32], points: Floats, normals: Floats,
    lengths: Floats, longest: float, strays: Booleans,
) -> None:  # fmt: skip
    """Mark those of some points that are strangers to their neighbours.

    A point of a sparse part lies far from others, but in their planes, and they in its own. Strays lie far from each
    other too, and have large lengths for it; but hardly ever in each other's planes.

    Parameters
    ----------
    chosen : NDArray[np.integer], shape (m,)
        Rows of the points.
    squares, near : Floats and NDArray[np.int32], shape (m, k)
        The squared distances and the rows of their neighbours.
    points, normals, lengths : Floats, shape (n, 3), (n, 3) and (n,)
        Of all points.
    longest : float
        A length above this says nothing about who is near.
    strays : Booleans, shape (n,)
        Where to write. Neighbours that are strays already know nobody.
    """
    _mark_strays(
        np.ascontiguousarray(chosen, np.int64), squares, near, points, normals, lengths, longest, strays.copy(), strays
    )


@kernel
def _mark_strays(chosen, squares, near, points, normals, lengths, longest, before, strays):
    for row in range(len(chosen)):
        i, known = chosen[row], 0
        for a in range(near.shape[1]):
            j = near[row, a]
            if before[j]:
                continue
            length = STRAY * lengths[j] if lengths[j] <= longest else 0.0
            here = there = 0.0
            for axis in range(3):
                step = points[i, axis] - points[j, axis]
                here, there = here + normals[i, axis] * step, there + normals[j, axis] * step
            off = max(abs(here), abs(there))
            if squares[row, a] <= length * length or off * off <= OFF_PLANE * OFF_PLANE * squares[row, a]:
                known += 1
                if known > KNOWN_TO:
                    break
        strays[i] = known <= KNOWN_TO and near.shape[1] > 2 * KNOWN_TO
