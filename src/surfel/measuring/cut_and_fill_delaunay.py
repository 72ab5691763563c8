"""Delaunay triangles of points in the plane, in whole numbers, so that no rounding can spoil them.

Points are put on a lattice of 2^26 places a side. The test on which side of a line a point lies is then exact in double
precision, and that for the circle is trusted only where its sign is sure: cocircular points of a grid stay as they are.
Points are inserted in rounds, each twice as large as the one before and in Hilbert order (Amenta, Choi and Rote, 2003),
so that each one is found a few steps from the last; edges are flipped until they are locally Delaunay (Lawson, 1977).
The outside is filled with triangles to a point at infinity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel
from surfel.core.cast import Floats
from surfel.index.hilbert import hilbert_order

SIDE = 1 << 26
"""Places along a side of the lattice: products of two differences still fit a double's 53 bits."""


def on_lattice(plane: Floats, low: Floats, size: float) -> Floats:
    """Return points of the plane as whole numbers of 0 to 2^26 - 1, in doubles; ``size`` is the side of the square."""
    scale = (SIDE - 1) / size if size > 0.0 else 0.0
    return np.asarray(np.rint((plane - low) * scale))


def delaunay(places: Floats) -> NDArray[np.int32]:
    """Return the Delaunay triangles of distinct points with whole coordinates.

    Parameters
    ----------
    places : Floats, shape (n, 2)
        What :func:`on_lattice` gave, each place once.

    Returns
    -------
    NDArray[np.int32], shape (m, 3)
        Rows of ``places``, counterclockwise; none where all points lie on one line.
    """
    n = len(places)
    start = _first_triangle(places)
    if start is None:
        return np.empty((0, 3), np.int32)
    order = _in_rounds(places, start)
    corners, across = np.empty((2 * n + 2, 3), np.int32), np.empty((2 * n + 2, 3), np.int32)
    x, y = np.ascontiguousarray(places[:, 0]), np.ascontiguousarray(places[:, 1])
    count = _insert_all(x, y, order, corners, across, np.empty(2 * n + 16, np.int32))
    found = corners[:count]
    return np.ascontiguousarray(found[(found < n).all(axis=1)])


def _first_triangle(places: Floats) -> tuple[int, int, int] | None:
    """Return three rows that do not lie on one line, counterclockwise."""
    if len(places) < 3:
        return None
    away = places - places[0]
    far = int(np.argmax((away**2).sum(axis=1)))
    side = away[far, 0] * away[:, 1] - away[far, 1] * away[:, 0]
    third = int(np.argmax(np.abs(side)))
    if side[third] == 0.0:
        return None
    return (0, far, third) if side[third] > 0.0 else (0, third, far)


def _in_rounds(places: Floats, start: tuple[int, int, int]) -> NDArray[np.int32]:
    """Return the rows by rounds of 1, 2, 4, ... shares, each in Hilbert order, after those of the first triangle."""
    n = len(places)
    order = hilbert_order(np.column_stack([places, np.zeros(n)]))
    number = np.random.default_rng(0).integers(1, 1 << 30, n)
    last = np.log2((number & -number).astype(np.float64)).astype(np.int8)  # half of the points have 0
    by_round = order[np.argsort(-last, kind="stable")]
    return np.concatenate([np.array(start, np.int32), by_round[~np.isin(by_round, start)]]).astype(np.int32)


@inlined
def _turn(ax, ay, bx, by, cx, cy):
    """Return twice the signed area of a triangle: positive counterclockwise, exact on the lattice."""
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


@inlined
def _in_circle(ax, ay, bx, by, cx, cy, dx, dy):
    """Tell whether d lies inside the circle of a counterclockwise triangle, for sure."""
    ax, ay, bx, by, cx, cy = ax - dx, ay - dy, bx - dx, by - dy, cx - dx, cy - dy
    a = (ax * ax + ay * ay) * (bx * cy - by * cx)
    b = (bx * bx + by * by) * (cx * ay - cy * ax)
    c = (cx * cx + cy * cy) * (ax * by - ay * bx)
    return a + b + c > 1e-15 * (abs(a) + abs(b) + abs(c))


