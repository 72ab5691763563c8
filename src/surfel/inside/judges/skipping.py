"""Judging by neighbours, with distance skipping: places in one empty ball get one answer.

If the nearest surfel s of a place r lies at the distance d, then all places within ``d - v_s`` of r are on the same
side, where v_s is the spacing at s (Pauly; Gaal, *Boolean Operations on Point-Sampled Geometry*, sec. 4.1). Here whole
runs of places are settled at once: places are sorted along a Hilbert curve and cut into runs of 16, 256, 4096 and so
on; from the longest runs on the middle of a run is judged first, and only runs that are not within its ball are looked
into. An uncertain answer, as of surfels seen from the side, is not handed on to large runs.

A run has to be looked into only if it is no farther from the cloud than it is large, so there are few places from which
very many surfels lie equally near: the time is linear, times a logarithm, wherever the places lie. Without it, places
in the middle of a sphere would each look at every surfel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import rows, threads_for
from surfel.core.cast import Booleans, Floats, as_count
from surfel.core.execute import blocks
from surfel.index.hilbert import hilbert_order
from surfel.inside.judges.verdict import Verdict
from surfel.inside.neighbourhood import neighbours_of
from surfel.inside.operand import Operand

RUN = 16
"""Places of the smallest runs, and how many runs make one of the next size."""

SMALL = 1.0 / 16.0
"""A run smaller than this share of its ball's radius takes an uncertain answer, too: it would hear the same itself."""

FAR = 1e6
"""Places beyond so many extents of the cloud are judged as the place that far away in the same direction."""

_SLICE = 1 << 15  # places whose neighbours are held at a time


class Opinion(NamedTuple):
    """What is found at m places: value (m,), certain (m,), and the nearest surfel with its distance (m,)."""

    value: Floats
    certain: Booleans
    nearest: NDArray[np.int32]
    distance: Floats


Look = Callable[[Operand, Floats], Opinion]
"""Judges places, minus the operand's origin and in an order in which neighbours follow each other."""


def look_with(rule: Callable[..., None], k: int) -> Look:
    """Return what judges places by a kernel over their k nearest surfels.

    ``rule(count, points, normals, places, squares, neighbours, value, certain)`` writes ``value`` and ``certain``.
    """
    wanted = as_count(k, "k")

    def look(operand: Operand, places: Floats) -> Opinion:
        count = len(places)
        found = Opinion(np.empty(count), np.empty(count, bool), np.empty(count, np.int32), np.empty(count))
        for start, stop in blocks(count, _SLICE):
            there = places[start:stop]
            squares, near = neighbours_of(operand, there, min(wanted, len(operand)))
            value, certain = found.value[start:stop], found.certain[start:stop]
            with threads_for(8 * (stop - start)):
                rule(stop - start, operand.points, operand.normals, there, squares, near, value, certain)
            found.nearest[start:stop] = near[:, 0]
            found.distance[start:stop] = np.sqrt(squares[:, 0])
        return found

    return look


def judge_by(look: Look, operand: Operand, queries: ArrayLike, *, skip: bool) -> Verdict:
    """Judge places by what ``look`` finds, each for itself or with distance skipping.

    Parameters
    ----------
    look : Look
        Judges places one by one.
    operand : Operand
        The cloud.
    queries : array_like, shape (q, 3)
        Places, in the coordinates of the cloud.
    skip : bool
        Settle places in one empty ball together.
    """
    given = operand.local(queries)
    if not len(operand) or not len(given):
        return Verdict.outside(len(given))
    order = hilbert_order(given)
    places = _pulled_in(np.take(given, order, axis=0), operand.bounds)
    value, certain = np.empty(len(places)), np.empty(len(places), bool)
    if skip and len(places) > RUN:
        left = _settle_runs(look, operand, places, value, certain)
        if len(left) == len(places):
            value, certain = look(operand, places)[:2]
        else:
            found = look(operand, np.take(places, left, axis=0))
            value[left], certain[left] = found.value, found.certain
    else:
        value, certain = look(operand, places)[:2]
    back_value, back_certain = np.empty_like(value), np.empty_like(certain)
    back_value[order], back_certain[order] = value, certain
    return Verdict.of(back_value, back_certain)


