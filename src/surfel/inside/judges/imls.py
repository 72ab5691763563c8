"""Implicit moving least squares: the weighted mean of the distances over the planes of the nearest surfels."""

from __future__ import annotations

from numpy.typing import ArrayLike

from surfel._numba import inlined, rows
from surfel.inside.falloff import falloff
from surfel.inside.holder import HasOperand, as_operand
from surfel.inside.judges.nearest import over_plane
from surfel.inside.judges.skipping import judge_by, look_with
from surfel.inside.judges.verdict import Verdict
from surfel.inside.operand import Operand

WIDTH = 0.35
"""Square of the Gaussian's width over the squared distance to the farthest of the neighbours."""


def judge(cloud: Operand | HasOperand, queries: ArrayLike, *, k: int = 10, skip: bool = True) -> Verdict:
    """Judge places by an implicit function: ``f(x) = sum w_i n_i . (x - p_i) / sum w_i`` over the k nearest surfels.

    It smooths: better than single surfels where normals are noisy or some are flipped, worse at sharp edges.

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
        ``value`` is f; certain where at least three quarters of the weighted distances are on one side.

    Raises
    ------
    InputError
        If the queries are not finite rows of three or ``k`` is less than 1.

    Notes
    -----
    Shen, O'Brien and Shewchuk, *Interpolating and approximating implicit surfaces from polygon soup*, 2004, with
    Gaussian weights: ``w = exp(-d^2 / (0.35 d_k^2))``.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.judges import imls
    >>> from surfel.inside.operand import Operand
    >>> p = np.random.default_rng(0).standard_normal((900, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> imls.judge(Operand.of(p, p), [[0.0, 0, 0.9], [0, 0, 1.1]]).value.round(1).tolist()
    [-0.1, 0.1]
    """
    operand = as_operand(cloud)
    return judge_by(look_with(_rule, k), operand, queries, skip=skip)


@inlined
def weighted_side(points, normals, x, y, z, squares, near, i):
    """Return f at place i and the weighted mean of the absolute distances over the planes."""
    k = near.shape[1]
    inverse = 1.0 / (WIDTH * squares[i, k - 1]) if squares[i, k - 1] > 0.0 else 0.0
    total = side = size = 0.0
    for a in range(k):
        weight = falloff((squares[i, a] - squares[i, 0]) * inverse)
        over = over_plane(points, normals, near[i, a], x, y, z)
        total += weight
        side += weight * over
        size += weight * abs(over)
    return side / total, size / total


@rows
def _rule(first, last, points, normals, places, squares, near, value, certain):
    for i in range(first, last):
        side, size = weighted_side(points, normals, places[i, 0], places[i, 1], places[i, 2], squares, near, i)
        value[i] = side
        certain[i] = 2.0 * abs(side) > size
