"""Operations on 64-bit words that processors have and numba has no name for."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

_I64, _I128 = ir.IntType(64), ir.IntType(128)


@intrinsic
def high_product(typing, a, b):  # type: ignore[no-untyped-def]
    """Return the upper 64 bits of the product of two 64-bit words."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        wide = [builder.zext(value, _I128) for value in values]
        return builder.trunc(builder.lshr(builder.mul(*wide), ir.Constant(_I128, 64)), _I64)

    return types.uint64(types.uint64, types.uint64), generate


@intrinsic
def leading_zeros(typing, word):  # type: ignore[no-untyped-def]
    """Return how many bits of a word that is not zero come before the first that is set."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.ctlz(values[0], ir.Constant(ir.IntType(1), 1))

    return types.uint64(types.uint64), generate


@intrinsic
def bits_of(typing, value):  # type: ignore[no-untyped-def]
    """Return the bits of a double."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.bitcast(values[0], _I64)

    return types.uint64(types.float64), generate


@intrinsic
def address_of(typing, data):  # type: ignore[no-untyped-def]
    """Return where the bytes of a contiguous array lie; as long as somebody holds the array.

    Small kernels take this instead of the array: numba counts references to an array at every call, which takes longer
    than to read a digit.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, values[0])
        return builder.ptrtoint(array.data, _I64)

    return types.int64(data), generate


@intrinsic
def byte_at(typing, address, place):  # type: ignore[no-untyped-def]
    """Return the byte at ``place`` from an address; the caller knows that it is there."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointer = builder.inttoptr(builder.add(*values), ir.IntType(8).as_pointer())
        return builder.zext(builder.load(pointer), _I64)

    return types.int64(types.int64, types.int64), generate


@intrinsic
def eight_bytes(typing, address, place):  # type: ignore[no-untyped-def]
    """Return eight bytes from ``place`` as a word, the first the lowest; the caller knows that they are there."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        word = builder.load(builder.inttoptr(builder.add(*values), _I64.as_pointer()))
        word.align = 1
        return word

    return types.uint64(types.int64, types.int64), generate
