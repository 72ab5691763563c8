"""The smallest ball around points: exact, in a few passes over them; and the door to the enclosing box.

A ball is the smallest one around its points exactly if its centre is a convex combination of points on its sphere.
The search keeps at most four such support points: it adds the farthest point of all, takes the smallest ball of the
(at most five) points, keeps the points that hold it, and repeats until nothing lies outside (the farthest-point pivot
rule of Gärtner, *Fast and robust smallest enclosing balls*, ESA 1999). The radius grows with each pass, so no support
comes back; some ten passes are usual, each linear in the number of points.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats, as_points
from surfel.core.errors import InputError
from surfel.lines.box import OrientedBox, oriented_box
from surfel.lines.local import Local

__all__ = ["Ball", "OrientedBox", "oriented_box", "smallest_ball"]

_CHUNK = 16_384
_MOST_PASSES = 1_000
_ROUNDING = 4e-16


class Ball(NamedTuple):
    """A ball: its centre (3,) and its radius."""

    centre: Floats
    radius: float

    @property
    def surface(self) -> float:
        """The area of its sphere."""
        return 4.0 * math.pi * self.radius**2

    def grown(self, margin: float) -> Ball:
        """Return the ball with ``margin`` added to its radius."""
        return Ball(self.centre, self.radius + margin)


def smallest_ball(points: ArrayLike) -> Ball:
    """Return the smallest ball that holds all points.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        At least one finite point; equal, collinear and coplanar points are as good as any.

    Returns
    -------
    Ball
        ``(centre, radius)``: centre (3,) and radius in the units of the points. Every point lies inside to within the
        rounding of one distance. The radius is 0 if all points are equal.

    Raises
    ------
    InputError
        If there is no point, or the points are not (n, 3) and finite.

    Examples
    --------
    >>> from surfel.lines.enclosing import smallest_ball
    >>> centre, radius = smallest_ball([(0, 0, 0), (2, 0, 0), (1, 0.5, 0)])
    >>> centre.tolist(), radius
    ([1.0, 0.0, 0.0], 1.0)
    """
    cloud = as_points(points)
    if len(cloud) == 0:
        raise InputError("points must hold at least one point; got none")
    middle, unit = Local.of(cloud)
    if unit == 0.0:
        return Ball(cloud[0].copy(), 0.0)
    centre = middle + unit * _centre(cloud, middle, unit)
    _, radius = _farthest(cloud, centre, unit, np.zeros(3))  # from the rounded centre
    return Ball(centre, unit * radius)


def _centre(cloud: Floats, middle: Floats, unit: float) -> Floats:
    """Return the centre of the smallest ball of (cloud - middle) / unit."""
    best_centre = np.zeros(3)
    farthest, best_radius = _farthest(cloud, middle, unit, best_centre)
    support = ((cloud[farthest] - middle) / unit)[None, :]
    for _ in range(_MOST_PASSES):
        support, centre, inner = _ball_of_few(support)
        farthest, radius = _farthest(cloud, middle, unit, centre)
        if radius < best_radius:
            best_centre, best_radius = centre, radius
        outside = (cloud[farthest] - middle) / unit
        if radius <= inner * (1.0 + _ROUNDING) or (support == outside).all(axis=1).any():
            break
        support = np.vstack([support, outside])
    return best_centre


def _ball_of_few(points: Floats) -> tuple[Floats, Floats, float]:
    """Return the support, the centre and the radius of the smallest ball of at most five points.

    The smallest ball is the circumscribed ball of one of the subsets. Each subset's centre is judged by the distance
    of its farthest point, so that no tolerance decides: a wrong centre is only ever too far away. The points are
    sorted first, so that the same points give the same bits in any order.
    """
    points = points[np.lexsort(points.T)]
    best: tuple[Floats, Floats, float] | None = None
    for size in range(1, min(len(points), 4) + 1):
        for subset in combinations(range(len(points)), size):
            chosen = points[list(subset)]
            centre = _circumcentre(chosen)
            if centre is None:
                continue
            radius = math.sqrt(float(np.square(points - centre).sum(axis=1).max()))
            if best is None or radius < best[2]:
                best = chosen, centre, radius
    assert best is not None  # single points always have a centre
    return best


def _circumcentre(points: Floats) -> Floats | None:
    """Return the point at equal distances from affinely independent points, in their affine hull; else None.

    With the edges e_i from the first point and the centre at that point plus sum(l_j e_j):
    sum_j (e_i . e_j) l_j = e_i . e_i / 2. Solved by the orthogonal factors of the edges, which do not square their
    condition.
    """
    edges = points[1:] - points[0]
    if len(edges) == 0:
        return np.asarray(points[0])
    if len(edges) == 1:
        return np.asarray(points[0] + 0.5 * edges[0])
    q, r = np.linalg.qr(edges.T)
    diagonal = np.abs(np.diag(r))
    if diagonal.min() <= 1e-14 * diagonal.max():
        return None
    along = np.linalg.solve(r.T, 0.5 * np.square(edges).sum(axis=1))
    return np.asarray(points[0] + q @ along)


def _farthest(cloud: Floats, middle: Floats, unit: float, centre: Floats) -> tuple[int, float]:
    """Return which point lies farthest from ``centre``, and how far."""
    chunks = -(-len(cloud) // _CHUNK)
    index, square = np.empty(chunks, np.int64), np.empty(chunks)
    with threads_for(len(cloud)):
        _farthest_by_chunk(chunks, cloud, middle, 1.0 / unit, centre, index, square)
    chunk = int(square.argmax())
    return int(index[chunk]), math.sqrt(square[chunk])


@rows
def _farthest_by_chunk(begin, end, cloud, middle, scale, centre, index, square):
    """Write, for each chunk, its farthest point and that point's squared distance."""
    for chunk in range(begin, end):
        farthest, most = chunk * _CHUNK, -1.0
        for i in range(chunk * _CHUNK, min((chunk + 1) * _CHUNK, len(cloud))):
            x = (cloud[i, 0] - middle[0]) * scale - centre[0]
            y = (cloud[i, 1] - middle[1]) * scale - centre[1]
            z = (cloud[i, 2] - middle[2]) * scale - centre[2]
            distance = x * x + y * y + z * z
            if distance > most:
                farthest, most = i, distance
        index[chunk], square[chunk] = farthest, most
