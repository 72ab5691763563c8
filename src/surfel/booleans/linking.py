"""Linking: points of a curve with their directions, put in order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats

NEIGHBOURS = 12

_REACH = 3.0  # spacings to the next point at most
_WIDE = 5.0  # and where a line would end otherwise
_AHEAD = 0.6  # least cosine between the direction and the way to the next point
_SHORTEST = 2  # lines of fewer points are no curve


def linked(points: Floats, along: Floats, spacing: float) -> list[tuple[NDArray[np.int64], bool]]:
    """Return rows in order for each line, and whether it is closed.

    A point is followed by the nearest one ahead of it, if it is the nearest behind that one.

    Parameters
    ----------
    points : Floats, shape (m, 3)
        On one or more curves.
    along : Floats, shape (m, 3)
        Unit directions, the same way round along a curve.
    spacing : float
        About how far apart the points lie at most.
    """
    m = len(points)
    if m < _SHORTEST:
        return []
    after, before = np.full(m, -1), np.full(m, -1)
    for reach, ahead in ((_REACH, _AHEAD), (_WIDE, 0.2), (_WIDE, -0.3)):
        _link(points, along, reach * spacing, ahead, after, before)
    return _lines(after, before)


def _link(
    points: Floats, along: Floats, reach: float, ahead: float, after: NDArray[np.int64], before: NDArray[np.int64]
) -> None:
    """Link open ends that choose each other."""
    from scipy.spatial import cKDTree

    starts, ends = np.flatnonzero(before < 0), np.flatnonzero(after < 0)
    if not len(starts) or not len(ends):
        return
    k = min(NEIGHBOURS, len(starts))
    far, near = (
        np.reshape(found, (len(ends), k))
        for found in cKDTree(points[starts]).query(points[ends], k, distance_upper_bound=reach)
    )
    rows, column = np.nonzero(np.isfinite(far))
    tail, head = ends[rows], starts[near[rows, column]]
    step = points[head] - points[tail]
    length = np.linalg.norm(step, axis=1)
    good = (tail != head) & (length > 0.0)
    tail, head, step, length = tail[good], head[good], step[good], length[good]
    front = np.einsum("ij,ij->i", step, along[tail]) / length
    back = np.einsum("ij,ij->i", step, along[head]) / length
    good = (front > ahead) & (back > ahead)
    tail, head, length, front, back = tail[good], head[good], length[good], front[good], back[good]
    cost = length * (3.0 - front - back)
    order = np.lexsort((head, tail, cost))
    best_after, best_before = _first_of(tail[order], order), _first_of(head[order], order)
    for pair in sorted(set(best_after.values()) & set(best_before.values())):
        after[tail[pair]], before[head[pair]] = head[pair], tail[pair]


def _first_of(keys: NDArray[np.int64], order: NDArray[np.int64]) -> dict[int, int]:
    """Return the first entry of each key."""
    every, first = np.unique(keys, return_index=True)
    return dict(zip(every.tolist(), order[first].tolist(), strict=True))


def _lines(after: NDArray[np.int64], before: NDArray[np.int64]) -> list[tuple[NDArray[np.int64], bool]]:
    """Follow the links: open lines from their starts, then closed ones."""
    seen = np.zeros(len(after), bool)
    found = []
    for closed in (False, True):
        for start in np.flatnonzero(~seen if closed else before < 0).tolist():
            if seen[start]:
                continue
            line, at = [], start
            while at >= 0 and not seen[at]:
                seen[at] = True
                line.append(at)
                at = int(after[at])
            if len(line) >= _SHORTEST:
                found.append((np.array(line), closed))
    return found
