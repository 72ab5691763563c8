"""Filters and sorts of short lists, by whole vectors.

The filters have a plain form for processors and compilers without a vector compress; both give the same bits. The
choice depends on the processor and the compiler alone, as the cache of kernels does: with ``NUMBA_CPU_NAME=generic`` it
is the plain form. The sort is made of operations that every LLVM lowers for every processor.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from surfel._numba import inlined, inner

LANES = 16
RUN = 128

_F32, _I16, _I32, _I64 = ir.FloatType(), ir.IntType(16), ir.IntType(32), ir.IntType(64)
_FLOATS, _INTS = ir.VectorType(_F32, LANES), ir.VectorType(_I32, LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)


def compresses() -> bool:
    """Return whether kernels are compiled for a processor with a vector compress, by an LLVM that can say so."""
    if llvm.llvm_version_info[0] < 19:
        return False  # the generic operation is not known there
    if numba.config.CPU_NAME not in (None, llvm.get_host_cpu_name()):
        return False
    if numba.config.CPU_FEATURES is not None:
        return "+avx512f" in numba.config.CPU_FEATURES
    return bool(llvm.get_host_cpu_features().get("avx512f", False))


@intrinsic
def bits_of(typing, value):  # type: ignore[no-untyped-def]
    """Return the bits of a float32 as an int32."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.bitcast(values[0], _I32)

    return types.int32(types.float32), generate


