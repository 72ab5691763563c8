"""Two clusters: the nearest surfels split by their normals into two planes, whose edge is convex or concave."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import inner, rows
from surfel._vec import dot, norm
from surfel.inside.falloff import falloff
from surfel.inside.holder import HasOperand, as_operand
from surfel.inside.judges.imls import weighted_side
from surfel.inside.judges.nearest import over_plane
from surfel.inside.judges.skipping import judge_by, look_with
from surfel.inside.judges.verdict import Verdict
from surfel.inside.operand import Operand

ALIKE = 0.85
"""Where all normals make a larger cosine than this with the nearest one, there is no edge."""

OPPOSED = -0.7
"""Where one makes a smaller cosine than this, there are two sheets back to back and no edge between them."""

WIDTH = 0.5
"""Square of the Gaussian's width over the squared distance to the farthest of the neighbours."""


def judge(cloud: Operand | HasOperand, queries: ArrayLike, *, k: int = 10, skip: bool = True) -> Verdict:
    """Judge places by the k nearest surfels, split in two where their normals spread.

    The nearest surfel leads one cluster and the one whose normal is most unlike leads the other; each surfel follows
    the leader whose normal is more like its own. Each cluster is a plane. A place is inside of a convex edge if it is
    behind both, and inside of a concave one if it is behind one. Where normals are alike, the place is judged by
    :mod:`surfel.inside.judges.imls`.

    Parameters
    ----------
    cloud : Operand or Surfels
        The cloud.
    queries : array_like, shape (q, 3)
        Places, in the coordinates of the cloud.
    k : int
        How many surfels; all of them where there are fewer.
    skip : bool
        Settle places in one empty ball together, see :mod:`surfel.inside.judges.skipping`.

    Returns
    -------
    Verdict
        ``value`` is the distance over the plane that decides; certain where both planes say the same, or where the
        smooth surface is certain.

    Raises
    ------
    InputError
        If the queries are not finite rows of three or ``k`` is less than 1.

    Notes
    -----
    After the neighbourhoods of Adams and Dutre, *Interactive Boolean operations on surfel-bounded solids*, 2003.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.judges import two_cluster
    >>> from surfel.inside.operand import Operand
    >>> side = np.stack(np.meshgrid(np.arange(9.0), np.arange(-4.0, 5), [0.0]), axis=-1).reshape(-1, 3)
    >>> corner = np.concatenate([-side, -side[:, [2, 1, 0]]])
    >>> normals = np.repeat([[0.0, 0, 1], [1, 0, 0]], 81, axis=0)
    >>> found = two_cluster.judge(Operand.of(corner, normals), [[-0.4, 0.1, -0.2], [0.3, 0.1, -0.2]])
    >>> found.inside.tolist()
    [True, False]
    """
    operand = as_operand(cloud)
    return judge_by(look_with(_rule, k), operand, queries, skip=skip)


@inner
def clustered_side(points, normals, x, y, z, squares, near, i, other, sums):
    """Return the distance of place i over what its nearest surfels bound, and whether they agree.

    ``other`` is the surfel whose normal is most unlike that of the nearest; ``sums`` is scratch of shape (2, 7).
    """
    k = near.shape[1]
    lead = near[i, 0]
    lx, ly, lz = normals[lead, 0], normals[lead, 1], normals[lead, 2]
    ox, oy, oz = normals[other, 0], normals[other, 1], normals[other, 2]
    inverse = 1.0 / (WIDTH * squares[i, k - 1]) if squares[i, k - 1] > 0.0 else 0.0
    sums[:, :] = 0.0
    for a in range(k):
        j = near[i, a]
        nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
        c = 0 if dot(nx, ny, nz, lx, ly, lz) >= dot(nx, ny, nz, ox, oy, oz) else 1
        weight = falloff((squares[i, a] - squares[i, 0]) * inverse)
        sums[c, 0] += weight * nx
        sums[c, 1] += weight * ny
        sums[c, 2] += weight * nz
        sums[c, 3] += weight * (points[j, 0] - x)  # about the place: nothing is lost far from the origin
        sums[c, 4] += weight * (points[j, 1] - y)
        sums[c, 5] += weight * (points[j, 2] - z)
        sums[c, 6] += weight
    for c in range(2):
        length = norm(sums[c, 0], sums[c, 1], sums[c, 2])
        turn = 1.0 / length if length > 0.0 else 0.0
        mean = 1.0 / sums[c, 6] if sums[c, 6] > 0.0 else 0.0  # a sum of weights that vanish, far beyond the nearest
        for t in range(3):
            sums[c, t] *= turn
            sums[c, 3 + t] *= mean
    first = -dot(sums[0, 0], sums[0, 1], sums[0, 2], sums[0, 3], sums[0, 4], sums[0, 5])
    second = -dot(sums[1, 0], sums[1, 1], sums[1, 2], sums[1, 3], sums[1, 4], sums[1, 5])
    if (first < 0.0) == (second < 0.0):
        return first, first * second > 0.0
    if dot(lx, ly, lz, ox, oy, oz) < OPPOSED:
        return over_plane(points, normals, lead, x, y, z), False
    convex = 0.0
    for t in range(3):
        convex += (sums[1, t] - sums[0, t]) * (sums[1, 3 + t] - sums[0, 3 + t])
    return max(first, second) if convex > 0.0 else min(first, second), False


@rows
def _rule(first, last, points, normals, places, squares, near, value, certain):
    """Judge places; smooth surfaces, which are most frequent, are told here, without a call."""
    sums = np.empty((2, 7))
    for i in range(first, last):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        lead = near[i, 0]
        lx, ly, lz = normals[lead, 0], normals[lead, 1], normals[lead, 2]
        other, least = lead, 2.0
        for a in range(near.shape[1]):
            j = near[i, a]
            cosine = dot(lx, ly, lz, normals[j, 0], normals[j, 1], normals[j, 2])
            if cosine < least:
                least, other = cosine, j
        if least > ALIKE:
            side, size = weighted_side(points, normals, x, y, z, squares, near, i)
            value[i], certain[i] = side, 2.0 * abs(side) > size
        else:
            value[i], certain[i] = clustered_side(points, normals, x, y, z, squares, near, i, other, sums)
