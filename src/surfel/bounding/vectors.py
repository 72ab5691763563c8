"""Vectors of four and eight numbers in what numba compiles: the pieces of :mod:`lanes` and :mod:`runs`."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

F64, I32, I64 = ir.DoubleType(), ir.IntType(32), ir.IntType(64)
FOUR, EIGHT = ir.VectorType(F64, 4), ir.VectorType(F64, 8)


def every(builder: Any, value: Any) -> Any:
    """Return eight lanes of one number."""
    lanes = builder.insert_element(ir.Constant(EIGHT, ir.Undefined), value, ir.Constant(I32, 0))
    return pick(builder, lanes, [0] * 8)


def pick_of_two(builder: Any, left: Any, right: Any, lanes: list[int]) -> Any:
    """Return lanes of two vectors as one."""
    mask = ir.Constant(ir.VectorType(I32, len(lanes)), [ir.Constant(I32, lane) for lane in lanes])
    return builder.shuffle_vector(left, right, mask)


def pick(builder: Any, vector: Any, lanes: list[int]) -> Any:
    """Return lanes of a vector."""
    mask = ir.Constant(ir.VectorType(I32, len(lanes)), [ir.Constant(I32, lane) for lane in lanes])
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), mask)


def three(builder: Any, flat: Any, at: Any) -> list[Any]:
    """Load 24 numbers as three vectors of eight."""
    return [load(builder, flat, builder.add(at, ir.Constant(I64, 8 * part)), EIGHT) for part in range(3)]


def spread(builder: Any, vector: Any, lane: int) -> Any:
    """Return four lanes of one lane of a vector."""
    return pick(builder, vector, [lane] * 4)


def address(builder: Any, data: Any, place: Any, kind: Any) -> Any:
    """Return where a vector begins in the memory of a flat array."""
    return builder.bitcast(builder.gep(data, [place]), kind.as_pointer())


def load(builder: Any, data: Any, place: Any, kind: Any) -> Any:
    """Load a vector from the memory of a flat array."""
    return builder.load(address(builder, data, place, kind), align=8, typ=kind)
