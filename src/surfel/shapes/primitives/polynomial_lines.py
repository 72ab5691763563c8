"""Where lines cross a polynomial surface, or its solid, inside of another shape."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, rows, threads_for
from surfel.core.cast import Floats, Integers
from surfel.shapes.primitives.polynomial_block import new_block, new_scratch
from surfel.shapes.primitives.polynomial_form import WHOLE, Form
from surfel.shapes.primitives.polynomial_polish import polish
from surfel.shapes.primitives.polynomial_roots import find_roots

_CHUNK = 1 << 20  # events for which there is room at a time
_WORK = 25  # a chord is as much work as this many items of a simple loop
_EPS = 2.220446049250313e-16


class Chords(NamedTuple):
    """The parts of lines inside of a shape, in the order of the lines.

    Parameters
    ----------
    origins, directions : Floats, shape (k, 3)
        The line of each chord.
    t, cosine : Floats, shape (k, 2)
        Where it enters and leaves the shape.
    """

    origins: Floats
    directions: Floats
    t: Floats
    cosine: Floats


def cross_chords(form: Form, chords: Chords, inverse: Floats, capped: bool) -> tuple[Integers, Floats, Floats]:
    """Cross the surface of a polynomial, or its solid, with chords.

    Parameters
    ----------
    form : Form
        The polynomial in its own frame.
    chords : Chords
        In world coordinates.
    inverse : Floats, shape (3, 4)
        From the world to the frame of the polynomial.
    capped : bool
        Whether to return the events of the solid (where the polynomial is negative) instead of its surface's.

    Returns
    -------
    counts : Integers, shape (k,)
        How many events each chord has.
    t, cosine : Floats, shape (sum(counts),)
        In order.
    """
    map_to = np.array(inverse, order="C")
    map_to[:, 3] -= form.frame[:3]
    map_to /= form.frame[3]
    total = int(form.degrees[3])
    room = total if total <= WHOLE else total + 16  # in pieces, rounding may feign some more roots than the degree
    size = max(1, _CHUNK // (room + 2))
    found = [
        _cross_part(form, Chords(*(array[start : start + size] for array in chords)), map_to, capped, room)
        for start in range(0, max(len(chords.t), 1), size)
    ]
    counts, t, cosine = (np.concatenate(part) for part in zip(*found, strict=True))
    return counts, t, cosine


def _cross_part(
    form: Form, chords: Chords, map_to: Floats, capped: bool, room: int
) -> tuple[NDArray[np.int64], Floats, Floats]:
    items = len(chords.t)
    counts = np.empty(items, np.int64)
    slots_t, slots_cosine = np.empty((items, room + 2)), np.empty((items, room + 2))
    with threads_for(items * _WORK):
        _cross_each(items, form, chords, map_to, capped, slots_t, slots_cosine, counts)
        offsets = np.zeros(items + 1, np.int64)
        np.cumsum(counts, out=offsets[1:])
        t, cosine = np.empty(int(offsets[-1])), np.empty(int(offsets[-1]))
        _gather(items, slots_t, slots_cosine, offsets, t, cosine)
    return counts, t, cosine


@rows
def _gather(first, last, slots_t, slots_cosine, offsets, t, cosine):
    for q in range(first, last):
        start = offsets[q]
        for k in range(offsets[q + 1] - start):
            t[start + k] = slots_t[q, k]
            cosine[start + k] = slots_cosine[q, k]


@rows
def _cross_each(first, last, form, chords, map_to, capped, slots_t, slots_cosine, counts):
    """Find the roots on a few chords at a time, polish them together, and write each chord's events."""
    block = new_block(form, slots_t.shape[1] - 2)
    scratch = new_scratch(form, len(block.ends))
    for start in range(first, last, len(block.ends)):
        count = min(len(block.ends), last - start)
        for b in range(count):
            _local_chord(chords, start + b, map_to, block, b)
        find_roots(form, count, block, scratch)
        polish(form, count, map_to, block, scratch)
        for b in range(count):
            q = start + b
            counts[q] = _write_events(chords, q, capped, block, b, slots_t[q], slots_cosine[q])


@inner
def _local_chord(chords, q, map_to, block, b):
    """Map a chord to the frame of the form.

    An origin that is far off is first moved along the line to the point nearest to the centre. The rounding of a
    coordinate grows with the distance.
    """
    o, d = chords.origins[q], chords.directions[q]
    ox = map_to[0, 0] * o[0] + map_to[0, 1] * o[1] + map_to[0, 2] * o[2] + map_to[0, 3]
    oy = map_to[1, 0] * o[0] + map_to[1, 1] * o[1] + map_to[1, 2] * o[2] + map_to[1, 3]
    oz = map_to[2, 0] * o[0] + map_to[2, 1] * o[1] + map_to[2, 2] * o[2] + map_to[2, 3]
    dx = map_to[0, 0] * d[0] + map_to[0, 1] * d[1] + map_to[0, 2] * d[2]
    dy = map_to[1, 0] * d[0] + map_to[1, 1] * d[1] + map_to[1, 2] * d[2]
    dz = map_to[2, 0] * d[0] + map_to[2, 1] * d[1] + map_to[2, 2] * d[2]
    square = dx * dx + dy * dy + dz * dz
    nearest = -(ox * dx + oy * dy + oz * dz) / square
    before, length = chords.t[q, 0] - nearest, chords.t[q, 1] - chords.t[q, 0]
    block.ends[b, 0] = (ox + nearest * dx) + before * dx
    block.ends[b, 1] = (oy + nearest * dy) + before * dy
    block.ends[b, 2] = (oz + nearest * dz) + before * dz
    block.along[b, 0], block.along[b, 1], block.along[b, 2] = length * dx, length * dy, length * dz
    block.lengths[b] = length
    block.tolerances[b] = _EPS * (1.0 + abs(nearest) * math.sqrt(square))


@inlined
def _write_events(chords, q, capped, block, b, slot_t, slot_cosine):
    """Write the events of a chord, those of the shape around it included where it caps the solid."""
    enter, leave = chords.t[q, 0], chords.t[q, 1]
    count = 0
    inside = block.negative[b, 0]
    if capped and inside:
        slot_t[0], slot_cosine[0] = enter, chords.cosine[q, 0]
        count = 1
    t = enter
    for k in range(block.number[b]):
        t = min(max(enter + block.roots[b, k] * (leave - enter), t), leave)
        slot_t[count], slot_cosine[count] = t, block.cosines[b, k]
        count += 1
        inside = not inside
    if capped and inside:
        slot_t[count], slot_cosine[count] = leave, chords.cosine[q, 1]
        count += 1
    return count
