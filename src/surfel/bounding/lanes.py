"""Whole-vector forms of the innermost products; made of operations that every LLVM lowers."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from surfel.bounding.vectors import EIGHT, F64, FOUR, I32, I64, address, load, pick, pick_of_two, spread, three

BLOCK = 120
"""Points that are worked on together: their coordinates and weights stay in the first cache. No power of two: the rows
of a block would then meet in the same few places of that cache."""


@intrinsic
def cell_value(typing, b, h, k, s, t):  # type: ignore[no-untyped-def]
    """Return 36 times the spline in cell (h, k) at local coordinates (s, t); ``b`` is C-contiguous float64.

    With six times the weights U of s and V of t: ``c_j = (U_0 b_0j + U_1 b_1j) + (U_2 b_2j + U_3 b_3j)`` and
    ``(c_0 V_0 + c_1 V_1) + (c_2 V_2 + c_3 V_3)``, rounded in this order.
    """
    if not isinstance(b, types.Array) or b.ndim != 2 or b.layout != "C" or b.dtype != types.float64:
        raise TypeError("coefficients must be a contiguous float64 array")

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        weights = _weights(builder, values[3], values[4])
        array = context.make_array(signature.args[0])(context, builder, values[0])
        width = builder.extract_value(array.shape, 1)
        place = builder.add(builder.mul(values[1], width), values[2])
        rows = []
        for i in range(4):
            row = load(builder, array.data, place, FOUR)
            rows.append(builder.fmul(spread(builder, weights, i), row))
            place = builder.add(place, width)
        columns = builder.fadd(builder.fadd(rows[0], rows[1]), builder.fadd(rows[2], rows[3]))
        terms = builder.fmul(columns, pick(builder, weights, [4, 5, 6, 7]))
        pairs = builder.fadd(pick(builder, terms, [0, 2]), pick(builder, terms, [1, 3]))
        return builder.fadd(
            builder.extract_element(pairs, ir.Constant(I32, 0)), builder.extract_element(pairs, ir.Constant(I32, 1))
        )

    return types.float64(b, types.int64, types.int64, types.float64, types.float64), generate


@intrinsic
def columns_of(typing, p, at, w, lane):  # type: ignore[no-untyped-def]
    """Write x, y and z of the eight points that begin at ``p[at]``, flat, to ``w[BLOCK * i + lane]``, i = 0, 1, 2."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, out = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 2))
        first, second, third = three(builder, flat, values[1])
        place = values[3]
        for axis in range(3):
            lanes = [i for i in range(axis, 24, 3) if i < 16]
            both = pick_of_two(builder, first, second, lanes + [0] * (8 - len(lanes)))
            rest = [8 + i - 16 for i in range(axis, 24, 3) if i >= 16]
            every = pick_of_two(builder, both, third, [*range(8 - len(rest)), *rest])
            builder.store(every, address(builder, out, place, EIGHT), align=8)
            place = builder.add(place, ir.Constant(I64, BLOCK))
        return context.get_dummy_value()

    return types.void(p, types.int64, w, types.int64), generate


@intrinsic
def stretch(typing, p, at, lanes):  # type: ignore[no-untyped-def]
    """Take ``p[at : at + 24]`` into 24 minima, 24 maxima and 24 sums of ``x - x``: not 0 where x is not finite."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, out = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 2))
        for part, new in enumerate(three(builder, flat, values[1])):
            for row, compare in enumerate(("<", ">", None)):
                pointer = address(builder, out, ir.Constant(I64, 24 * row + 8 * part), EIGHT)
                old = builder.load(pointer, align=8, typ=EIGHT)
                if compare is None:
                    best = builder.fadd(old, builder.fsub(new, new))
                else:
                    best = builder.select(builder.fcmp_ordered(compare, new, old), new, old)
                builder.store(best, pointer, align=8)
        return context.get_dummy_value()

    return types.void(p, types.int64, lanes), generate


@intrinsic
def cell_columns(typing, b, place, width, weights, lane):  # type: ignore[no-untyped-def]
    """Write the four numbers c_j of :func:`cell_value` for one lane of a block behind its row 13.

    ``place`` is where the cell's first coefficient lies in the flat ``b``, ``width`` the length of its rows;
    ``weights[BLOCK * i + lane]`` are the weights U_i.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, along = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 3))
        place, at = values[1], values[4]
        rows = []
        for _ in range(4):
            weight = builder.load(builder.gep(along, [at]), align=8, typ=F64)
            lanes = builder.insert_element(ir.Constant(FOUR, ir.Undefined), weight, ir.Constant(I32, 0))
            rows.append(builder.fmul(spread(builder, lanes, 0), load(builder, flat, place, FOUR)))
            place, at = builder.add(place, values[2]), builder.add(at, ir.Constant(I64, BLOCK))
        sums = builder.fadd(builder.fadd(rows[0], rows[1]), builder.fadd(rows[2], rows[3]))
        out = builder.add(builder.mul(values[4], ir.Constant(I64, 4)), ir.Constant(I64, 14 * BLOCK))
        builder.store(sums, address(builder, along, out, FOUR), align=8)
        return context.get_dummy_value()

    return types.void(b, types.int64, types.int64, weights, types.int64), generate


