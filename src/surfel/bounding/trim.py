"""Trimming: the part of the plane that a safe spline answers for (Myles and Peters, sec. 6, Fig. 7).

A grid point is free if none of the cells round it has data. Kept is, of each cell, the hull of its points that are not
free: the whole cell, a triangle of three of its corners, or nothing. So every cell with data is kept, and a staircase
along the border becomes a diagonal. Where a cell juts out and its corner has no data, the corner is cut along the
diagonal. Only the outer boundary is trimmed: empty cells that it encloses are kept, because the energy has filled them.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from surfel.bounding.occupancy import HIGH, LEFT, LOW, RIGHT, Quarters, outside, trim_into
from surfel.core.cast import Floats

_TRIANGLES = {
    LEFT: ((0, 0), (1, 1), (0, 2)),
    LOW: ((0, 0), (2, 0), (1, 1)),
    RIGHT: ((2, 0), (2, 2), (1, 1)),
    HIGH: ((2, 2), (0, 2), (1, 1)),
}
"""The corners of each quarter in half cells, counterclockwise."""


def trimmed(occupancy: Quarters) -> Quarters:
    """Return the quarters that the trimmed surface keeps: never fewer than have data.

    Parameters
    ----------
    occupancy : Quarters, shape (n - 1, m - 1)
        Which quarters have data.

    Returns
    -------
    Quarters, shape (n - 1, m - 1)
        Which quarters are kept.

    Examples
    --------
    >>> import numpy as np
    >>> trimmed(np.array([[15, 0], [15, 15]], np.uint8))
    array([[15,  6],
           [15, 15]], dtype=uint8)
    """
    kept = np.empty(occupancy.shape, np.uint8)
    trim_into(np.array(occupancy), outside(occupancy), kept)
    return kept


def kept_share(trim: Quarters) -> Floats:
    """Return which share of each cell is kept: 0 to 1 in quarters."""
    return np.asarray(np.unpackbits(trim[..., None], axis=-1).sum(axis=-1) / 4.0)


def outlines(trim: Quarters) -> list[Floats]:
    """Return the closed polygons that bound what is kept, which lies to their left.

    Parameters
    ----------
    trim : Quarters, shape (n - 1, m - 1)
        Which quarters are kept.

    Returns
    -------
    list of Floats, shape (k, 2)
        Corners in units of cells, the first not repeated: outer borders counterclockwise, holes clockwise. Polygons
        may touch at corners.

    Examples
    --------
    >>> import numpy as np
    >>> [polygon.tolist() for polygon in outlines(np.array([[15, 5]], np.uint8))]
    [[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 2.0]]]
    """
    ahead = _border(trim)
    found = []
    while ahead:
        start = min(ahead)
        path = [start, _taken(ahead, start, min(ahead[start]))]
        while path[-1] != start:
            here = path[-1]
            path.append(_taken(ahead, here, _sharpest_left(path[-2], here, ahead[here])))
        found.append(0.5 * np.array(_without_straight(path[:-1]), np.float64))
    return found


_Corner = tuple[int, int]


def _border(trim: Quarters) -> dict[_Corner, list[_Corner]]:
    """Return the directed edges that one quarter has and no other has the opposite of, by their start."""
    edges: set[tuple[_Corner, _Corner]] = set()
    for h, k in np.argwhere(trim).tolist():
        for quarter, triangle in _TRIANGLES.items():
            if not trim[h, k] & quarter:
                continue
            corners = [(2 * h + i, 2 * k + j) for i, j in triangle]
            for edge in pairwise([*corners, corners[0]]):
                if edge[::-1] in edges:
                    edges.remove(edge[::-1])
                else:
                    edges.add(edge)
    ahead: dict[_Corner, list[_Corner]] = {}
    for start, end in edges:
        ahead.setdefault(start, []).append(end)
    return ahead


def _taken(ahead: dict[_Corner, list[_Corner]], here: _Corner, following: _Corner) -> _Corner:
    """Use up one edge."""
    ahead[here].remove(following)
    if not ahead[here]:
        del ahead[here]
    return following


def _sharpest_left(before: _Corner, here: _Corner, choices: list[_Corner]) -> _Corner:
    """Return where the sharpest turn to the left leads: so a polygon does not pass through itself at a corner."""
    back = np.arctan2(before[1] - here[1], before[0] - here[0])

    def from_back(choice: _Corner) -> float:
        angle = np.arctan2(choice[1] - here[1], choice[0] - here[0])
        return float((back - angle) % (2.0 * np.pi))

    return min(choices, key=from_back)


def _without_straight(corners: list[_Corner]) -> list[_Corner]:
    """Drop the corners at which the border goes straight on."""
    kept = []
    for before, here, after in zip([corners[-1], *corners[:-1]], corners, [*corners[1:], corners[0]], strict=True):
        turn = (here[0] - before[0]) * (after[1] - here[1]) - (here[1] - before[1]) * (after[0] - here[0])
        if turn:
            kept.append(here)
    return kept
