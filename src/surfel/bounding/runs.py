"""Products and sums over runs of flat arrays, eight numbers at a time."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from surfel.bounding.vectors import EIGHT, F64, FOUR, I32, I64, address, every, fused, load, pick, sums_of


@intrinsic
def add_scaled(typing, y, at, factor, x, start):  # type: ignore[no-untyped-def]
    """Add ``factor * x[start : start + 8]`` to ``y[at : at + 8]``; both are flat float64 arrays."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        left, right = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 3))
        pointer = address(builder, left, values[1], EIGHT)
        old, more = builder.load(pointer, align=8, typ=EIGHT), load(builder, right, values[4], EIGHT)
        builder.store(fused(builder, every(builder, values[2]), more, old), pointer, align=8)
        return context.get_dummy_value()

    return types.void(y, types.int64, types.float64, x, types.int64), generate


@intrinsic
def dot_run(typing, x, at, y, start, count):  # type: ignore[no-untyped-def]
    """Return the product of ``x[at : at + count]`` and ``y[start : start + count]``; eight sums run side by side."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        left, right = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 2))
        zero = ir.Constant(I64, 0)
        wide = cgutils.alloca_once_value(builder, ir.Constant(EIGHT, [ir.Constant(F64, 0.0)] * 8))
        eights = builder.ashr(values[4], ir.Constant(I64, 3))
        with cgutils.for_range(builder, eights) as loop:
            step = builder.mul(loop.index, ir.Constant(I64, 8))
            one = load(builder, left, builder.add(values[1], step), EIGHT)
            other = load(builder, right, builder.add(values[3], step), EIGHT)
            builder.store(fused(builder, one, other, builder.load(wide)), wide)
        sums = builder.load(wide)
        half = builder.fadd(pick(builder, sums, [0, 1, 2, 3]), pick(builder, sums, [4, 5, 6, 7]))
        pair = builder.fadd(pick(builder, half, [0, 1]), pick(builder, half, [2, 3]))
        lanes = [builder.extract_element(pair, ir.Constant(I32, i)) for i in (0, 1)]
        total = cgutils.alloca_once_value(builder, builder.fadd(*lanes))
        done = builder.mul(eights, ir.Constant(I64, 8))
        rest = builder.sub(values[4], done)
        with cgutils.for_range(builder, builder.select(builder.icmp_signed("<", rest, zero), zero, rest)) as loop:
            step = builder.add(done, loop.index)
            one = builder.load(builder.gep(left, [builder.add(values[1], step)]))
            other = builder.load(builder.gep(right, [builder.add(values[3], step)]))
            builder.store(builder.fadd(builder.load(total), builder.fmul(one, other)), total)
        return builder.load(total)

    return types.float64(x, types.int64, y, types.int64, types.int64), generate


@intrinsic
def dot_tile(typing, x, first, second, step, eights, out):  # type: ignore[no-untyped-def]
    """Write the products of four rows of a flat array and four others, each of some eights of numbers, to 16 places.

    The rows begin at ``x[first]`` and ``x[second]`` and ``step`` numbers further on each.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        left, right = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 5))
        zero = ir.Constant(EIGHT, [ir.Constant(F64, 0.0)] * 8)
        sums = [cgutils.alloca_once_value(builder, zero) for _ in range(16)]
        for total in sums:
            builder.store(zero, total)
        ways = [builder.mul(values[3], ir.Constant(I64, i)) for i in range(4)]
        with cgutils.for_range(builder, values[4]) as loop:
            here = builder.mul(loop.index, ir.Constant(I64, 8))
            ones, others = (
                [load(builder, left, builder.add(builder.add(at, here), way), EIGHT) for way in ways]
                for at in values[1:3]
            )
            for i, total in enumerate(sums):
                builder.store(fused(builder, ones[i // 4], others[i % 4], builder.load(total)), total)
        for half in (0, 8):
            joined = sums_of(builder, [builder.load(total) for total in sums[half : half + 8]])
            builder.store(joined, address(builder, right, ir.Constant(I64, half), EIGHT), align=8)
        return context.get_dummy_value()

    i = types.int64
    return types.void(x, i, i, i, i, out), generate


@intrinsic
def gram_run(typing, local, theta, weight, first, count):  # type: ignore[no-untyped-def]
    """Write ``sum theta_i w_i w_i^T`` over some rows of 16 numbers to the flat 16 x 16 ``local``: its lower half.

    The rows are ``weight[16 i : 16 i + 16]`` for i from ``first`` on; sums of the upper eight rows stop at column 7.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        out, factors, flat = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in range(3))
        for (a, half), total in _gram(builder, factors, flat, values[3], values[4]):
            pointer = address(builder, out, ir.Constant(I64, 16 * a + 8 * half), EIGHT)
            builder.store(total, pointer, align=8)
        return context.get_dummy_value()

    return types.void(local, theta, weight, types.int64, types.int64), generate


@intrinsic
def gram_into(typing, band, at, across, step, theta, weight, first, count):  # type: ignore[no-untyped-def]
    """Add the sums of :func:`gram_run` to the rows of a flat band matrix, for coefficients that lie four by four.

    The diagonal of the first coefficient is ``band[at]``; those of one column are ``across`` unknowns apart, and the
    diagonals of neighbouring unknowns ``step + 1`` places. On the diagonal some run over into the pad.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        out, factors, flat = (
            context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 4, 5)
        )
        _, at, across, step = values[:4]
        sums = dict(_gram(builder, factors, flat, values[6], values[7]))
        for p in range(4):
            for q in range(4):
                row = builder.add(builder.mul(across, ir.Constant(I64, p)), ir.Constant(I64, q))
                place = builder.add(at, builder.mul(row, step))
                for c in range(p + 1):
                    lanes = [4 * (c % 2) + b for b in range(4)]
                    more = pick(builder, sums[4 * p + q, c // 2], lanes)
                    pointer = address(builder, out, place, FOUR)
                    builder.store(builder.fadd(builder.load(pointer, align=8), more), pointer, align=8)
                    place = builder.add(place, across)
        return context.get_dummy_value()

    i = types.int64
    return types.void(band, i, i, i, theta, weight, i, i), generate


def _gram(builder: Any, factors: Any, flat: Any, first: Any, count: Any) -> list[tuple[tuple[int, int], Any]]:
    """Return the lower half of ``sum theta_i w_i w_i^T``: for rows a and halves of them eight sums each."""
    zero = ir.Constant(EIGHT, [ir.Constant(F64, 0.0)] * 8)
    halves = [(a, half) for a in range(16) for half in range(1 if a < 8 else 2)]
    sums = [cgutils.alloca_once_value(builder, zero) for _ in halves]
    for total in sums:
        builder.store(zero, total)
    with cgutils.for_range(builder, count) as loop:
        i = builder.add(first, loop.index)
        theta, at = every(builder, builder.load(builder.gep(factors, [i]))), builder.mul(i, ir.Constant(I64, 16))
        places = [builder.add(at, ir.Constant(I64, a)) for a in range(16)]
        parts = [builder.fmul(theta, load(builder, flat, places[8 * half], EIGHT)) for half in (0, 1)]
        for (a, half), total in zip(halves, sums, strict=True):
            one = every(builder, builder.load(builder.gep(flat, [places[a]])))
            builder.store(fused(builder, one, parts[half], builder.load(total)), total)
    return [(place, builder.load(total)) for place, total in zip(halves, sums, strict=True)]
