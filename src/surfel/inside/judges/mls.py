"""Projection: a place is inside if it lies behind its own image on the moving least squares surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from surfel.core.cast import Floats
from surfel.inside import mls as surface
from surfel.inside.holder import HasOperand, as_operand
from surfel.inside.judges.skipping import Opinion, judge_by
from surfel.inside.judges.verdict import Verdict
from surfel.inside.neighbourhood import neighbours_of
from surfel.inside.operand import Operand


def judge(
    cloud: Operand | HasOperand,
    queries: ArrayLike,
    *,
    degree: int = 0,
    h: float | None = None,
    k: int = 10,
    bias: float = 1.0,
    steps: int = 6,
    skip: bool = True,
) -> Verdict:
    """Judge places by their projection y onto the surface: inside where ``(x - y) . n_y < 0``.

    Parameters
    ----------
    cloud : Operand or Surfels
        The cloud.
    queries : array_like, shape (q, 3)
        Places, in the coordinates of the cloud.
    degree, h, k, bias, steps
        Of the surface and the iteration, see :func:`surfel.inside.mls.project`.
    skip : bool
        Pauly's distance skipping: places in one empty ball are settled together, see
        :mod:`surfel.inside.judges.skipping`.

    Returns
    -------
    Verdict
        ``value`` is the signed distance to the surface; certain where the nearest surfel says the same, and the
        iteration converged or the image is not seen from the side.

    Raises
    ------
    InputError
        If the queries are not finite rows of three or a parameter is out of its range.

    Notes
    -----
    Gaal, *Boolean Operations on Point-Sampled Geometry*, sec. 4.1, after Pauly. The survey projects what is farther
    than a spacing from the nearest surfel and trusts that surfel nearer by; it is the other way round that single
    surfels fail, so all places are projected here but those that skipping settles.
    Where the normals round the image cancel out, the nearest surfel judges.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.judges import mls
    >>> from surfel.inside.operand import Operand
    >>> p = np.random.default_rng(0).standard_normal((900, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> mls.judge(Operand.of(p, p), [[0.0, 0, 0.9], [0, 0, 1.1]], degree=2, k=20).value.round(1).tolist()
    [-0.1, 0.1]
    """
    operand = as_operand(cloud)
    if not len(operand):
        return Verdict.outside(len(operand.local(queries)))
    settings = surface.settings_for(operand, degree, h, k, bias, steps)

    def look(cloud: Operand, places: Floats) -> Opinion:
        squares, near = neighbours_of(cloud, places, 1)
        nearest, distance = near[:, 0], np.sqrt(squares[:, 0])
        start = cloud.points[nearest]
        plain = np.einsum("ij,ij->i", places - start, cloud.normals[nearest])
        on = surface.project_local(cloud, places, start, settings)
        value = np.einsum("ij,ij->i", places - on.points, on.normals)
        value = np.where(on.normals.any(axis=1), value, plain)
        facing = on.converged | (np.abs(value) > 0.5 * distance)
        return Opinion(value, facing & (value * plain > 0.0), nearest, distance)

    return judge_by(look, operand, queries, skip=skip)
