"""The two smallest squared distances of a short list, by whole vectors; every LLVM lowers this for every processor."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from surfel.index.simd import LANES

_F32, _I32, _I64 = ir.FloatType(), ir.IntType(32), ir.IntType(64)
_FLOATS, _INTS = ir.VectorType(_F32, LANES), ir.VectorType(_I32, LANES)


@intrinsic
def two_least(typing, xs, ys, zs, count, x, y, z, mask):  # type: ignore[no-untyped-def]
    """Return the smallest and the second smallest key of squared distances from (x, y, z).

    Keys are those of :func:`surfel.index.simd.within_plain`: the bits of the float32 square, those under ``mask``
    replaced by the number of the slot. Coordinates are float32 and finite or infinite, ``count`` is a multiple of 16.
    """
    signature = types.UniTuple(types.int32, 2)(xs, ys, zs, count, x, y, z, mask)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        def cast(k: int, kind: Any) -> Any:
            return context.cast(builder, values[k], signature.args[k], kind)

        def splat(value: Any, kind: Any) -> Any:
            first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, _I32(0))
            return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), ir.Constant(_INTS, [_I32(0)] * LANES))

        def lesser(a: Any, b: Any) -> tuple[Any, Any]:
            less = builder.icmp_signed("<", a, b)
            return builder.select(less, a, b), builder.select(less, b, a)

        def least_of(vector: Any) -> Any:
            width = LANES
            while width > 1:
                width //= 2
                turned = [_I32((k + width) % LANES) for k in range(LANES)]
                other = builder.shuffle_vector(vector, vector, ir.Constant(_INTS, turned))
                vector = lesser(vector, other)[0]
            return builder.extract_element(vector, _I32(0))

        data = [context.make_array(signature.args[k])(context, builder, values[k]).data for k in range(3)]
        centre = [splat(cast(4 + k, types.float32), _FLOATS) for k in range(3)]
        upper = splat(builder.not_(cast(7, types.int32)), _INTS)
        most = ir.Constant(_INTS, [_I32(2**31 - 1)] * LANES)
        first, second = cgutils.alloca_once_value(builder, most), cgutils.alloca_once_value(builder, most)
        lanes = cgutils.alloca_once_value(builder, ir.Constant(_INTS, [_I32(k) for k in range(LANES)]))
        runs = builder.sdiv(cast(3, types.int64), _I64(LANES))
        with cgutils.for_range(builder, runs, intp=_I64) as loop:
            start = builder.mul(loop.index, _I64(LANES))
            square = None
            for axis in range(3):
                place = builder.bitcast(builder.gep(data[axis], [start]), _FLOATS.as_pointer())
                gap = builder.fsub(builder.load(place, align=4), centre[axis])
                product = builder.fmul(gap, gap)
                square = product if square is None else builder.fadd(square, product)
            slot = builder.load(lanes)
            key = builder.or_(builder.and_(builder.bitcast(square, _INTS), upper), slot)
            builder.store(builder.add(slot, ir.Constant(_INTS, [_I32(LANES)] * LANES)), lanes)
            less, more = lesser(key, builder.load(first))
            builder.store(less, first)
            builder.store(lesser(more, builder.load(second))[0], second)
        least = least_of(builder.load(first))
        here = builder.icmp_signed("==", builder.load(first), splat(least, _INTS))
        rest = builder.select(here, builder.load(second), builder.load(first))
        return context.make_tuple(builder, signature.return_type, (least, least_of(rest)))

    return signature, generate
