"""Whole-vector forms of the innermost products; made of operations that every LLVM lowers."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from surfel.bounding.vectors import (
    EIGHT,
    F64,
    FOUR,
    I32,
    I64,
    address,
    fused,
    load,
    pick,
    spread,
    three,
)


@intrinsic
def cell_value(typing, b, h, k, s, t):  # type: ignore[no-untyped-def]
    """Return 36 times the spline in cell (h, k) at local coordinates (s, t); ``b`` is C-contiguous float64.

    With six times the weights U of s and V of t: ``c_j = U_3 b_3j + (U_2 b_2j + (U_1 b_1j + U_0 b_0j))`` and
    ``V_3 c_3 + (V_2 c_2 + (V_1 c_1 + V_0 c_0))``; each product is added to what is right of it with one rounding.
    """
    if not isinstance(b, types.Array) or b.ndim != 2 or b.layout != "C" or b.dtype != types.float64:
        raise TypeError("coefficients must be a contiguous float64 array")

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        weights = _weights(builder, values[3], values[4])
        array = context.make_array(signature.args[0])(context, builder, values[0])
        width = builder.extract_value(array.shape, 1)
        place = builder.add(builder.mul(values[1], width), values[2])
        columns = None
        for i in range(4):
            row, weight = load(builder, array.data, place, FOUR), spread(builder, weights, i)
            columns = builder.fmul(weight, row) if columns is None else fused(builder, weight, row, columns)
            place = builder.add(place, width)
        total = None
        for j in range(4):
            weight, column = pick(builder, weights, [4 + j]), pick(builder, columns, [j])
            total = builder.fmul(weight, column) if total is None else fused(builder, weight, column, total)
        return builder.extract_element(total, ir.Constant(I32, 0))

    return types.float64(b, types.int64, types.int64, types.float64, types.float64), generate


@intrinsic
def cell_slopes(typing, b, h, k, s, t):  # type: ignore[no-untyped-def]
    """Return 36 times the first derivatives of the spline with respect to u and to v, as :func:`cell_value`."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        weights, slopes = _weights(builder, values[3], values[4]), _slopes(builder, values[3], values[4])
        array = context.make_array(signature.args[0])(context, builder, values[0])
        width = builder.extract_value(array.shape, 1)
        place = builder.add(builder.mul(values[1], width), values[2])
        columns: list[Any] = [None, None]
        for i in range(4):
            row = load(builder, array.data, place, FOUR)
            for way, factors in enumerate((slopes, weights)):
                factor, before = spread(builder, factors, i), columns[way]
                columns[way] = builder.fmul(factor, row) if before is None else fused(builder, factor, row, before)
            place = builder.add(place, width)
        found = []
        for column, factors in zip(columns, (weights, slopes), strict=True):
            four = builder.fmul(column, pick(builder, factors, [4, 5, 6, 7]))
            pair = builder.fadd(pick(builder, four, [0, 1]), pick(builder, four, [2, 3]))
            found.append(builder.fadd(*(builder.extract_element(pair, ir.Constant(I32, lane)) for lane in (0, 1))))
        return context.make_tuple(builder, signature.return_type, found)

    f = types.float64
    return types.UniTuple(f, 2)(b, types.int64, types.int64, f, f), generate


@intrinsic
def larger(typing, a, b):  # type: ignore[no-untyped-def]
    """Return the larger of two numbers, without a branch."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", *values), *values)

    return types.float64(types.float64, types.float64), generate


@intrinsic
def stretch(typing, p, at, times, lanes):  # type: ignore[no-untyped-def]
    """Take runs of 24 numbers from ``p[at]`` on into 24 minima, 24 maxima and 24 sums of ``x - x``.

    The sums are not 0 where a number is not finite.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, out = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 3))
        places = [address(builder, out, ir.Constant(I64, 8 * i), EIGHT) for i in range(9)]
        kept = [cgutils.alloca_once_value(builder, builder.load(place, align=8)) for place in places]
        for place, value in zip(places, kept, strict=True):
            builder.store(builder.load(place, align=8), value)
        with cgutils.for_range(builder, values[2]) as loop:
            here = builder.add(values[1], builder.mul(loop.index, ir.Constant(I64, 24)))
            for part, new in enumerate(three(builder, flat, here)):
                for row, compare in enumerate(("<", ">", None)):
                    old = builder.load(kept[3 * row + part])
                    if compare is None:
                        best = builder.fadd(old, builder.fsub(new, new))
                    else:
                        best = builder.select(builder.fcmp_ordered(compare, new, old), new, old)
                    builder.store(best, kept[3 * row + part])
        for place, value in zip(places, kept, strict=True):
            builder.store(builder.load(value), place, align=8)
        return context.get_dummy_value()

    return types.void(p, types.int64, types.int64, lanes), generate


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


