"""Brute force: the nearest surfel by looking at all of them. What faster judges are compared with."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import inner, rows, threads_for
from surfel.core.cast import Floats
from surfel.inside.holder import HasOperand, as_operand
from surfel.inside.judges.nearest import GRAZING, over_plane
from surfel.inside.judges.verdict import Verdict
from surfel.inside.operand import Operand

_STRETCH = 1024  # surfels that stay in the first cache while several places look at them
_PLACES = 32


def judge(cloud: Operand | HasOperand, queries: ArrayLike) -> Verdict:
    """Judge places by the nearest surfel, found by looking at all of them: n operations for each place.

    The signs are those of :mod:`surfel.inside.judges.nearest` without skipping, except where two surfels are equally
    near: here the first one in the order of the operand decides.

    Parameters
    ----------
    cloud : Operand or Surfels
        The cloud.
    queries : array_like, shape (q, 3)
        Places, in the coordinates of the cloud.

    Returns
    -------
    Verdict
        ``value`` is the distance over the plane of the nearest surfel; certain where it is not seen from the side.

    Raises
    ------
    InputError
        If the queries are not finite rows of three.

    Notes
    -----
    Gaal, *Boolean Operations on Point-Sampled Geometry*, sec. 3: "can be hardly qualified as interactive".

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.judges import brute
    >>> from surfel.inside.operand import Operand
    >>> p = np.random.default_rng(0).standard_normal((500, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> brute.judge(Operand.of(p, p), [[0.0, 0.0, 0.5], [0.0, 0.0, 1.5]]).inside.tolist()
    [True, False]
    """
    operand = as_operand(cloud)
    places = operand.local(queries)
    if not len(operand) or not len(places):
        return Verdict.outside(len(places))
    nearest, square = nearest_of_all(operand.points, places)
    value, certain = np.empty(len(places)), np.empty(len(places), bool)
    with threads_for(len(places)):
        _sides(len(places), operand.points, operand.normals, places, nearest, square, value, certain)
    return Verdict.of(value, certain)


def nearest_of_all(points: Floats, places: Floats) -> tuple[NDArray[np.int32], Floats]:
    """Return the row of the nearest point of each place, the first of equally near ones, and its squared distance."""
    padded = -(-len(points) // _STRETCH) * _STRETCH
    columns = np.full((3, padded), np.inf)
    columns[:, : len(points)] = points.T
    nearest, square = np.empty(len(places), np.int32), np.empty(len(places))
    with threads_for(len(places) * padded // 100):
        _search(-(-len(places) // _PLACES), columns[0], columns[1], columns[2], places, nearest, square)
    return nearest, square


@rows
def _search(first, last, xs, ys, zs, places, nearest, square):
    stretch = np.empty(_STRETCH)
    for group in range(first, last):
        begin, end = group * _PLACES, min(len(places), (group + 1) * _PLACES)
        for i in range(begin, end):
            nearest[i], square[i] = 0, np.inf
        for start in range(0, len(xs), _STRETCH):
            for i in range(begin, end):
                x, y, z = places[i, 0], places[i, 1], places[i, 2]
                if _least_of(xs, ys, zs, start, x, y, z, stretch) < square[i]:
                    for j in range(_STRETCH):  # seldom: the least so far falls about log(n / stretch) times
                        if stretch[j] < square[i]:
                            nearest[i], square[i] = start + j, stretch[j]


@inner
def _least_of(xs, ys, zs, start, x, y, z, squares):
    """Write the squared distances of a stretch of points; return the least. Without a branch, for whole vectors."""
    px, py, pz = xs[start : start + _STRETCH], ys[start : start + _STRETCH], zs[start : start + _STRETCH]
    for j in range(_STRETCH):
        dx, dy, dz = px[j] - x, py[j] - y, pz[j] - z
        squares[j] = (dx * dx + dy * dy) + dz * dz
    half = _STRETCH // 2
    least = squares[:half]
    other = squares[half:]
    a = b = c = d = e = f = g = h = np.inf
    for j in range(0, half, 8):
        a, b = min(a, min(least[j], other[j])), min(b, min(least[j + 1], other[j + 1]))
        c, d = min(c, min(least[j + 2], other[j + 2])), min(d, min(least[j + 3], other[j + 3]))
        e, f = min(e, min(least[j + 4], other[j + 4])), min(f, min(least[j + 5], other[j + 5]))
        g, h = min(g, min(least[j + 6], other[j + 6])), min(h, min(least[j + 7], other[j + 7]))
    return min(min(min(a, b), min(c, d)), min(min(e, f), min(g, h)))


@rows
def _sides(first, last, points, normals, places, nearest, square, value, certain):
    for i in range(first, last):
        side = over_plane(points, normals, nearest[i], places[i, 0], places[i, 1], places[i, 2])
        value[i] = side
        certain[i] = side * side > GRAZING * GRAZING * square[i]
