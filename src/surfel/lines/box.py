"""An oriented box of small surface around points.

Lines hit a convex body in proportion to its surface, so the surface, not the volume, is what is made small. About a
fixed axis the best box is found exactly, from the convex hull of the points' projection: one of its sides lies along
an edge of that hull (Freeman and Shapira, *Determining the minimum-area encasing rectangle for an arbitrary closed
curve*, CACM 18(7), 1975). The axes tried are a fixed fan in the frame of the principal axes and the directions between
extreme points; the best few are then turned about one of their own axes after another until no turn helps. Only points
that are extreme in some direction take part in the search. Nothing in it depends on the coordinate axes, so
the box moves with the points, unless the axis-aligned box is smaller and taken instead.
"""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import rows, threads_for
from surfel._vec import dot
from surfel.core.cast import Floats, Integers, as_points
from surfel.core.errors import InputError
from surfel.lines.calipers import turn_about_each
from surfel.lines.local import Local

_CHUNK = 16_384
_FEW = 128  # so many points are all taken for extreme
_STARTS = 8
_ROUNDS = 6
_TURNS = 30
_GAIN = 1e-10  # a smaller gain is rounding
_WORTH = 1e-3  # a smaller gain is not worth another round


class OrientedBox(NamedTuple):
    """A box: its centre (3,), its unit axes as the rows of a matrix (3, 3), and half its sides (3,)."""

    centre: Floats
    axes: Floats
    half: Floats

    @property
    def surface(self) -> float:
        """The area of its six faces."""
        a, b, c = (float(side) for side in self.half)
        return 8.0 * (a * b + b * c + c * a)

    @property
    def volume(self) -> float:
        """The product of its sides."""
        return 8.0 * float(np.prod(self.half))

    @property
    def corners(self) -> Floats:
        """Its eight corners, shape (8, 3)."""
        signs = np.array(list(product((-1.0, 1.0), repeat=3)))
        return np.asarray(self.centre + (signs * self.half) @ self.axes)

    def grown(self, margin: float) -> OrientedBox:
        """Return the box with ``margin`` added on every side."""
        return OrientedBox(self.centre, self.axes, self.half + margin)


def oriented_box(points: ArrayLike) -> OrientedBox:
    """Return a box of small surface that holds all points; its surface never exceeds that of the axis-aligned box.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        At least one finite point; equal, collinear and coplanar points give sides of 0.

    Returns
    -------
    OrientedBox
        Longest side first, axes right-handed. Not proven to be the smallest.

    Raises
    ------
    InputError
        If there is no point, or the points are not (n, 3) and finite.

    Examples
    --------
    >>> from surfel.lines.enclosing import oriented_box
    >>> box = oriented_box([(0, 0, 0), (4, 4, 0), (3, 5, 0), (-1, 1, 0)])
    >>> box.half.round(6).tolist()
    [2.828427, 0.707107, 0.0]
    """
    cloud = as_points(points)
    if len(cloud) == 0:
        raise InputError("points must hold at least one point; got none")
    middle, unit = Local.of(cloud)
    if unit == 0.0:
        return OrientedBox(cloud[0].copy(), np.eye(3), np.zeros(3))
    found = _search(cloud, middle, unit)
    upright, _ = _box_along(cloud, middle, unit, np.eye(3))
    return _ordered(upright if upright.surface < found.surface * (1.0 - _GAIN) else found)


def _search(cloud: Floats, middle: Floats, unit: float) -> OrientedBox:
    """Return the best box found: of a few extreme points first, then with those added that stick out of it."""
    frame = _principal_axes(cloud, middle, unit)
    extreme = _extreme_points(cloud, middle, unit, _fan(2) @ frame)
    starts = np.vstack([_fan(4) @ frame, _edges(extreme, frame)])
    best: OrientedBox | None = None
    for _ in range(_ROUNDS):
        axes, inner, starts = _best_axes(extreme, starts)
        box, touched = _box_along(cloud, middle, unit, axes)
        if best is None or box.surface < best.surface * (1.0 - _GAIN):
            best = box
        if box.surface / unit / unit <= inner * (1.0 + _WORTH):
            break
        extreme = np.unique(np.vstack([extreme, touched]), axis=0)
    assert best is not None
    return best


def _principal_axes(cloud: Floats, middle: Floats, unit: float) -> Floats:
    """Return the eigenvectors of the second moments as rows, in ascending order of the eigenvalues."""
    total, products = np.zeros(3), np.zeros((3, 3))
    for start in range(0, len(cloud), _CHUNK):
        local = (cloud[start : start + _CHUNK] - middle) / unit
        total += local.sum(axis=0)
        products += local.T @ local
    mean = total / len(cloud)
    return np.ascontiguousarray(np.linalg.eigh(products / len(cloud) - np.outer(mean, mean))[1].T)


def _fan(steps: int) -> Floats:
    """Return unit vectors, one of each opposite pair, that change into each other under the symmetries of a cube.

    There are 13, 49, 145, 289 of them for 1, 2, 3, 4 steps. Because of the symmetry the signs and the order of the
    principal axes do not matter.
    """
    span = range(-steps, steps + 1)
    grid = np.array([v for v in product(span, repeat=3) if math.gcd(*v) == 1], dtype=float)
    upper = grid[[tuple(v) > (0.0, 0.0, 0.0) for v in grid]]
    return np.asarray(upper / np.linalg.norm(upper, axis=1, keepdims=True))


