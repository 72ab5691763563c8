"""Products and sums over runs of flat arrays, eight numbers at a time."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from surfel.bounding.vectors import EIGHT, F64, I32, I64, address, every, load, pick


@intrinsic
def add_scaled(typing, y, at, factor, x, start):  # type: ignore[no-untyped-def]
    """Add ``factor * x[start : start + 8]`` to ``y[at : at + 8]``; both are flat float64 arrays."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        left, right = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 3))
        product = builder.fmul(every(builder, values[2]), load(builder, right, values[4], EIGHT))
        pointer = address(builder, left, values[1], EIGHT)
        builder.store(builder.fadd(builder.load(pointer, align=8, typ=EIGHT), product), pointer, align=8)
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
            builder.store(builder.fadd(builder.load(wide), builder.fmul(one, other)), wide)
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
def subtract_four(typing, y, at, a, b, c, d, x, start, stride):  # type: ignore[no-untyped-def]
    """Subtract a, b, c, d times the runs of 8 at ``start``, ``start + stride``, ... of x from ``y[at : at + 8]``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        left, right = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 6))
        place, terms = values[7], []
        for i in range(4):
            terms.append(builder.fmul(every(builder, values[2 + i]), load(builder, right, place, EIGHT)))
            place = builder.add(place, values[8])
        total = builder.fadd(builder.fadd(terms[0], terms[1]), builder.fadd(terms[2], terms[3]))
        pointer = address(builder, left, values[1], EIGHT)
        builder.store(builder.fsub(builder.load(pointer, align=8, typ=EIGHT), total), pointer, align=8)
        return context.get_dummy_value()

    f, i = types.float64, types.int64
    return types.void(y, i, f, f, f, f, x, i, i), generate
