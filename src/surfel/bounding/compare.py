"""Runs of points beside the spline of their cell: values, residuals and sums, by whole vectors.

The formulas are those of ``evaluate.value_in``, rounded alike: the numbers are the same to the last bit. What a cell
needs lies in a flat array ``c``: SPLIT, and from ``NET`` on the 16 coefficients.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from surfel.bounding.records import part, records
from surfel.bounding.vectors import (
    EIGHT,
    EIGHT_PLACES,
    EIGHT_WHOLE,
    F64,
    I8,
    I32,
    I64,
    Flat,
    Lanes,
    Sum,
    every,
    halved,
    pick_of_two,
    sums_of,
    whole_eight,
)

SPLIT, NET = 0, 1
CONSTANTS = NET + 16
"""Places in ``c``."""

SUM_Z, SUM_R, LEAST_R = 0, 8, 16
SUMS = 17
"""Where in the sums of runs stand: heights and residuals, eight each, and the least residual."""


@intrinsic
def compare_run(typing, run, first, count, c, residuals, marks, many, moments, sums, at):  # type: ignore[no-untyped-def]
    """Compare the ``count`` points of one cell, at most 120, whose records begin at that of number ``first``.

    What follows them in the last eight repeats one of them. ``residuals[i]`` and ``marks[i]`` are each point's residual
    and its micro-cell, counted in rows of SPLIT; ``many`` tells how many points these hold. ``marks[count]``, rounded
    up to eights, has the quarters of the cell. In ``sums`` SUM_Z and SUM_R go on, LEAST_R is new.
    """
    i = types.int64
    return types.void(run, i, i, c, residuals, marks, many, moments, sums, i), _comparison(weigh=False)


@intrinsic
def compare_and_weigh_run(typing, run, first, count, c, residuals, marks, many, moments, sums, at):  # type: ignore[no-untyped-def]
    """Compare, and add the 16 sums of products of six times the weights of the points to ``moments[at]``."""
    i = types.int64
    return types.void(run, i, i, c, residuals, marks, many, moments, sums, i), _comparison(weigh=True)


def _comparison(*, weigh: bool) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        run, c, out, whole, many, moments, total = (
            Flat(context, builder, signature.args[i], values[i]) for i in (0, 3, 4, 5, 6, 7, 8)
        )
        first, count, begin = values[1], values[2], values[9]
        zero, infinite = (ir.Constant(EIGHT, [ir.Constant(F64, x)] * 8) for x in (0.0, float("inf")))
        kept = [Sum(builder, start) for start in [zero] * (18 if weigh else 2) + [infinite]]
        sum_z, sum_r, least = kept[-3:]
        bits = cgutils.alloca_once_value(builder, ir.Constant(EIGHT_WHOLE, [ir.Constant(I32, 0)] * 8))
        counts = cgutils.alloca_once_value(builder, whole_eight([0] * 8))
        rounded = builder.and_(builder.add(count, ir.Constant(I64, 7)), ir.Constant(I64, -8))
        with cgutils.for_range(builder, builder.ashr(rounded, ir.Constant(I64, 3))) as loop:
            lane = builder.mul(loop.index, ir.Constant(I64, 8))
            s, t, height = records(run, builder.add(first, lane))
            lanes = builder.add(every(builder, lane), whole_eight(list(range(8))))
            counted = builder.icmp_signed("<", lanes, every(builder, count))
            along_u, along_v = _weights(s), _weights(t)
            residual = height - _value(c, along_u, along_v)
            out.put(lane, residual)
            a, b = (part(local, c.one(SPLIT)) for local in (s, t))
            mark = a.times_plus(c.one(SPLIT), b).whole()
            whole.put_whole(lane, mark)
            builder.store(builder.or_(builder.load(bits), _quarters(builder, s, t)), bits)
            # 16 numbers of four bits in each lane: no more than 15 points come into one
            one = builder.zext(counted, EIGHT_PLACES)
            shift = builder.shl(builder.zext(mark, EIGHT_PLACES), whole_eight([2] * 8))
            builder.store(builder.add(builder.load(counts), builder.shl(one, shift)), counts)
            sum_z.put(sum_z.value + height.where(counted, 0.0))
            sum_r.put(sum_r.value + residual.where(counted, 0.0))
            least.put(residual.least(least.value))
            if weigh:
                along_v = [weight.where(counted, 0.0) for weight in along_v]
                for i in range(16):
                    kept[i].put(along_u[i // 4].times_plus(along_v[i % 4], kept[i].value))
        quarters = halved(builder, builder.load(bits), builder.or_)
        builder.store(quarters, builder.gep(whole.data, [rounded]), align=4)
        builder.store(least.joined(), builder.gep(total.data, [ir.Constant(I64, LEAST_R)]), align=8)
        many.put_whole(0, _unpacked(builder, builder.load(counts)))
        for row, more in ((SUM_Z, sum_z), (SUM_R, sum_r)):
            total.put(row, total.eight(row) + more.value)
        if weigh:
            for half in (0, 8):
                place = builder.add(begin, ir.Constant(I64, half))
                more = sums_of(builder, [k.value.value for k in kept[half : half + 8]])
                moments.put(place, moments.eight(place) + Lanes(builder, more))
        return context.get_dummy_value()

    return generate


def _unpacked(builder: Any, counts: Any) -> Any:
    """Return 16 numbers of eight lanes, four bits each, as their sums over the lanes."""
    bytes_of, mask = ir.VectorType(I8, 8), whole_eight([0x0F0F0F0F0F0F0F0F] * 8)
    odd = builder.lshr(counts, whole_eight([4] * 8))
    halves = [halved(builder, builder.and_(lanes, mask), builder.add) for lanes in (counts, odd)]
    even, odd = (builder.bitcast(half, bytes_of) for half in halves)
    both = pick_of_two(builder, even, odd, [8 * (i % 2) + i // 2 for i in range(16)])
    return builder.zext(both, ir.VectorType(I32, 16))


def _weights(t: Lanes) -> list[Lanes]:
    q = 1.0 - t
    t2, q2 = t * t, q * q
    return [q2 * q, t2.times_plus(t.times_plus(3.0, -6.0), 4.0), q2.times_plus(q.times_plus(3.0, -6.0), 4.0), t2 * t]


def _value(cell: Flat, along_u: list[Lanes], along_v: list[Lanes]) -> Lanes:
    columns = []
    for j in range(4):
        column = along_u[0] * cell.one(NET + j)
        for i in range(1, 4):
            column = along_u[i].times_plus(cell.one(NET + 4 * i + j), column)
        columns.append(column)
    total = along_v[0] * columns[0]
    for j in range(1, 4):
        total = along_v[j].times_plus(columns[j], total)
    return total * (1.0 / 36.0)


def _quarters(builder: Any, s: Lanes, t: Lanes) -> Any:
    bits = [ir.Constant(EIGHT_WHOLE, [ir.Constant(I32, bit)] * 8) for bit in (4, 2, 1, 8)]
    below, early = t.at_most(s), t.at_most(1.0 - s)
    return builder.select(below, builder.select(early, bits[0], bits[1]), builder.select(early, bits[2], bits[3]))