def _extreme_points(cloud: Floats, middle: Floats, unit: float, directions: Floats) -> Floats:
    """Return, in local coordinates, the points that are first or last in some direction, in a fixed order."""
    chosen = cloud if len(cloud) <= _FEW else cloud[_extremes(cloud, middle, unit, directions)[1]]
    return np.ascontiguousarray(np.unique((chosen - middle) / unit, axis=0))


def _best_axes(extreme: Floats, starts: Floats) -> tuple[Floats, float, Floats]:
    """Return the axes of the best box found around the extreme points, its surface, and the most promising starts."""
    surfaces, turned = np.empty(len(starts)), np.empty((len(starts), 3, 3))
    turn_about_each(extreme, starts, surfaces, turned)
    order = np.argsort(surfaces, kind="stable")
    ranked = surfaces[order]
    order = order[np.append(True, ranked[1:] > ranked[:-1] * (1.0 + _GAIN))]  # one box is found from several axes
    best_surface, best = math.inf, np.eye(3)
    for start in order[:_STARTS]:
        surface, axes = _turn_until_still(extreme, float(surfaces[start]), turned[start])
        if surface < best_surface * (1.0 - _GAIN):
            best_surface, best = surface, axes
    return best, best_surface, np.vstack([best, starts[order[: 4 * _STARTS]]])


def _edges(extreme: Floats, frame: Floats) -> Floats:
    """Return the directions between the points that are extreme along the principal axes and their diagonals."""
    reach = extreme @ (_fan(1) @ frame).T
    some = np.unique(np.concatenate([reach.argmin(axis=0), reach.argmax(axis=0)]))
    first, second = np.triu_indices(len(some), 1)
    edges = extreme[some[second]] - extreme[some[first]]
    lengths = np.linalg.norm(edges, axis=1, keepdims=True)
    return np.asarray(edges[lengths[:, 0] > 0.0] / lengths[lengths[:, 0] > 0.0])


def _turn_until_still(extreme: Floats, surface: float, axes: Floats) -> tuple[float, Floats]:
    """Turn a box about its axes in turn, each time to the best position, until no turn helps."""
    for _ in range(_TURNS):
        surfaces, turned = np.empty(3), np.empty((3, 3, 3))
        turn_about_each(extreme, axes, surfaces, turned)
        least = int(surfaces.argmin())
        if not surfaces[least] < surface * (1.0 - _GAIN):
            break
        surface, axes = float(surfaces[least]), turned[least]
    return surface, axes


def _box_along(cloud: Floats, middle: Floats, unit: float, axes: Floats) -> tuple[OrientedBox, Floats]:
    """Return the box with the given axes around all points, and the points that it touches in local coordinates."""
    axes = np.ascontiguousarray(axes)
    reach, index = _extremes(cloud, middle, unit, axes)
    centre = middle + unit * (0.5 * (reach[0::2] - reach[1::2]) @ axes)
    reach, _ = _extremes(cloud, centre, unit, axes)  # half sides are measured from the rounded centre
    half = unit * np.maximum(reach[0::2], reach[1::2])
    return OrientedBox(centre, axes, half), (cloud[index] - middle) / unit


def _extremes(cloud: Floats, middle: Floats, unit: float, directions: Floats) -> tuple[Floats, Integers]:
    """Return how far the points reach along each direction and against it, alternately, and which point does."""
    chunks = -(-len(cloud) // _CHUNK)
    index = np.empty((chunks, 2 * len(directions)), np.int64)
    reach = np.empty((chunks, 2 * len(directions)))
    with threads_for(len(cloud)):
        _extremes_by_chunk(chunks, cloud, middle, 1.0 / unit, directions, index, reach)
    chunk, column = reach.argmax(axis=0), np.arange(reach.shape[1])
    return reach[chunk, column], index[chunk, column]


def _ordered(box: OrientedBox) -> OrientedBox:
    """Return the same box with its longest side first, its axes right-handed and their signs fixed."""
    order = np.argsort(-box.half, kind="stable")
    axes = box.axes[order]
    for axis in axes[:2]:
        if axis[np.abs(axis).argmax()] < 0.0:
            axis *= -1.0
    axes[2] = np.cross(axes[0], axes[1])
    return OrientedBox(box.centre, axes, box.half[order])


@rows
def _extremes_by_chunk(begin, end, cloud, middle, scale, directions, index, reach):
    """Write, for each chunk and direction, the last point along it and its place, then the first and minus its."""
    for chunk in range(begin, end):
        reach[chunk, :] = -np.inf
        for i in range(chunk * _CHUNK, min((chunk + 1) * _CHUNK, len(cloud))):
            x = (cloud[i, 0] - middle[0]) * scale
            y = (cloud[i, 1] - middle[1]) * scale
            z = (cloud[i, 2] - middle[2]) * scale
            for d in range(len(directions)):
                place = dot(x, y, z, directions[d, 0], directions[d, 1], directions[d, 2])
                if place > reach[chunk, 2 * d]:
                    reach[chunk, 2 * d], index[chunk, 2 * d] = place, i
                if -place > reach[chunk, 2 * d + 1]:
                    reach[chunk, 2 * d + 1], index[chunk, 2 * d + 1] = -place, i