def _pulled_in(places: Floats, bounds: Floats) -> Floats:
    """Return the places, those beyond :data:`FAR` extents of the cloud moved straight towards it up to there.

    From farther away rounding makes all surfels equally near, and any of them would be the nearest.
    """
    middle = 0.5 * bounds[0] + 0.5 * bounds[1]
    limit = FAR * float(np.abs(0.5 * bounds[1] - 0.5 * bounds[0]).max())
    if limit == 0.0 or (places.max() <= float(middle.min()) + limit and places.min() >= float(middle.max()) - limit):
        return places  # nearly always: one look at all numbers
    offset = places - middle
    distance = np.maximum(np.maximum(np.abs(offset[:, 0]), np.abs(offset[:, 1])), np.abs(offset[:, 2]))
    beyond = distance > limit
    near = places.copy()
    near[beyond] = middle + offset[beyond] * (limit / distance[beyond, None])
    return near


def _settle_runs(look: Look, operand: Operand, places: Floats, value: Floats, certain: Booleans) -> NDArray[np.int64]:
    """Write the answers for runs within empty balls; return the rows that are left."""
    boxes = _boxes(places)
    active = np.arange(len(boxes[0]))
    for level, box in enumerate(boxes):
        size = RUN ** (len(boxes) - level)
        middle = 0.5 * box[active, 0] + 0.5 * box[active, 1]
        radius = np.linalg.norm(box[active, 1] - middle, axis=1)
        squares, near = neighbours_of(operand, middle, 1)
        free = np.sqrt(squares[:, 0]) - operand.spacings[near[:, 0]]
        settled = radius < free
        found = look(operand, middle.compress(settled, axis=0))
        sure = found.certain | (radius[settled] < SMALL * free[settled])
        settled[settled] = sure
        one = Opinion(*(part[sure] for part in found))
        with threads_for(size * len(one.value)):
            _hand_on(len(one.value), active[settled], size, middle[settled], *one, places, value, certain)
        active = (active[~settled, None] * RUN + np.arange(RUN)).ravel()
        active = active[active < (len(places) if level == len(boxes) - 1 else len(boxes[level + 1]))]
    return active


def _boxes(places: Floats) -> list[Floats]:
    """Return the boxes (r, 2, 3) of the runs of each size, largest first."""
    boxes = [np.empty((-(-len(places) // RUN), 2, 3))]
    with threads_for(len(places)):
        _box_runs(len(boxes[0]), places, boxes[0])
    while len(boxes[0]) > 1:
        starts = np.arange(0, len(boxes[0]), RUN)
        low, high = (step.reduceat(boxes[0][:, side], starts) for side, step in enumerate((np.minimum, np.maximum)))
        boxes.insert(0, np.stack([low, high], axis=1))
    return boxes


@rows
def _box_runs(first, last, places, boxes):
    for run in range(first, last):
        for x in range(3):
            low = high = places[run * RUN, x]
            for i in range(run * RUN + 1, min(len(places), (run + 1) * RUN)):
                low, high = min(low, places[i, x]), max(high, places[i, x])
            boxes[run, 0, x], boxes[run, 1, x] = low, high


@rows
def _hand_on(first, last, runs, size, middle, found, sure, nearest, distance, places, value, certain):
    """Give the places of settled runs the side of the middle, and how far they are from the cloud at least."""
    for r in range(first, last):
        for i in range(runs[r] * size, min(len(places), (runs[r] + 1) * size)):
            x, y, z = places[i, 0] - middle[r, 0], places[i, 1] - middle[r, 1], places[i, 2] - middle[r, 2]
            least = distance[r] - np.sqrt(x * x + y * y + z * z)
            value[i] = -least if found[r] < 0.0 else least
            certain[i] = sure[r]