@intrinsic
def float_of(typing, bits):  # type: ignore[no-untyped-def]
    """Return the float32 that has the bits of an int32."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.bitcast(values[0], _F32)

    return types.float32(types.int32), generate


@inlined
def within_plain(xs, ys, zs, count, x, y, z, limit, mask, keys):
    """Keep the keys, up to ``limit``, of squared distances from (x, y, z); return how many.

    A key holds the bits of the float32 square, which sort as the square does, with those under ``mask`` replaced by the
    number of the slot: keys are all different, and half as much is moved. Coordinates are float32, ``count`` is a
    multiple of 16, ``mask`` is ``2**b - 1 >= count - 1``, and ``keys`` (int32) has room for ``count + 16``.
    """
    for j in range(count):
        dx, dy, dz = xs[j] - x, ys[j] - y, zs[j] - z
        keys[j] = (bits_of((dx * dx + dy * dy) + dz * dz) & ~mask) | j
    kept = 0
    for j in range(count):
        key = keys[j]
        keys[kept] = key
        kept += 1 if key <= limit else 0
    return kept


@inlined
def within_vector(xs, ys, zs, count, x, y, z, limit, mask, keys):
    """Do what :func:`within_plain` does, 16 at a time."""
    kept = 0
    for start in range(0, count, LANES):
        kept = _append_within(xs, ys, zs, start, x, y, z, limit, mask, keys, kept)
    return kept


@inlined
def sort_keys(keys, count, spare, ordered):
    """Write the first ``count`` keys to ``ordered``, ascending; all three (int32) have room for 128 more."""
    if count <= 2 * LANES:
        _sort_32(keys, 0, count, ordered)
    elif count <= 4 * LANES:
        _sort_64(keys, 0, count, ordered)
    else:
        _sort_runs(keys, count, spare, ordered)


@inner
def _sort_runs(keys, count, spare, ordered):
    """Sort runs of 128 in registers, then merge pairs of runs until one is left."""
    length = -(-count // RUN) * RUN
    rounds = 0
    while RUN << rounds < length:
        rounds += 1
    source, target = (spare, ordered) if rounds & 1 else (ordered, spare)  # one swap a round: the last ends in ordered
    for start in range(0, count, RUN):
        _sort_128(keys, start, count, source)
    run = RUN
    while run < length:
        for start in range(0, length, 2 * run):
            i, middle, stop = start, min(start + run, length), min(start + 2 * run, length)
            j = middle
            for k in range(start, stop):
                first = j >= stop or (i < middle and source[i] <= source[j])
                target[k] = source[i] if first else source[j]
                i += 1 if first else 0
                j += 0 if first else 1
        source, target = target, source
        run *= 2


@inlined
def children_plain(nodes, node, base, lx, ly, lz, hx, hy, hz, square, found, kept):
    """Append those of the eight children of a node whose boxes lie within sqrt(square) of a box; return the new length.

    A node is 48 floats: the low x of its children, low y, low z, high x, high y, high z. Its children are numbered from
    ``base``; ``found`` (int32) has room for eight more.
    """
    first = np.uint64(node) * np.uint64(48)
    for child in range(8):
        here = first + np.uint64(child)
        dx = max(max(nodes[here] - hx, lx - nodes[here + np.uint64(24)]), 0.0)
        dy = max(max(nodes[here + np.uint64(8)] - hy, ly - nodes[here + np.uint64(32)]), 0.0)
        dz = max(max(nodes[here + np.uint64(16)] - hz, lz - nodes[here + np.uint64(40)]), 0.0)
        found[kept] = base + child
        kept += 1 if (dx * dx + dy * dy) + dz * dz <= square else 0
    return kept


def _splat(builder: Any, value: Any, kind: Any) -> Any:
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, _I32(0))
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), ir.Constant(_INTS, [_I32(0)] * LANES))


def _lanes(builder: Any, start: Any) -> Any:
    """Return start, start + 1, ... start + 15."""
    return builder.add(ir.Constant(_INTS, [_I32(k) for k in range(LANES)]), _splat(builder, start, _INTS))


def _vector_at(context: Any, builder: Any, kind: Any, array: Any, place: Any, vector: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [place]), vector.as_pointer())


def _call(builder: Any, name: str, result: Any, *arguments: Any) -> Any:
    kind = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)


def _compress(builder: Any, vector: Any, mask: Any) -> Any:
    """Return the chosen lanes of an integer vector, moved to the front."""
    name = f"llvm.experimental.vector.compress.v{vector.type.count}i32"
    return _call(builder, name, vector.type, vector, mask, ir.Constant(vector.type, ir.Undefined))


@intrinsic
def _append_within(typing, xs, ys, zs, start, x, y, z, limit, mask, keys, kept):  # type: ignore[no-untyped-def]
    """Append those of 16 keys that are within the limit; return the new length."""
    signature = types.int64(xs, ys, zs, start, x, y, z, limit, mask, keys, kept)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        def cast(k: int, kind: Any) -> Any:
            return context.cast(builder, values[k], signature.args[k], kind)

        def pointer(k: int, place: Any, vector: Any) -> Any:
            return _vector_at(context, builder, signature.args[k], values[k], place, vector)

        first, length = cast(3, types.int64), cast(10, types.int64)
        square = None
        for axis in range(3):
            there = builder.load(pointer(axis, first, _FLOATS), align=4)
            gap = builder.fsub(there, _splat(builder, cast(4 + axis, types.float32), _FLOATS))
            product = builder.fmul(gap, gap)
            square = product if square is None else builder.fadd(square, product)
        high = builder.and_(builder.bitcast(square, _INTS), _splat(builder, builder.not_(cast(8, types.int32)), _INTS))
        found = builder.or_(high, _lanes(builder, builder.trunc(first, _I32)))
        near = builder.icmp_signed("<=", found, _splat(builder, cast(7, types.int32), _INTS))
        packed = _compress(builder, found, near)
        builder.store(packed, pointer(9, length, _INTS), align=4)
        number = _call(builder, "llvm.ctpop.i16", _I16, builder.bitcast(near, _I16))
        return builder.add(length, builder.zext(number, _I64))

    return signature, generate


def _sorter(vectors: int) -> Any:
    """Return an intrinsic that sorts 16 times ``vectors`` keys by Batcher's bitonic network.

    Those from ``count`` on are taken as the largest.
    """

    @intrinsic
    def sort(typing, keys, start, count, ordered):  # type: ignore[no-untyped-def]
        signature = types.void(keys, start, count, ordered)

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            first = context.cast(builder, values[1], signature.args[1], types.int64)
            length = builder.trunc(context.cast(builder, values[2], signature.args[2], types.int64), _I32)
            starts = [builder.add(first, _I64(LANES * v)) for v in range(vectors)]
            registers = []
            for start in starts:
                place = _vector_at(context, builder, signature.args[0], values[0], start, _INTS)
                lanes = _lanes(builder, builder.trunc(start, _I32))
                taken = builder.icmp_signed("<", lanes, _splat(builder, length, _INTS))
                unused = ir.Constant(_INTS, [_I32(2**31 - 1)] * LANES)
                registers.append(builder.select(taken, builder.load(place, align=4), unused))
            run = 2
            while run <= LANES * vectors:
                gap = run // 2
                while gap:
                    registers = _exchange(builder, registers, run, gap)
                    gap //= 2
                run *= 2
            for start, register in zip(starts, registers, strict=True):
                place = _vector_at(context, builder, signature.args[3], values[3], start, _INTS)
                builder.store(register, place, align=4)
            return context.get_dummy_value()

        return signature, generate

    return sort


def _exchange(builder: Any, registers: list[Any], run: int, gap: int) -> list[Any]:
    """Compare and exchange keys ``gap`` apart, ascending or descending by runs: one step of the network."""
    if gap >= LANES:
        result = list(registers)
        for v in range(len(registers)):
            w = v ^ (gap // LANES)
            if v < w:
                less = _minimum(builder, registers[v], registers[w])
                more = _maximum(builder, registers[v], registers[w])
                result[v], result[w] = (less, more) if LANES * v & run == 0 else (more, less)
        return result
    mixed = ir.Constant(_INTS, [_I32(k ^ gap) for k in range(LANES)])
    result = []
    for v, register in enumerate(registers):
        other = builder.shuffle_vector(register, register, mixed)
        lower = [(k & gap == 0) == ((LANES * v + k) & run == 0) for k in range(LANES)]
        mask = ir.Constant(_BITS, [ir.IntType(1)(int(bit)) for bit in lower])
        result.append(builder.select(mask, _minimum(builder, register, other), _maximum(builder, register, other)))
    return result


def _minimum(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.icmp_signed("<", a, b), a, b)


def _maximum(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.icmp_signed(">", a, b), a, b)


_sort_32, _sort_64, _sort_128 = _sorter(2), _sorter(4), _sorter(8)


@intrinsic
def children_vector(typing, nodes, node, base, lx, ly, lz, hx, hy, hz, square, found, kept):  # type: ignore[no-untyped-def]
    """Do what :func:`children_plain` does, all eight at a time."""
    signature = types.int64(nodes, node, base, lx, ly, lz, hx, hy, hz, square, found, kept)
    doubles, ints = ir.VectorType(ir.DoubleType(), 8), ir.VectorType(_I32, 8)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        def splat(value: Any) -> Any:
            first = builder.insert_element(ir.Constant(doubles, ir.Undefined), value, _I32(0))
            return builder.shuffle_vector(first, ir.Constant(doubles, ir.Undefined), ir.Constant(ints, [_I32(0)] * 8))

        def larger(a: Any, b: Any) -> Any:
            return builder.select(builder.fcmp_ordered(">", a, b), a, b)

        first = builder.mul(context.cast(builder, values[1], signature.args[1], types.int64), _I64(48))
        corners = []
        for side in range(6):
            place = builder.add(first, _I64(8 * side))
            at = _vector_at(context, builder, signature.args[0], values[0], place, doubles)
            corners.append(builder.load(at, align=8))
        total = None
        for axis in range(3):
            under = builder.fsub(corners[axis], splat(values[6 + axis]))
            over = builder.fsub(splat(values[3 + axis]), corners[3 + axis])
            gap = larger(larger(under, over), ir.Constant(doubles, [ir.Constant(ir.DoubleType(), 0.0)] * 8))
            product = builder.fmul(gap, gap)
            total = product if total is None else builder.fadd(total, product)
        near = builder.fcmp_ordered("<=", total, splat(values[9]))
        base = builder.trunc(context.cast(builder, values[2], signature.args[2], types.int64), _I32)
        offset = builder.insert_element(ir.Constant(ints, ir.Undefined), base, _I32(0))
        offset = builder.shuffle_vector(offset, ir.Constant(ints, ir.Undefined), ir.Constant(ints, [_I32(0)] * 8))
        numbers = builder.add(ir.Constant(ints, [_I32(k) for k in range(8)]), offset)
        packed = _compress(builder, numbers, near)
        length = context.cast(builder, values[11], signature.args[11], types.int64)
        builder.store(packed, _vector_at(context, builder, signature.args[10], values[10], length, ints), align=4)
        i8 = ir.IntType(8)
        number = _call(builder, "llvm.ctpop.i8", i8, builder.bitcast(near, i8))
        return builder.add(length, builder.zext(number, _I64))

    return signature, generate


VECTOR = compresses()
within = within_vector if VECTOR else within_plain
children_within = children_vector if VECTOR else children_plain