@kernel
def _insert_all(x, y, order, corners, across, stack):
    """Insert points one by one; vertex n is at infinity. Side i of a triangle lies opposite its corner i."""
    n = len(x)
    a, b, c = order[0], order[1], order[2]
    corners[0, 0], corners[0, 1], corners[0, 2] = a, b, c
    across[0, 0], across[0, 1], across[0, 2] = 1, 2, 3
    corners[1, 0], corners[1, 1], corners[1, 2] = n, c, b
    across[1, 0], across[1, 1], across[1, 2] = 0, 3, 2
    corners[2, 0], corners[2, 1], corners[2, 2] = n, a, c
    across[2, 0], across[2, 1], across[2, 2] = 0, 1, 3
    corners[3, 0], corners[3, 1], corners[3, 2] = n, b, a
    across[3, 0], across[3, 1], across[3, 2] = 0, 2, 1
    count, here, turn = 4, 0, 0
    for step in range(3, n):
        p = order[step]
        px, py = x[p], y[p]
        if corners[here, 0] == n or corners[here, 1] == n or corners[here, 2] == n:
            for i in range(3):
                if corners[here, i] == n:
                    here = across[here, i]
                    break
        walking = True
        while walking:  # towards p, across any side that has it on its other hand
            walking = False
            turn += 1  # sides in changing order: no walk goes in circles
            for s in range(3):
                i = (s + turn) % 3
                u, v = corners[here, (i + 1) % 3], corners[here, (i + 2) % 3]
                if _turn(x[u], y[u], x[v], y[v], px, py) < 0.0:
                    here = across[here, i]
                    walking = corners[here, 0] != n and corners[here, 1] != n and corners[here, 2] != n
                    break
        a, b, c = corners[here, 0], corners[here, 1], corners[here, 2]
        na, nb, nc = across[here, 0], across[here, 1], across[here, 2]
        second, third = count, count + 1
        count += 2
        corners[here, 0], corners[here, 1], corners[here, 2] = p, b, c
        across[here, 0], across[here, 1], across[here, 2] = na, second, third
        corners[second, 0], corners[second, 1], corners[second, 2] = p, c, a
        across[second, 0], across[second, 1], across[second, 2] = nb, third, here
        corners[third, 0], corners[third, 1], corners[third, 2] = p, a, b
        across[third, 0], across[third, 1], across[third, 2] = nc, here, second
        for i in range(3):
            if across[nb, i] == here:
                across[nb, i] = second
                break
        for i in range(3):
            if across[nc, i] == here:
                across[nc, i] = third
                break
        stack[0], stack[1], stack[2], top = here, second, third, 3
        while top > 0:
            top -= 1
            t = stack[top]
            o = across[t, 0]
            j = 0 if across[o, 0] == t else 1 if across[o, 1] == t else 2
            b, c, d = corners[t, 1], corners[t, 2], corners[o, j]
            if c == n:  # the hull runs d, b, p
                flip = _turn(x[d], y[d], x[b], y[b], px, py) < 0.0
            elif b == n:  # the hull runs p, c, d
                flip = _turn(px, py, x[c], y[c], x[d], y[d]) < 0.0
            elif _turn(px, py, x[b], y[b], x[c], y[c]) == 0.0:  # p lies on the side itself
                flip = True
            elif d == n:
                flip = False
            else:
                flip = _in_circle(px, py, x[b], y[b], x[c], y[c], x[d], y[d])
            if not flip:
                continue
            over_b = across[o, (j + 1) % 3]  # across the side from b to d
            over_c = across[o, (j + 2) % 3]  # across the side from d to c
            beside_c, beside_b = across[t, 1], across[t, 2]
            corners[t, 0], corners[t, 1], corners[t, 2] = p, b, d
            across[t, 0], across[t, 1], across[t, 2] = over_b, o, beside_b
            corners[o, 0], corners[o, 1], corners[o, 2] = p, d, c
            across[o, 0], across[o, 1], across[o, 2] = over_c, beside_c, t
            for i in range(3):
                if across[over_b, i] == o:
                    across[over_b, i] = t
                    break
            for i in range(3):
                if across[beside_c, i] == t:
                    across[beside_c, i] = o
                    break
            stack[top], stack[top + 1] = t, o
            top += 2
    return count
