"""Sheets that lie closer than their points, told by given normals: both sides of a plate, or layers of scans."""

from __future__ import annotations

import numpy as np

from surfel._numba import rows
from surfel.core.cast import Floats
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import SAMPLE, sample_rows
from surfel.surface.twist import off_arc

SHARE = 0.15
"""So much of the nearest neighbours lies on other sheets, where sheets are closer than their points."""

SHARE_FITTED = 0.06
"""The same for normals that were fitted: with more of them, points of one sheet were taken for those of the other."""

BACKS = 0.15
"""So many of the nearest neighbours turn their back, where most points belong to a plate."""

_NEAR = 12  # neighbours that are asked: those that tell the spacing
_NEAREST = 6


def has_close_sheets(hood: Neighbourhoods, normals: Floats, share: float = SHARE) -> bool:
    """Tell whether many of the neighbours that tell the spacing lie on another sheet.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the points.
    normals : Floats, shape (n, 3)
        In the order of ``hood``, of either sign; zero where unknown.
    share : float
        How many of them are many.
    """
    same, other, asked = _counted(hood, normals)
    return bool(same + other > share * asked)


def faces_one_way(hood: Neighbourhoods, normals: Floats) -> bool:
    """Tell whether sheets that lie closer than their points have normals of one sign, as layers of scans have.

    The two sides of a plate face away from each other. Where signs are not known they agree as often as not.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the points.
    normals : Floats, shape (n, 3)
        In the order of ``hood``, with the signs that were given.
    """
    same, other, _ = _counted(hood, normals)
    return bool(same > 0.9 * (same + other))


def is_thin_plate(hood: Neighbourhoods, normals: Floats) -> bool:
    """Tell whether nearest neighbours with opposite normals lie behind each other: two sides, however thin.

    Where signs are not known, as many of them lie in front of each other.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the points.
    normals : Floats, shape (n, 3)
        In the order of ``hood``, with the signs that were given.
    """
    chosen = sample_rows(hood.points, SAMPLE)
    near = hood.near[chosen, :_NEAREST]
    own, other = normals[chosen][:, None], normals[near]
    step = hood.points[near] - hood.points[chosen][:, None]
    opposite = (own * other).sum(axis=2) < -0.9
    ahead, back = (step * own).sum(axis=2), -(step * other).sum(axis=2)
    behind, before = (opposite & (ahead < 0.0) & (back < 0.0)).sum(), (opposite & (ahead > 0.0) & (back > 0.0)).sum()
    return bool(behind > BACKS * opposite.size and behind > 9 * before)


def _counted(hood: Neighbourhoods, normals: Floats) -> tuple[float, float, int]:
    """Return how many neighbours lie on other sheets and face the same way, or not; and how many were asked."""
    chosen = sample_rows(hood.points, SAMPLE)
    signs = np.zeros((len(chosen), 2))
    _count_signs(len(chosen), hood.points, normals, chosen, hood.near, signs)
    same, other = signs.sum(axis=0)
    return float(same), float(other), len(chosen) * min(_NEAR, hood.near.shape[1])


@rows
def _count_signs(first, last, points, normals, chosen, near, signs):
    """Count the neighbours on other sheets by whether they face the same way."""
    for row in range(first, last):
        i = chosen[row]
        for a in range(min(_NEAR, near.shape[1])):
            cosine, off, _, square = off_arc(points, normals, i, near[i, a])
            if abs(cosine) > 0.9 and off * off > 0.36 * square:
                signs[row, 0 if cosine > 0.0 else 1] += 1.0
