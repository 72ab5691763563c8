"""Eight points beside a spline: values, residuals and what the cells and micro-cells keep of them, in one go.

Nothing is sorted and nothing gathered: the formulas of eight points run side by side, and each point meets the 16
coefficients of its cell as four rows of four. The formulas are those of ``frame.project`` and ``evaluate.value_in``,
rounded alike: the numbers are the same to the last bit.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from surfel.bounding.records import columns_of, heights_of, part, places_of
from surfel.bounding.vectors import (
    EIGHT,
    EIGHT_PLACES,
    EIGHT_WHOLE,
    FOUR,
    I32,
    I64,
    TWO,
    Flat,
    Lanes,
    address,
    every,
    fused,
    load,
    pick,
    pick_of_two,
    whole_eight,
)

BLOCK = 32
"""Points that are worked on together, step by step: then the processor has always some that do not wait."""

SUMS_OF = 8
SUM_Z, SUM_R = 0, SUMS_OF
WEIGHTS_U, WEIGHTS_V, LANES, COLUMNS, RECORDS, HEIGHTS = (16 + times * BLOCK for times in (0, 4, 8, 12, 16, 18))
SCRATCH = HEIGHTS + BLOCK
"""Places in the scratch: sums of heights and residuals, which go on, eight each. The rest is new each time: six times
the weights along u and along v, point by point; those along v once more, for eight points side by side; heights;
columns, the sums of the coefficients along u; and what each point would be as a record."""

CELL, MICRO, CORNER, SHARE, BITS = (row * BLOCK for row in range(5))
PLACES = 5 * BLOCK
"""Places in the scratch of whole numbers, all of them new each time."""

SPLIT, ACROSS, WIDE, WIDTH, STEP, APART = range(6)
"""Numbers of the grid: micro-cells along a side of a cell; cells and micro-cells along v; coefficients along v, these
rounded up to a multiple of four, and how many of them there are in a grid of sums."""

LARGEST, WHO, TALLY = 0, 2, 3
RECORD = 2
"""A micro-cell's record, of two numbers of 64 bits: its largest residual; then, in 32 bits each, which point has that,
and a tally: how many points there are, and above them four bits for the quarters of the cell that they lie in."""

COUNTED = 28
"""Bits of the tally that count."""


@intrinsic
def place_eight(typing, p, at, f, grid, lane, w, places):  # type: ignore[no-untyped-def]
    """Write where the eight points from ``p[at]`` on lie, their weights and heights, as those from ``lane`` on."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        p, frame, grid, w, places = (Flat(context, builder, signature.args[i], values[i]) for i in (0, 2, 3, 5, 6))
        lane = values[4]
        x, y, z = columns_of(builder, p, values[1])
        (h, s), (k, t) = places_of(frame, x, y, z)
        along_u, along_v = _weights(s), _weights(t)
        _put_places(builder, places, grid, lane, (h, s), (k, t))
        for row, weights in ((WEIGHTS_U, along_u), (WEIGHTS_V, along_v)):
            for i, pair in enumerate(_by_points(builder, weights)):
                w.put(_after(builder, lane, 4, row + 8 * i), Lanes(builder, pair))
        for j in range(4):
            w.put(_after(builder, lane, 4, LANES + 8 * j), along_v[j])
        w.put(_after(builder, lane, 1, HEIGHTS), heights_of(frame, x, y, z))
        return context.get_dummy_value()

    i = types.int64
    return types.void(p, i, f, grid, i, w, places), generate


