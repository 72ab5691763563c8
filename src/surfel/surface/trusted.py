"""Given normals, as far as the points bear them out.

Normals come from scanners, from meshes whose vertices average them, and from programs that fit planes to so many
neighbours and round off every edge. Where they are right they tell more than the points do: edges, thin plates, relief
between the points. One that is wrong costs the area of nearly three points, for no neighbour is taken to lie on its
surface.

Single wrong ones are found by their neighbours: these lie on one plane, their normals agree with it, and the point's
own does not. All of them together are tested by pairs of points closer than the spacing: on a surface the step from one
to the other is at right angles to both normals, the closer the more so, whatever its relief. Between wrong normals, or
smoothed ones on facets, it leans as far as between points far apart; and between normals that were rounded off at edges
it leans farther than between those that :func:`surfel.surface.normals.fitted_normals` finds in the points alone.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import SAMPLE, sample_rows
from surfel.surface.normals import fitted_normals

CLOSE, FARTHER, COMPARED = (0.0, 0.1), (0.1, 0.2), (0.1, 0.35)
"""Distances, in spacings, of pairs whose steps tell wrong normals from noise of the points, which slants the closest
ones most; and of those over which given normals are compared with fitted ones."""

SLANT = 0.012
"""Typical slant of the steps, in radians, from which normals are not believed (right ones of 2,000 points or more
showed less than .01 on the calibrating shapes)."""

DOUBT = 0.5
"""How far off the part of the noise may be, as a share of it."""

SLANT_REGULAR = 0.13
"""The same for points that lie in good order and have no close pairs: the slant that three in four of the steps to the
nearest neighbours exceed, some of which lead to other sheets or over edges."""

WORSE, WORSE_REGULAR, LITTLE = 1.4, 1.8, 5e-4
"""How many times the mean square lean of fitted normals, and how much besides, that of given ones may be: over pairs
closer than the spacing; and over the nearest neighbours of points in good order, which the fit has followed."""

MANY = 0.03
"""Share of single wrong normals from which none is believed: of so many not all are found."""

LEAST_PAIRS = 60
"""Fewer pairs tell nothing."""

_NEAR = 8  # neighbours that judge a single normal
_FEW = 4  # neighbours of points in good order that judge all
_TURNED = 0.26  # sine from which a normal is wrong, 15 degrees
_LEVEL, _LIKE = 0.2, 0.9  # how far a neighbour lies off a plane, in its distance, and the cosine of normals that agree
_CONCUR, _OPPOSE, _SHARE_PLANE, _KEEP_PLANE = 5, 1, 6, 4  # of the eight neighbours


class Trusted(NamedTuple):
    """What is left of the given normals.

    ``normals``: shape (m, 3) in the order of the original cloud, the wrong ones replaced; None where none is believed.
    ``refused``: whether none is believed of those that were given; then ``fitted``, shape (n, 3) in the order of the
    neighbourhoods, are those that the points show. ``wrong``: how many single ones are. ``slant``:
    median slant of the steps between close points, in radians.
    """

    normals: Floats | None
    refused: bool = False
    wrong: int = 0
    slant: float = 0.0
    fitted: Floats | None = None


def trusted_normals(hood: Neighbourhoods, given: Floats) -> Trusted:
    """Tell how far given normals are borne out by the points.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the cleaned points, more than eight of them; of fewer all normals are believed.
    given : Floats, shape (m, 3)
        Unit normals of either sign, zero where unknown, in the order of the original cloud.

    Returns
    -------
    Trusted
        Replaced normals have the sign of most of their neighbours.
    """
    if hood.near.shape[1] < _NEAR:
        return Trusted(given)
    normals = np.ascontiguousarray(given[hood.rows])
    fitted = fitted_normals(hood)
    side = np.zeros(len(normals))
    with threads_for(4 * len(normals)):
        _judge(len(normals), hood.points, normals, hood.near, fitted, side)
    wrong = side != 0.0
    count = int(wrong.sum())
    slant, believed = _slant(hood, normals, fitted, wrong)
    if count > MANY * len(normals) or not believed:
        return Trusted(None, True, count, slant, fitted)
    if not count:
        return Trusted(given, slant=slant)
    mended = given.copy()
    mended[hood.rows[wrong]] = fitted[wrong] * side[wrong, None]
    return Trusted(mended, wrong=count, slant=slant)


def _slant(hood: Neighbourhoods, normals: Floats, fitted: Floats, wrong: NDArray[np.bool_]) -> tuple[float, bool]:
    """Return the typical slant of steps that wrong normals leave, and whether the normals are believed."""
    rows = np.flatnonzero(hood.squared[:, 0] <= np.square(COMPARED[1] * hood.spacing))
    rows, near = _known(normals, wrong, rows, hood.near[rows, 0])
    apart = np.sqrt(hood.squared[rows, 0]) / hood.spacing[rows]
    close, farther, compared = ((apart > low) & (apart <= high) for low, high in (CLOSE, FARTHER, COMPARED))
    if min(close.sum(), farther.sum()) < LEAST_PAIRS:
        some = sample_rows(hood.points, SAMPLE)
        rows, near = _known(normals, wrong, np.repeat(some, _FEW), hood.near[some, :_FEW].ravel())
        slant = float(np.quantile(_sines(hood, normals, rows, near), 0.25)) if len(rows) else 0.0
        leans = _lean(hood, normals, rows, near) > WORSE_REGULAR * _lean(hood, fitted, rows, near) + LITTLE
        return slant, not leans and slant < SLANT_REGULAR
    near_slant, far_slant = (float(np.median(_sines(hood, normals, rows[at], near[at]))) for at in (close, farther))
    shrinks = (float(np.median(apart[farther])) / float(np.median(apart[close]))) ** 2
    noise = max(0.0, near_slant**2 - far_slant**2) / (shrinks - 1.0)  # squares, at the farther pairs
    left = min(near_slant**2, max(0.0, far_slant**2 - noise))
    rows, near = rows[compared], near[compared]
    leans = _lean(hood, normals, rows, near) > WORSE * _lean(hood, fitted, rows, near) + LITTLE
    return math.sqrt(left), not leans and left < SLANT**2 + DOUBT * noise


def _known(normals: Floats, wrong: NDArray[np.bool_], first: NDArray[Any], second: NDArray[Any]) -> tuple[Any, Any]:
    """Return the pairs of points of which both have normals, none of them wrong by itself."""
    known = normals[first].any(axis=1) & normals[second].any(axis=1) & ~wrong[first] & ~wrong[second]
    return first[known], second[known]


def _lean(hood: Neighbourhoods, normals: Floats, first: NDArray[Any], second: NDArray[Any]) -> float:
    """Return the mean square of how far steps lean out of planes; one over an edge counts no more than 30 degrees."""
    sines = _sines(hood, normals, first, second)
    return float(np.minimum(np.square(sines), 0.25).mean()) if len(sines) else 0.0


def _sines(hood: Neighbourhoods, normals: Floats, first: NDArray[Any], second: NDArray[Any]) -> Floats:
    """Return how far the steps between points lean out of the planes of both ends, one after the other."""
    step = hood.points[second] - hood.points[first]
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    sines = [np.einsum("ij,ij->i", step, normals[ends]) for ends in (first, second)]
    return np.asarray(np.abs(np.concatenate(sines)))


@rows
def _judge(first, last, points, normals, near, fitted, side):
    """Mark the normals that their neighbours deny by the sign with which the fitted ones face as most of these do."""
    for i in range(first, last):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        ux, uy, uz = fitted[i, 0], fitted[i, 1], fitted[i, 2]
        if abs(ux * nx + uy * ny + uz * nz) > math.sqrt(1.0 - _TURNED * _TURNED):
            continue
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            continue
        on_given = on_fitted = like_given = like_fitted = upward = 0
        for a in range(_NEAR):
            j = near[i, a]
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            within = _LEVEL * _LEVEL * (dx * dx + dy * dy + dz * dz)
            off, off_fitted = dx * nx + dy * ny + dz * nz, dx * ux + dy * uy + dz * uz
            on_given += 1 if off * off < within else 0
            on_fitted += 1 if off_fitted * off_fitted < within else 0
            mx, my, mz = normals[j, 0], normals[j, 1], normals[j, 2]
            cosine, cosine_fitted = mx * nx + my * ny + mz * nz, mx * ux + my * uy + mz * uz
            like_given += 1 if abs(cosine) > _LIKE else 0
            like_fitted += 1 if abs(cosine_fitted) > _LIKE else 0
            upward += 1 if cosine_fitted > 0.0 else -1
        if like_given > _OPPOSE or on_given > _KEEP_PLANE or like_fitted < _CONCUR or on_fitted < _SHARE_PLANE:
            continue
        side[i] = 1.0 if upward >= 0 else -1.0
