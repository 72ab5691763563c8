"""The two nearest surfels: where they disagree, their normals say whether the edge between them is convex."""

from __future__ import annotations

from numpy.typing import ArrayLike

from surfel._numba import inner, rows
from surfel._vec import dot
from surfel.inside.holder import HasOperand, as_operand
from surfel.inside.judges.nearest import over_plane
from surfel.inside.judges.skipping import judge_by, look_with
from surfel.inside.judges.verdict import Verdict
from surfel.inside.operand import Operand


def judge(cloud: Operand | HasOperand, queries: ArrayLike, *, skip: bool = True) -> Verdict:
    """Judge places by the two nearest surfels.

    Where both say the same, that; where not, a place is inside of a convex pair if it is behind both planes, and
    inside of a concave pair if it is behind one.

    Parameters
    ----------
    cloud : Operand or Surfels
        The cloud.
    queries : array_like, shape (q, 3)
        Places, in the coordinates of the cloud.
    skip : bool
        Settle places in one empty ball together, see :mod:`surfel.inside.judges.skipping`.

    Returns
    -------
    Verdict
        ``value`` is the distance over the plane that decides; certain where both surfels say the same.

    Raises
    ------
    InputError
        If the queries are not finite rows of three.

    Notes
    -----
    Wicke's test, as Gaal describes it (*Boolean Operations on Point-Sampled Geometry*, sec. 4.3).

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.judges import two_nearest
    >>> from surfel.inside.operand import Operand
    >>> roof = Operand.of([[-1.0, 0, 0], [1, 0, 0]], np.array([[-0.6, 0, 0.8], [0.6, 0, 0.8]]))
    >>> two_nearest.judge(roof, [[-0.2, 0, 0.7], [0.2, 0, 0.5]]).inside.tolist()
    [False, True]
    """
    operand = as_operand(cloud)
    return judge_by(look_with(_rule, 2), operand, queries, skip=skip)


@inner
def beyond_two(points, normals, a, b, x, y, z):
    """Return the distances of a place over the planes of surfels a and b, and over what the two bound."""
    over_a, over_b = over_plane(points, normals, a, x, y, z), over_plane(points, normals, b, x, y, z)
    if (over_a < 0.0) == (over_b < 0.0):
        return over_a, over_b, over_a
    px, py, pz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    nx, ny, nz = normals[b, 0] - normals[a, 0], normals[b, 1] - normals[a, 1], normals[b, 2] - normals[a, 2]
    convex = dot(nx, ny, nz, px, py, pz) > 0.0
    return over_a, over_b, max(over_a, over_b) if convex else min(over_a, over_b)


@rows
def _rule(first, last, points, normals, places, squares, near, value, certain):
    for i in range(first, last):
        a, b = near[i, 0], near[i, near.shape[1] - 1]  # the same where there is only one surfel
        over_a, over_b, side = beyond_two(points, normals, a, b, places[i, 0], places[i, 1], places[i, 2])
        value[i] = side
        certain[i] = over_a * over_b > 0.0
