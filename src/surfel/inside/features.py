"""Features: which surfels lie on smooth pieces, on edges and at corners, by eigen-analysis of their neighbourhoods."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, rows, threads_for
from surfel.core.cast import Floats, as_count
from surfel.core.execute import blocks
from surfel.inside.holder import HasOperand, as_operand
from surfel.inside.operand import Operand
from surfel.surface.planes import smallest_eigenpair

PLANAR, EDGE, CORNER = 0, 1, 2

WIDTH = 0.35
"""Square of the Gaussian's width over the squared distance to the k-th neighbour, as of the surface."""

SECOND = 0.08
"""Share of the normals' second direction from which on there is an edge: planes that meet at 33 degrees have 0.08."""

THIRD = 0.05
"""Share of the third direction from which on there is a corner."""

_ROWS = 1 << 16


class Features(NamedTuple):
    """What the neighbourhood of each surfel looks like; rows as given to ``Operand.of``.

    Parameters
    ----------
    kind : NDArray[np.int8], shape (n,)
        0 planar (or smooth), 1 edge, 2 corner.
    variation : Floats, shape (n,)
        The smallest eigenvalue of the weighted covariance of the places over the sum of all three: 0 in a plane, at
        most 1/3.
    spread : Floats, shape (n, 3)
        The eigenvalues of the weighted mean of ``n n'``, descending; their sum is 1. One direction in a plane, two at
        an edge, three at a corner.
    along : Floats, shape (n, 3)
        The unit direction in which an edge runs, of either sign; zero where there is none.
    """

    kind: NDArray[np.int8]
    variation: Floats
    spread: Floats
    along: Floats


def features(cloud: Operand | HasOperand, *, k: int = 16) -> Features:
    """Find edges, corners and planar pieces.

    The covariance of the places, which the surface's planes are taken from, tells how flat a neighbourhood is; but it
    is the same for an edge and for a strong curve. Which of both there is, and how many planes meet, the normals
    tell: the eigenvalues of their second moments, which does not see their sign.

    Parameters
    ----------
    cloud : Operand or Surfels
        The cloud.
    k : int
        How many neighbours; as many as there are in smaller clouds.

    Returns
    -------
    Features
        ``kind, variation, spread, along``, in the order in which the points were given.

    Raises
    ------
    InputError
        If ``k`` is less than 3.

    Notes
    -----
    Gaal, *Boolean Operations on Point-Sampled Geometry*, sec. 2, item 1, points to the eigenvalues of the weighted
    covariance; the normals take the place of Gumhold's penalty functions.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.features import EDGE, PLANAR, features
    >>> from surfel.inside.operand import Operand
    >>> side = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0]), axis=-1).reshape(-1, 3)
    >>> roof = np.concatenate([side, side[:, [2, 1, 0]] - [0, 0, 1]])
    >>> found = features(Operand.of(roof, np.repeat([[0.0, 0, 1], [-1, 0, 0]], 400, axis=0)))
    >>> bool((found.kind[roof[:, 0] == 10] == PLANAR).all()), bool((found.kind[:400][side[:, 0] == 0] == EDGE).all())
    (True, True)
    """
    operand = as_operand(cloud)
    wanted = min(as_count(k, "k", 3), len(operand) - 1)
    n = len(operand)
    found = Features(np.zeros(n, np.int8), np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3)))
    if wanted < 1:
        found.spread[:, 0] = 1.0
        return found
    for start, stop in blocks(n, _ROWS):
        squares, near = operand.index.knn(wanted, np.arange(start, stop, dtype=np.int32))
        with threads_for(16 * (stop - start)):
            _analyse(
                stop - start, np.int64(start), operand.points, operand.normals, squares, near,
                found.kind, found.variation, found.spread, found.along,
            )  # fmt: skip
    given = np.argsort(operand.order)
    return Features(found.kind[given], found.variation[given], found.spread[given], found.along[given])


@rows
def _analyse(first, last, start, points, normals, squares, near, kind, variation, spread, along):
    k = near.shape[1]
    for row in range(first, last):
        i = start + row  # the row of the results, too
        wide = WIDTH * squares[row, k - 1]
        total = 1.0
        sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        pp, pq, pr, qq, qr, rr = nx * nx, nx * ny, nx * nz, ny * ny, ny * nz, nz * nz
        for a in range(k):
            j = near[row, a]
            weight = math.exp(-squares[row, a] / wide) if wide > 0.0 else 1.0
            x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
            total += weight
            sx, sy, sz = sx + weight * x, sy + weight * y, sz + weight * z
            xx, xy, xz = xx + weight * x * x, xy + weight * x * y, xz + weight * x * z
            yy, yz, zz = yy + weight * y * y, yz + weight * y * z, zz + weight * z * z
            pp, pq, pr = pp + weight * nx * nx, pq + weight * nx * ny, pr + weight * nx * nz
            qq, qr, rr = qq + weight * ny * ny, qr + weight * ny * nz, rr + weight * nz * nz
        mean = 1.0 / total
        sx, sy, sz = sx * mean, sy * mean, sz * mean
        low, middle, high = _eigenvalues(
            xx * mean - sx * sx, xy * mean - sx * sy, xz * mean - sx * sz,
            yy * mean - sy * sy, yz * mean - sy * sz, zz * mean - sz * sz,
        )  # fmt: skip
        size = low + middle + high
        variation[i] = max(low, 0.0) / size if size > 0.0 else 0.0
        trace = pp + qq + rr
        if trace <= 0.0:  # no normals are known here
            spread[i, 0] = 1.0
            continue
        mean = 1.0 / trace
        pp, pq, pr, qq, qr, rr = pp * mean, pq * mean, pr * mean, qq * mean, qr * mean, rr * mean
        low, middle, high = _eigenvalues(pp, pq, pr, qq, qr, rr)
        spread[i, 0], spread[i, 1], spread[i, 2] = high, max(middle, 0.0), max(low, 0.0)
        if low >= THIRD:
            kind[i] = 2
        elif middle >= SECOND:
            kind[i] = 1
            _, along[i, 0], along[i, 1], along[i, 2] = smallest_eigenpair(pp, pq, pr, qq, qr, rr)


@inner
def _eigenvalues(xx, xy, xz, yy, yz, zz):
    """Return the eigenvalues of a symmetric 3 x 3 matrix, ascending: the roots of its characteristic polynomial."""
    mean = (xx + yy + zz) / 3.0
    ax, ay, az = xx - mean, yy - mean, zz - mean
    size = math.sqrt((ax * ax + ay * ay + az * az + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0)
    if size <= 1e-15 * abs(mean) or size == 0.0:
        return mean, mean, mean
    det = ax * (ay * az - yz * yz) - xy * (xy * az - yz * xz) + xz * (xy * yz - ay * xz)
    angle = math.acos(min(1.0, max(-1.0, 0.5 * det / (size * size * size)))) / 3.0
    high = mean + 2.0 * size * math.cos(angle)
    low = mean + 2.0 * size * math.cos(angle + 2.0943951023931953)
    return low, 3.0 * mean - low - high, high
