"""The nearest surfel: a place is inside if it lies behind the plane of the surfel that is nearest to it."""

from __future__ import annotations

from numpy.typing import ArrayLike

from surfel._numba import inlined, rows
from surfel._vec import dot
from surfel.inside.holder import HasOperand, as_operand
from surfel.inside.judges.skipping import judge_by, look_with
from surfel.inside.judges.verdict import Verdict
from surfel.inside.operand import Operand

GRAZING = 0.3
"""Sine of the angle at a surfel, over its plane, below which the side of that plane is not certain."""


def judge(cloud: Operand | HasOperand, queries: ArrayLike, *, skip: bool = True) -> Verdict:
    """Judge places by the nearest surfel: inside where ``n . (x - p) < 0``.

    Right on smooth surfaces; wrong at sharp edges, where the nearest surfel may belong to the other face, and wherever
    its normal is flipped.

    Parameters
    ----------
    cloud : Operand or Surfels
        The cloud.
    queries : array_like, shape (q, 3)
        Places, in the coordinates of the cloud.
    skip : bool
        Settle places in one empty ball together, see :mod:`surfel.inside.judges.skipping`. The published test, each
        place for itself, is ``skip=False``.

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
    Gaal, *Boolean Operations on Point-Sampled Geometry*, sec. 3 (the test), by an index instead of brute force.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.judges import nearest
    >>> from surfel.inside.operand import Operand
    >>> square = np.stack(np.meshgrid(range(9), range(9), [0.0]), axis=-1).reshape(-1, 3)
    >>> found = nearest.judge(Operand.of(square, np.tile([0.0, 0, 1], (81, 1))), [[4.0, 4, -2], [4, 4, 1]])
    >>> found.inside.tolist(), found.value.tolist()
    ([True, False], [-2.0, 1.0])
    """
    operand = as_operand(cloud)
    return judge_by(look_with(_rule, 1), operand, queries, skip=skip)


@inlined
def over_plane(points, normals, row, x, y, z):
    """Return how far a place lies over the plane of a surfel."""
    dx, dy, dz = x - points[row, 0], y - points[row, 1], z - points[row, 2]
    return dot(normals[row, 0], normals[row, 1], normals[row, 2], dx, dy, dz)


@rows
def _rule(first, last, points, normals, places, squares, near, value, certain):
    for i in range(first, last):
        side = over_plane(points, normals, near[i, 0], places[i, 0], places[i, 1], places[i, 2])
        value[i] = side
        certain[i] = side * side > GRAZING * GRAZING * squares[i, 0]
