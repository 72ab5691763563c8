"""Whole-vector forms of the innermost products; made of operations that every LLVM lowers."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

_F64, _I32, _I64 = ir.DoubleType(), ir.IntType(32), ir.IntType(64)
BLOCK = 256
"""Points that are worked on together: their coordinates and weights stay in the first cache."""

_FOUR, _EIGHT = ir.VectorType(_F64, 4), ir.VectorType(_F64, 8)


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
            row = _load(builder, array.data, place, _FOUR)
            rows.append(builder.fmul(_spread(builder, weights, i), row))
            place = builder.add(place, width)
        columns = builder.fadd(builder.fadd(rows[0], rows[1]), builder.fadd(rows[2], rows[3]))
        terms = builder.fmul(columns, _pick(builder, weights, [4, 5, 6, 7]))
        pairs = builder.fadd(_pick(builder, terms, [0, 2]), _pick(builder, terms, [1, 3]))
        return builder.fadd(
            builder.extract_element(pairs, ir.Constant(_I32, 0)), builder.extract_element(pairs, ir.Constant(_I32, 1))
        )

    return types.float64(b, types.int64, types.int64, types.float64, types.float64), generate


@intrinsic
def cell_columns(typing, b, place, width, weights, lane, columns):  # type: ignore[no-untyped-def]
    """Write the four numbers c_j of :func:`cell_value` for one lane of a block to ``columns[4 lane : 4 lane + 4]``.

    ``place`` is where the cell's first coefficient lies in the flat ``b``, ``width`` the length of its rows;
    ``weights[BLOCK * i + lane]`` are the weights U_i.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, along, out = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 3, 5))
        place, at = values[1], values[4]
        rows = []
        for _ in range(4):
            weight = builder.load(builder.gep(along, [at]), align=8, typ=_F64)
            lanes = builder.insert_element(ir.Constant(_FOUR, ir.Undefined), weight, ir.Constant(_I32, 0))
            rows.append(builder.fmul(_spread(builder, lanes, 0), _load(builder, flat, place, _FOUR)))
            place, at = builder.add(place, values[2]), builder.add(at, ir.Constant(_I64, BLOCK))
        sums = builder.fadd(builder.fadd(rows[0], rows[1]), builder.fadd(rows[2], rows[3]))
        builder.store(sums, _address(builder, out, builder.mul(values[4], ir.Constant(_I64, 4)), _FOUR), align=8)
        return context.get_dummy_value()

    return types.void(b, types.int64, types.int64, weights, types.int64, columns), generate


@intrinsic
def add_lane(typing, sums, row, weights, lane):  # type: ignore[no-untyped-def]
    """Add the 16 products of weights U_i V_j of a lane of a block to ``sums[16 row : 16 row + 16]``, flat."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, along = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 2))
        at, numbers = values[3], []
        for _ in range(8):
            numbers.append(builder.load(builder.gep(along, [at]), align=8, typ=_F64))
            at = builder.add(at, ir.Constant(_I64, BLOCK))
        right = ir.Constant(_FOUR, ir.Undefined)
        for j in range(4):
            right = builder.insert_element(right, numbers[4 + j], ir.Constant(_I32, j))
        place = builder.mul(values[1], ir.Constant(_I64, 16))
        for i in range(4):
            lanes = builder.insert_element(ir.Constant(_FOUR, ir.Undefined), numbers[i], ir.Constant(_I32, 0))
            pointer = _address(builder, flat, place, _FOUR)
            old = builder.load(pointer, align=8, typ=_FOUR)
            builder.store(builder.fadd(old, builder.fmul(_spread(builder, lanes, 0), right)), pointer, align=8)
            place = builder.add(place, ir.Constant(_I64, 4))
        return context.get_dummy_value()

    return types.void(sums, types.int64, weights, types.int64), generate


@intrinsic
def row_times(typing, b, place, width, weights, at):  # type: ignore[no-untyped-def]
    """Return the product of ``weights[at : at + 16]`` and the 16 numbers of the cell of a flat ``b`` at ``place``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, along = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 3))
        place, at, terms = values[1], values[4], []
        for _ in range(4):
            terms.append(builder.fmul(_load(builder, flat, place, _FOUR), _load(builder, along, at, _FOUR)))
            place, at = builder.add(place, values[2]), builder.add(at, ir.Constant(_I64, 4))
        sums = builder.fadd(builder.fadd(terms[0], terms[1]), builder.fadd(terms[2], terms[3]))
        pairs = builder.fadd(_pick(builder, sums, [0, 2]), _pick(builder, sums, [1, 3]))
        return builder.fadd(
            builder.extract_element(pairs, ir.Constant(_I32, 0)), builder.extract_element(pairs, ir.Constant(_I32, 1))
        )

    return types.float64(b, types.int64, types.int64, weights, types.int64), generate