@intrinsic
def weigh_point(typing, i, b, width, sums, step, w, places):  # type: ignore[no-untyped-def]
    """Write the columns of the point in a lane, and add the products of its weights to ``sums``.

    ``b`` has the coefficients in rows of ``width``, from end to end.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        b, sums, w, places = (Flat(context, builder, signature.args[i], values[i]) for i in (1, 3, 5, 6))
        lane, _, width, _, step, _, _ = values
        corner, share = (_whole(builder, places, row, lane) for row in (CORNER, SHARE))
        column = None
        factors, own = (load(builder, w.data, _after(builder, lane, 4, row), FOUR) for row in (WEIGHTS_U, WEIGHTS_V))
        for j in range(4):
            factor = pick(builder, factors, [j] * 4)
            row = load(builder, b.data, corner, FOUR)
            column = builder.fmul(factor, row) if column is None else fused(builder, factor, row, column)
            place = address(builder, sums.data, share, FOUR)
            builder.store(fused(builder, factor, own, builder.load(place, align=8)), place, align=8)
            corner, share = builder.add(corner, width), builder.add(share, step)
        place = address(builder, w.data, _after(builder, lane, 4, COLUMNS), FOUR)
        builder.store(column, place, align=8)
        return context.get_dummy_value()

    whole = types.int64
    return types.void(whole, b, whole, sums, whole, w, places), generate


@intrinsic
def settle_eight(typing, lane, seen, first, w, places):  # type: ignore[no-untyped-def]
    """Write the records of eight points, of which the first has a number; the first ``seen`` are not added to sums."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        w, places = (Flat(context, builder, signature.args[i], values[i]) for i in (3, 4))
        lane, seen, first, _, _ = values
        along_v = [w.eight(_after(builder, lane, 4, LANES + 8 * j)) for j in range(4)]
        fours = [load(builder, w.data, _after(builder, lane, 4, COLUMNS + 4 * i), FOUR) for i in range(8)]
        height = w.eight(_after(builder, lane, 1, HEIGHTS))
        residual = height - _across(builder, fours, along_v) * (1.0 / 36.0)
        new = builder.icmp_signed(">=", whole_eight(list(range(8))), every(builder, seen))
        for row, number in ((SUM_Z, height), (SUM_R, residual)):
            w.put(row, w.eight(row) + number.where(new, 0.0))
        _put_records(builder, w, places, lane, residual, builder.trunc(first, I32))
        return context.get_dummy_value()

    i = types.int64
    return types.void(i, i, i, w, places), generate