@intrinsic
def there_and_back(typing, b, place, width, weights, at, z, factor, sums, share, step):  # type: ignore[no-untyped-def]
    """Add ``factor (w.b - z) w`` to ``sums``, and return ``w.b - z``: w are the 16 products of a point's weights.

    Those along u are ``weights[at : at + 4]``, those along v the four after them. The cell's 16 numbers lie in the
    flat ``b`` at ``place`` in rows of ``width``, its sums at ``share`` in rows of ``step``.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, along, sums = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 3, 7))
        place, share, at, column = values[1], values[8], values[4], None
        across = load(builder, along, builder.add(at, ir.Constant(I64, 4)), FOUR)
        factors = []
        for i in range(4):
            one = builder.load(builder.gep(along, [builder.add(at, ir.Constant(I64, i))]))
            first = builder.insert_element(ir.Constant(FOUR, ir.Undefined), one, ir.Constant(I32, 0))
            factors.append(spread(builder, first, 0))
            row = load(builder, flat, place, FOUR)
            column = builder.fmul(factors[i], row) if i == 0 else fused(builder, factors[i], row, column)
            place = builder.add(place, values[2])
        terms = builder.fmul(column, across)
        pair = builder.fadd(pick(builder, terms, [0, 1]), pick(builder, terms, [2, 3]))
        value = builder.fadd(*(builder.extract_element(pair, ir.Constant(I32, lane)) for lane in (0, 1)))
        value = builder.fsub(value, values[5])
        first = builder.insert_element(
            ir.Constant(FOUR, ir.Undefined), builder.fmul(value, values[6]), ir.Constant(I32, 0)
        )
        across = builder.fmul(across, spread(builder, first, 0))
        for i in range(4):
            pointer = address(builder, sums, share, FOUR)
            builder.store(fused(builder, factors[i], across, builder.load(pointer, align=8)), pointer, align=8)
            share = builder.add(share, values[9])
        return value

    i, f = types.int64, types.float64
    return f(b, i, i, weights, i, f, f, sums, i, i), generate


def _weights(builder: Any, s: Any, t: Any) -> Any:
    # Six times the weights of s and of t in one vector of eight: q^3, 4 + t^2 (3 t - 6), 4 + q^2 (3 q - 6), t^3.
    base = _both_ends(builder, s, t)
    square, factor, shift = builder.fmul(base, base), _constant([1.0, 3.0, 3.0, 1.0]), _constant([0.0, -6.0, -6.0, 0.0])
    return fused(builder, square, fused(builder, factor, base, shift), _constant([0.0, 4.0, 4.0, 0.0]))


def _slopes(builder: Any, s: Any, t: Any) -> Any:
    # Six times their derivatives: -3 q^2, t (9 t - 12), q (12 - 9 q), 3 t^2.
    base = _both_ends(builder, s, t)
    factors, shift = _constant([-3.0, 9.0, -9.0, 3.0]), _constant([0.0, -12.0, 12.0, 0.0])
    return builder.fmul(base, fused(builder, factors, base, shift))


def _both_ends(builder: Any, s: Any, t: Any) -> Any:
    one = ir.Constant(F64, 1.0)
    p, q = builder.fsub(one, s), builder.fsub(one, t)
    base = ir.Constant(EIGHT, ir.Undefined)
    for lane, value in enumerate([p, s, p, s, q, t, q, t]):
        base = builder.insert_element(base, value, ir.Constant(I32, lane))
    return base


def _constant(four: list[float]) -> Any:
    return ir.Constant(EIGHT, [ir.Constant(F64, x) for x in four + four])