@intrinsic
def join_columns(typing, weights, lane):  # type: ignore[no-untyped-def]
    """Write the values of eight lanes to row 13: the c_j of :func:`cell_columns` times the weights V_j, over 36."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        along, lane = context.make_array(signature.args[0])(context, builder, values[0]).data, values[1]
        place = builder.add(builder.mul(lane, ir.Constant(I64, 4)), ir.Constant(I64, 14 * BLOCK))
        parts = []
        for _ in range(4):
            parts.append(load(builder, along, place, EIGHT))
            place = builder.add(place, ir.Constant(I64, 8))
        terms, at = [], builder.add(lane, ir.Constant(I64, 4 * BLOCK))
        for j in range(4):
            low = pick_of_two(builder, parts[0], parts[1], [j, j + 4, j + 8, j + 12])
            high = pick_of_two(builder, parts[2], parts[3], [j, j + 4, j + 8, j + 12])
            column = pick_of_two(builder, low, high, list(range(8)))
            terms.append(builder.fmul(column, load(builder, along, at, EIGHT)))
            at = builder.add(at, ir.Constant(I64, BLOCK))
        total = builder.fadd(builder.fadd(terms[0], terms[1]), builder.fadd(terms[2], terms[3]))
        value = builder.fdiv(total, ir.Constant(EIGHT, [ir.Constant(F64, 36.0)] * 8))
        out = builder.add(lane, ir.Constant(I64, 13 * BLOCK))
        builder.store(value, address(builder, along, out, EIGHT), align=8)
        return context.get_dummy_value()

    return types.void(weights, types.int64), generate


@intrinsic
def add_lane(typing, sums, row, weights, lane):  # type: ignore[no-untyped-def]
    """Add the 16 products of weights U_i V_j of a lane of a block to ``sums[16 row : 16 row + 16]``, flat."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, along = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 2))
        at, numbers = values[3], []
        for _ in range(8):
            numbers.append(builder.load(builder.gep(along, [at]), align=8, typ=F64))
            at = builder.add(at, ir.Constant(I64, BLOCK))
        right = ir.Constant(FOUR, ir.Undefined)
        for j in range(4):
            right = builder.insert_element(right, numbers[4 + j], ir.Constant(I32, j))
        place = builder.mul(values[1], ir.Constant(I64, 16))
        for i in range(4):
            lanes = builder.insert_element(ir.Constant(FOUR, ir.Undefined), numbers[i], ir.Constant(I32, 0))
            pointer = address(builder, flat, place, FOUR)
            old = builder.load(pointer, align=8, typ=FOUR)
            builder.store(builder.fadd(old, builder.fmul(spread(builder, lanes, 0), right)), pointer, align=8)
            place = builder.add(place, ir.Constant(I64, 4))
        return context.get_dummy_value()

    return types.void(sums, types.int64, weights, types.int64), generate


@intrinsic
def row_times(typing, b, place, width, weights, at):  # type: ignore[no-untyped-def]
    """Return the product of ``weights[at : at + 16]`` and the 16 numbers of the cell of a flat ``b`` at ``place``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, along = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 3))
        place, at, terms = values[1], values[4], []
        for _ in range(4):
            terms.append(builder.fmul(load(builder, flat, place, FOUR), load(builder, along, at, FOUR)))
            place, at = builder.add(place, values[2]), builder.add(at, ir.Constant(I64, 4))
        sums = builder.fadd(builder.fadd(terms[0], terms[1]), builder.fadd(terms[2], terms[3]))
        pairs = builder.fadd(pick(builder, sums, [0, 2]), pick(builder, sums, [1, 3]))
        return builder.fadd(
            builder.extract_element(pairs, ir.Constant(I32, 0)), builder.extract_element(pairs, ir.Constant(I32, 1))
        )

    return types.float64(b, types.int64, types.int64, weights, types.int64), generate


@intrinsic
def row_add(typing, sums, place, width, weights, at, factor):  # type: ignore[no-untyped-def]
    """Add ``factor * weights[at : at + 16]`` to the 16 numbers of the cell of a flat array at ``place``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, along = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 3))
        place, at = values[1], values[4]
        first = builder.insert_element(ir.Constant(FOUR, ir.Undefined), values[5], ir.Constant(I32, 0))
        factor = spread(builder, first, 0)
        for _ in range(4):
            pointer = address(builder, flat, place, FOUR)
            term = builder.fmul(factor, load(builder, along, at, FOUR))
            builder.store(builder.fadd(builder.load(pointer, align=8, typ=FOUR), term), pointer, align=8)
            place, at = builder.add(place, values[2]), builder.add(at, ir.Constant(I64, 4))
        return context.get_dummy_value()

    return types.void(sums, types.int64, types.int64, weights, types.int64, types.float64), generate


def _weights(builder: Any, s: Any, t: Any) -> Any:
    # Six times the weights of s and of t in one vector of eight: q^3, 4 + t^2 (3 t - 6), 4 + q^2 (3 q - 6), t^3.
    one = ir.Constant(F64, 1.0)
    p, q = builder.fsub(one, s), builder.fsub(one, t)
    base = ir.Constant(EIGHT, ir.Undefined)
    for lane, value in enumerate([p, s, p, s, q, t, q, t]):
        base = builder.insert_element(base, value, ir.Constant(I32, lane))
    factor = _constant([1.0, 3.0, 3.0, 1.0])
    shift = _constant([0.0, -6.0, -6.0, 0.0])
    offset = _constant([0.0, 4.0, 4.0, 0.0])
    square = builder.fmul(base, base)
    return builder.fadd(builder.fmul(square, builder.fadd(builder.fmul(factor, base), shift)), offset)


def _constant(four: list[float]) -> Any:
    return ir.Constant(EIGHT, [ir.Constant(F64, x) for x in four + four])