@intrinsic
def take_point(typing, i, records, least, w, places):  # type: ignore[no-untyped-def]
    """Take the point of a lane into the record of its micro-cell, and its residual into the least of its cell.

    By masks: which residual is larger cannot be foretold.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        records, least, w, places = (Flat(context, builder, signature.args[i], values[i]) for i in (1, 2, 3, 4))
        micro, at = _whole(builder, places, MICRO, values[0]), _after(builder, values[0], 2, RECORDS)
        place = address(builder, records.data, builder.mul(micro, ir.Constant(I64, RECORD)), TWO)
        old, new = builder.load(place, align=8), load(builder, w.data, at, TWO)
        larger = builder.sext(builder.fcmp_ordered(">", new, old), _TWO_WHOLE)
        first = ir.Constant(ir.VectorType(I32, 2), [0] * 2)
        larger = builder.bitcast(builder.shuffle_vector(larger, larger, first), _FOUR_WHOLE)
        old, new = (builder.bitcast(number, _FOUR_WHOLE) for number in (old, new))
        larger = builder.and_(larger, ir.Constant(_FOUR_WHOLE, [-1, -1, -1, 0]))
        bits = builder.and_(new, ir.Constant(_FOUR_WHOLE, [0, 0, 0, -1]))
        kept = builder.or_(builder.and_(new, larger), builder.and_(old, builder.not_(larger)))
        kept = builder.add(builder.or_(kept, bits), ir.Constant(_FOUR_WHOLE, [0, 0, 0, 1]))
        builder.store(builder.bitcast(kept, TWO), place, align=8)
        place = builder.gep(least.data, [_whole(builder, places, CELL, values[0])])
        number, old = w.number(at), builder.load(place, align=8)
        builder.store(builder.select(builder.fcmp_ordered("<", number, old), number, old), place, align=8)
        return context.get_dummy_value()

    return types.void(types.int64, records, least, w, places), generate


def _put_places(
    builder: Any, places: Flat, grid: Flat, lane: Any, along_u: tuple[Lanes, Lanes], along_v: tuple[Lanes, Lanes]
) -> None:
    """Write where the points go: cell, micro-cell, first coefficient, first place of the shares, and quarter."""
    (h, s), (k, t) = along_u, along_v
    split, wide = grid.one(SPLIT), grid.one(WIDE)
    a, c = h.times_plus(split, part(s, split)), k.times_plus(split, part(t, split))
    fours = (k * 0.25).floor()
    share = fours.times_plus(4.0, fours.times_plus(-4.0, k).times_plus(grid.one(APART), h * grid.one(STEP)))
    for row, number in (
        (CELL, h.times_plus(grid.one(ACROSS), k)),
        (MICRO, a.times_plus(wide, c)),
        (CORNER, h.times_plus(grid.one(WIDTH), k)),
        (SHARE, share),
    ):
        places.put_whole(builder.add(lane, ir.Constant(I64, row)), number.whole())
    places.put_whole(builder.add(lane, ir.Constant(I64, BITS)), _quarters(builder, s, t))


def _put_records(builder: Any, w: Flat, places: Flat, lane: Any, residual: Lanes, first: Any) -> None:
    """Write what each point would be as a record: its residual, its number, the bit of its quarter."""
    who = builder.add(every(builder, first), ir.Constant(EIGHT_WHOLE, list(range(8))))
    bits = builder.load(address(builder, places.data, _after(builder, lane, 1, BITS), EIGHT_WHOLE), align=4)
    who, bits = builder.zext(who, EIGHT_PLACES), builder.zext(bits, EIGHT_PLACES)
    both = builder.bitcast(builder.or_(who, builder.shl(bits, whole_eight([32] * 8))), EIGHT)
    for half in (0, 1):
        lanes = [4 * half + i // 2 + 8 * (i % 2) for i in range(8)]
        pairs = Lanes(builder, pick_of_two(builder, residual.value, both, lanes))
        w.put(_after(builder, lane, 2, RECORDS + 8 * half), pairs)


_TWO_WHOLE, _FOUR_WHOLE = ir.VectorType(I64, 2), ir.VectorType(I32, 4)


def _constant(number: int) -> Any:
    return ir.Constant(EIGHT_WHOLE, [number] * 8)


def _after(builder: Any, lane: Any, times: int, start: int) -> Any:
    return builder.add(builder.mul(lane, ir.Constant(I64, times)), ir.Constant(I64, start))


def _whole(builder: Any, places: Flat, row: int, lane: Any) -> Any:
    place = builder.gep(places.data, [builder.add(lane, ir.Constant(I64, row))])
    return builder.zext(builder.load(place, align=4), I64)


def _by_points(builder: Any, weights: list[Lanes]) -> list[Any]:
    """Return four numbers of eight points point by point, two in each vector."""
    halves = []
    for lanes in ([0, 8, 1, 9, 2, 10, 3, 11], [4, 12, 5, 13, 6, 14, 7, 15]):
        pairs = [pick_of_two(builder, weights[i].value, weights[i + 1].value, lanes) for i in (0, 2)]
        for chosen in ([0, 1, 8, 9, 2, 3, 10, 11], [4, 5, 12, 13, 6, 7, 14, 15]):
            halves.append(pick_of_two(builder, pairs[0], pairs[1], chosen))
    return halves


def _across(builder: Any, fours: list[Any], along_v: list[Lanes]) -> Lanes:
    """Return the sums of the columns of eight points times their weights along v."""
    pairs = [pick_of_two(builder, fours[i], fours[i + 1], list(range(8))) for i in range(0, 8, 2)]
    low, high = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
    columns = []
    for lanes in ([0, 4, 8, 12, 1, 5, 9, 13], [2, 6, 10, 14, 3, 7, 11, 15]):
        halves = [pick_of_two(builder, pairs[i], pairs[i + 1], lanes) for i in (0, 2)]
        columns += [Lanes(builder, pick_of_two(builder, halves[0], halves[1], chosen)) for chosen in (low, high)]
    total = along_v[0] * columns[0]
    for j in range(1, 4):
        total = along_v[j].times_plus(columns[j], total)
    return total


def _weights(t: Lanes) -> list[Lanes]:
    q = 1.0 - t
    t2, q2 = t * t, q * q
    return [q2 * q, t2.times_plus(t.times_plus(3.0, -6.0), 4.0), q2.times_plus(q.times_plus(3.0, -6.0), 4.0), t2 * t]


def _quarters(builder: Any, s: Lanes, t: Lanes) -> Any:
    """Return the bits of ``occupancy.quarter`` above those that count."""
    bits = [_constant(bit << COUNTED) for bit in (4, 2, 1, -8)]  # -8: the sign
    below, early = t.at_most(s), t.at_most(1.0 - s)
    return builder.select(below, builder.select(early, bits[0], bits[1]), builder.select(early, bits[2], bits[3]))