@intrinsic
def row_add(typing, sums, place, width, weights, at, factor):  # type: ignore[no-untyped-def]
    """Add ``factor * weights[at : at + 16]`` to the 16 numbers of the cell of a flat array at ``place``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, along = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 3))
        place, at = values[1], values[4]
        first = builder.insert_element(ir.Constant(_FOUR, ir.Undefined), values[5], ir.Constant(_I32, 0))
        factor = _spread(builder, first, 0)
        for _ in range(4):
            pointer = _address(builder, flat, place, _FOUR)
            term = builder.fmul(factor, _load(builder, along, at, _FOUR))
            builder.store(builder.fadd(builder.load(pointer, align=8, typ=_FOUR), term), pointer, align=8)
            place, at = builder.add(place, values[2]), builder.add(at, ir.Constant(_I64, 4))
        return context.get_dummy_value()

    return types.void(sums, types.int64, types.int64, weights, types.int64, types.float64), generate


@intrinsic
def add_scaled(typing, y, at, factor, x, start):  # type: ignore[no-untyped-def]
    """Add ``factor * x[start : start + 8]`` to ``y[at : at + 8]``; both are flat float64 arrays."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        left, right = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 3))
        product = builder.fmul(_every(builder, values[2]), _load(builder, right, values[4], _EIGHT))
        pointer = _address(builder, left, values[1], _EIGHT)
        builder.store(builder.fadd(builder.load(pointer, align=8, typ=_EIGHT), product), pointer, align=8)
        return context.get_dummy_value()

    return types.void(y, types.int64, types.float64, x, types.int64), generate


@intrinsic
def subtract_four(typing, y, at, a, b, c, d, x, start, stride):  # type: ignore[no-untyped-def]
    """Subtract a, b, c, d times the runs of 8 at ``start``, ``start + stride``, ... of x from ``y[at : at + 8]``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        left, right = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 6))
        place, terms = values[7], []
        for i in range(4):
            terms.append(builder.fmul(_every(builder, values[2 + i]), _load(builder, right, place, _EIGHT)))
            place = builder.add(place, values[8])
        total = builder.fadd(builder.fadd(terms[0], terms[1]), builder.fadd(terms[2], terms[3]))
        pointer = _address(builder, left, values[1], _EIGHT)
        builder.store(builder.fsub(builder.load(pointer, align=8, typ=_EIGHT), total), pointer, align=8)
        return context.get_dummy_value()

    f, i = types.float64, types.int64
    return types.void(y, i, f, f, f, f, x, i, i), generate


def _every(builder: Any, value: Any) -> Any:
    lanes = builder.insert_element(ir.Constant(_EIGHT, ir.Undefined), value, ir.Constant(_I32, 0))
    return _pick(builder, lanes, [0] * 8)


def _weights(builder: Any, s: Any, t: Any) -> Any:
    # Six times the weights of s and of t in one vector of eight: q^3, 4 + t^2 (3 t - 6), 4 + q^2 (3 q - 6), t^3.
    one = ir.Constant(_F64, 1.0)
    p, q = builder.fsub(one, s), builder.fsub(one, t)
    base = ir.Constant(_EIGHT, ir.Undefined)
    for lane, value in enumerate([p, s, p, s, q, t, q, t]):
        base = builder.insert_element(base, value, ir.Constant(_I32, lane))
    factor = _constant([1.0, 3.0, 3.0, 1.0])
    shift = _constant([0.0, -6.0, -6.0, 0.0])
    offset = _constant([0.0, 4.0, 4.0, 0.0])
    square = builder.fmul(base, base)
    return builder.fadd(builder.fmul(square, builder.fadd(builder.fmul(factor, base), shift)), offset)


def _constant(four: list[float]) -> Any:
    return ir.Constant(_EIGHT, [ir.Constant(_F64, x) for x in four + four])


def _pick(builder: Any, vector: Any, lanes: list[int]) -> Any:
    mask = ir.Constant(ir.VectorType(_I32, len(lanes)), [ir.Constant(_I32, lane) for lane in lanes])
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), mask)


def _spread(builder: Any, vector: Any, lane: int) -> Any:
    return _pick(builder, vector, [lane] * 4)


def _address(builder: Any, data: Any, place: Any, kind: Any) -> Any:
    return builder.bitcast(builder.gep(data, [place]), kind.as_pointer())


def _load(builder: Any, data: Any, place: Any, kind: Any) -> Any:
    return builder.load(_address(builder, data, place, kind), align=8, typ=kind)
