"""Points as records beside the cell that they lie in, eight at a time, and how they come into the buckets of cells.

The formulas are those of ``frame.project``, rounded alike: the numbers are the same to the last bit.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from surfel.bounding.vectors import (
    EIGHT,
    FOUR,
    I32,
    I64,
    Flat,
    Lanes,
    address,
    every,
    load,
    pick,
    pick_of_two,
    three,
)

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
        x, y, z = _columns(builder, flat, values[1])
        a, b = (cell * split + part(local, split) for cell, local in _places(frame, x, y, z))
        whole.put_whole(values[6], (a * (frame.one(CELLS_V) * split) + b).whole())
        out.put(values[6], _along(frame, AXIS_Z, x, y, z))
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
        x, y, z = _columns(builder, flat, values[1])
        (h, s), (k, t) = _places(frame, x, y, z)
        whole.put_whole(values[4], h.times_plus(frame.one(CELLS_V), k).whole())
        place = builder.mul(values[6], ir.Constant(I64, RECORD))
        for i, pair in enumerate(_pairs(builder, s, t, _along(frame, AXIS_Z, x, y, z))):
            out.put(builder.add(place, ir.Constant(I64, 8 * i)), Lanes(builder, pair))
        return context.get_dummy_value()

    i = types.int64
    return types.void(p, i, f, places, i, w, i), generate


@intrinsic
def insert_eight(typing, p, at, f, cells, first, bucket, room, filled):  # type: ignore[no-untyped-def]
    """Put the records of the eight points from ``p[at]`` on into the buckets of their cells.

    The cells go to ``cells[first]``. A bucket has room for eight points more than ``room``. The bits of the points
    with which one reached that number are returned.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, frame, whole, out, many = (Flat(context, builder, signature.args[i], values[i]) for i in (0, 2, 3, 5, 7))
        x, y, z = _columns(builder, flat, values[1])
        (h, s), (k, t) = _places(frame, x, y, z)
        whole.put_whole(values[4], h.times_plus(frame.one(CELLS_V), k).whole())
        pairs = _pairs(builder, s, t, _along(frame, AXIS_Z, x, y, z))
        room = builder.trunc(values[6], I32)
        stride, bits = builder.add(values[6], ir.Constant(I64, 8)), ir.Constant(I64, 0)
        for i in range(8):
            cell = builder.load(
                builder.gep(whole.data, [builder.add(values[4], ir.Constant(I64, i))]), align=4, typ=I32
            )
            cell = builder.sext(cell, I64)
            counter = builder.gep(many.data, [cell])
            count = builder.load(counter, align=4)
            place = builder.add(builder.mul(cell, stride), builder.sext(count, I64))
            record = pick(builder, pairs[i // 2], [4 * (i % 2) + j for j in range(4)])
            place = builder.mul(place, ir.Constant(I64, RECORD))
            builder.store(record, address(builder, out.data, place, FOUR), align=8)
            count = builder.add(count, ir.Constant(I32, 1))
            builder.store(count, counter, align=4)
            full = builder.zext(builder.icmp_signed("==", count, room), I64)
            bits = builder.or_(bits, builder.shl(full, ir.Constant(I64, i)))
        return bits

    i = types.int64
    return types.int64(p, i, f, cells, i, bucket, i, filled), generate


@intrinsic
def copy_record(typing, source, number, target, into):  # type: ignore[no-untyped-def]
    """Copy the record of a number to the place of another."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        left, right = (Flat(context, builder, signature.args[i], values[i]) for i in (0, 2))
        old, new = (builder.mul(values[i], ir.Constant(I64, RECORD)) for i in (1, 3))
        builder.store(load(builder, left.data, old, FOUR), address(builder, right.data, new, FOUR), align=8)
        return context.get_dummy_value()

    return types.void(source, types.int64, target, types.int64), generate


def records(run: Flat, number: Any) -> tuple[Lanes, Lanes, Lanes]:
    """Return the local coordinates and heights of eight records."""
    builder = run.builder
    place = builder.mul(number, ir.Constant(I64, RECORD))
    pairs = [load(builder, run.data, builder.add(place, ir.Constant(I64, 8 * i)), EIGHT) for i in range(4)]
    first, second = (pick_of_two(builder, pairs[i], pairs[i + 1], [0, 4, 8, 12, 1, 5, 9, 13]) for i in (0, 2))
    third, fourth = (pick_of_two(builder, pairs[i], pairs[i + 1], [2, 6, 10, 14, 2, 6, 10, 14]) for i in (0, 2))
    low, high = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
    columns = pick_of_two(builder, first, second, low), pick_of_two(builder, first, second, high)
    z = pick_of_two(builder, third, fourth, low)
    return Lanes(builder, columns[0]), Lanes(builder, columns[1]), Lanes(builder, z)


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


def _places(frame: Flat, x: Lanes, y: Lanes, z: Lanes) -> list[tuple[Lanes, Lanes]]:
    """Return the cell and the local coordinate along u, and along v."""
    found = []
    for axis, low, scale, cells in ((AXIS_U, LOW_U, SCALE_U, CELLS_U), (AXIS_V, LOW_V, SCALE_V, CELLS_V)):
        place = _place(frame, axis, low, scale, x, y, z)
        cell = place.floor().least(frame.one(cells) - 1.0)
        found.append((cell, place - cell))
    return found


def _place(frame: Flat, axis: int, low: int, scale: int, x: Lanes, y: Lanes, z: Lanes) -> Lanes:
    return (_along(frame, axis, x, y, z) - frame.one(low)) * frame.one(scale)


def _along(frame: Flat, axis: int, x: Lanes, y: Lanes, z: Lanes) -> Lanes:
    return frame.one(axis) * x + frame.one(axis + 1) * y + frame.one(axis + 2) * z


def _columns(builder: Any, flat: Flat, at: Any) -> list[Lanes]:
    """Return x, y and z of the eight points that begin at a place."""
    first, second, third = three(builder, flat.data, at)
    columns = []
    for axis in range(3):
        lanes = [i for i in range(axis, 24, 3) if i < 16]
        both = pick_of_two(builder, first, second, lanes + [0] * (8 - len(lanes)))
        rest = [8 + i - 16 for i in range(axis, 24, 3) if i >= 16]
        columns.append(Lanes(builder, pick_of_two(builder, both, third, [*range(8 - len(rest)), *rest])))
    return columns
