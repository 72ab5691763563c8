"""Points beside the cell that they lie in, eight at a time.

The formulas are those of ``frame.project`` where a grid has not grown, rounded alike: the numbers are the same to the
last bit.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from surfel._numba import inner
from surfel.bounding.evaluate import cell_of
from surfel.bounding.frame import project
from surfel.bounding.vectors import (
    I64,
    Flat,
    Lanes,
    every,
    pick_of_two,
    three,
)

BLOCK = 120
"""Points whose records are made together: they stay in the first cache."""

RECORD = 4
LOCAL_U, LOCAL_V, HEIGHT = range(3)
"""Numbers of a point's record: where it lies in its cell, how high, and one of no use."""

AXIS_U, AXIS_V, AXIS_Z, LOW_U, LOW_V, SCALE_U, SCALE_V, CELLS_U, CELLS_V = 0, 3, 6, 9, 10, 11, 12, 13, 14
"""Places in the numbers of a frame."""


@intrinsic
def micro_cells_of_eight(typing, p, at, f, split, places, w, lane):  # type: ignore[no-untyped-def]
    """Write the micro-cells, in rows along v, of the eight points from ``p[at]`` on to ``places[lane]``.

    There are ``split`` along a side of each cell. Heights go to ``w[lane]``.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, frame, whole, out = (Flat(context, builder, signature.args[i], values[i]) for i in (0, 2, 4, 5))
        split = Lanes(builder, every(builder, values[3]))
        x, y, z = columns_of(builder, flat, values[1])
        a, b = (cell * split + part(local, split) for cell, local in places_of(frame, x, y, z))
        whole.put_whole(values[6], (a * (frame.one(CELLS_V) * split) + b).whole())
        out.put(values[6], heights_of(frame, x, y, z))
        return context.get_dummy_value()

    i = types.int64
    return types.void(p, i, f, types.float64, places, w, i), generate


@intrinsic
def records_of_eight(typing, p, at, f, places, first, w, lane):  # type: ignore[no-untyped-def]
    """Write the cells, in rows along v, of the eight points from ``p[at]`` on to ``places[first]``.

    Their records go to ``w``, from that of number ``lane`` on.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, frame, whole, out = (Flat(context, builder, signature.args[i], values[i]) for i in (0, 2, 3, 5))
        x, y, z = columns_of(builder, flat, values[1])
        (h, s), (k, t) = places_of(frame, x, y, z)
        whole.put_whole(values[4], h.times_plus(frame.one(CELLS_V), k).whole())
        place = builder.mul(values[6], ir.Constant(I64, RECORD))
        for i, pair in enumerate(_pairs(builder, s, t, heights_of(frame, x, y, z))):
            out.put(builder.add(place, ir.Constant(I64, 8 * i)), Lanes(builder, pair))
        return context.get_dummy_value()

    i = types.int64
    return types.void(p, i, f, places, i, w, i), generate


@inner
def fetch_records(p, first, count, f, cell, w):
    """Write the cells of some points and, to scratch, their records; ``p`` is flat."""
    whole = count - count % 8
    for i in range(0, whole, 8):
        records_of_eight(p, 3 * (first + i), f, cell, first + i, w, i)
    n, m = np.int64(f[13]), np.int64(f[14])
    for i in range(whole, count):
        at = 3 * (first + i)
        u, v, w[RECORD * i + HEIGHT] = project(f, p[at], p[at + 1], p[at + 2])
        h, k = cell_of(u, n), cell_of(v, m)
        w[RECORD * i + LOCAL_U], w[RECORD * i + LOCAL_V] = u - h, v - k
        cell[first + i] = np.int32(h * m + k)


def _pairs(builder: Any, s: Lanes, t: Lanes, z: Lanes) -> list[Any]:
    """Return eight records of four numbers each, the last of which is of no use, two by two."""
    pairs = []
    for i in range(0, 8, 2):
        both = pick_of_two(builder, s.value, t.value, [i, 8 + i, 0, 0, i + 1, 9 + i, 0, 0])
        pairs.append(pick_of_two(builder, both, z.value, [0, 1, 8 + i, 8 + i, 4, 5, 9 + i, 9 + i]))
    return pairs


def part(local: Lanes, split: Lanes) -> Lanes:
    """Return the micro-cell along one axis."""
    return (local * split).floor().least(split - 1.0)


def places_of(frame: Flat, x: Lanes, y: Lanes, z: Lanes) -> list[tuple[Lanes, Lanes]]:
    """Return the cell and the local coordinate along u, and along v."""
    found = []
    for axis, low, scale, cells in ((AXIS_U, LOW_U, SCALE_U, CELLS_U), (AXIS_V, LOW_V, SCALE_V, CELLS_V)):
        place = _place(frame, axis, low, scale, x, y, z)
        cell = place.floor().least(frame.one(cells) - 1.0).most(0.0)
        found.append((cell, place - cell))
    return found


def heights_of(frame: Flat, x: Lanes, y: Lanes, z: Lanes) -> Lanes:
    """Return the heights of eight points."""
    return _along(frame, AXIS_Z, x, y, z)


def _place(frame: Flat, axis: int, low: int, scale: int, x: Lanes, y: Lanes, z: Lanes) -> Lanes:
    return (_along(frame, axis, x, y, z) - frame.one(low)) * frame.one(scale)


def _along(frame: Flat, axis: int, x: Lanes, y: Lanes, z: Lanes) -> Lanes:
    return frame.one(axis) * x + frame.one(axis + 1) * y + frame.one(axis + 2) * z


def columns_of(builder: Any, flat: Flat, at: Any) -> list[Lanes]:
    """Return x, y and z of the eight points that begin at a place."""
    first, second, third = three(builder, flat.data, at)
    columns = []
    for axis in range(3):
        lanes = [i for i in range(axis, 24, 3) if i < 16]
        both = pick_of_two(builder, first, second, lanes + [0] * (8 - len(lanes)))
        rest = [8 + i - 16 for i in range(axis, 24, 3) if i >= 16]
        columns.append(Lanes(builder, pick_of_two(builder, both, third, [*range(8 - len(rest)), *rest])))
    return columns
