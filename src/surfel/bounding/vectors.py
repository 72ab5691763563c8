"""Vectors of four and eight numbers in what numba compiles: pieces of :mod:`lanes`, :mod:`runs`, :mod:`compare`."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils

F64, I32, I64 = ir.DoubleType(), ir.IntType(32), ir.IntType(64)
TWO, FOUR, EIGHT = (ir.VectorType(F64, count) for count in (2, 4, 8))
EIGHT_WHOLE, EIGHT_PLACES = ir.VectorType(I32, 8), ir.VectorType(I64, 8)


class Lanes:
    """Eight numbers side by side that formulas can be written with, in what an intrinsic builds."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    def __add__(self, other: Any) -> Lanes:
        return self._joined("fadd", self.value, self._other(other))

    def __radd__(self, other: Any) -> Lanes:
        return self._joined("fadd", self._other(other), self.value)

    def __sub__(self, other: Any) -> Lanes:
        return self._joined("fsub", self.value, self._other(other))

    def __rsub__(self, other: Any) -> Lanes:
        return self._joined("fsub", self._other(other), self.value)

    def __mul__(self, other: Any) -> Lanes:
        return self._joined("fmul", self.value, self._other(other))

    def least(self, other: Any) -> Lanes:
        """Return the lesser of two numbers, lane by lane."""
        right = self._other(other)
        less = self.builder.fcmp_ordered("<", self.value, right)
        return Lanes(self.builder, self.builder.select(less, self.value, right))

    def most(self, other: Any) -> Lanes:
        """Return the larger of two numbers, lane by lane."""
        right = self._other(other)
        more = self.builder.fcmp_ordered(">", self.value, right)
        return Lanes(self.builder, self.builder.select(more, self.value, right))

    def times_plus(self, factor: Any, more: Any) -> Lanes:
        """Return the product with a factor plus something more, rounded once."""
        return Lanes(self.builder, fused(self.builder, self.value, self._other(factor), self._other(more)))

    def floor(self) -> Lanes:
        """Return the largest whole numbers that are not greater."""
        kind = ir.FunctionType(EIGHT, [EIGHT])
        function = cgutils.get_or_insert_function(self.builder.module, kind, "llvm.floor.v8f64")
        return Lanes(self.builder, self.builder.call(function, [self.value]))

    def where(self, bits: Any, other: float) -> Lanes:
        """Return the numbers where a bit is set, another elsewhere."""
        return Lanes(self.builder, self.builder.select(bits, self.value, self._other(other)))

    def at_most(self, other: Any) -> Any:
        """Return eight bits: whether each is at most the other."""
        return self.builder.fcmp_ordered("<=", self.value, self._other(other))

    def whole(self) -> Any:
        """Return the numbers as integers of 32 bits."""
        return self.builder.fptosi(self.value, EIGHT_WHOLE)

    def _joined(self, operation: str, left: Any, right: Any) -> Lanes:
        return Lanes(self.builder, getattr(self.builder, operation)(left, right))

    def _other(self, other: Any) -> Any:
        return other.value if isinstance(other, Lanes) else ir.Constant(EIGHT, [ir.Constant(F64, float(other))] * 8)


class Flat:
    """The memory of a flat array, to be read and written by eight lanes."""

    def __init__(self, context: Any, builder: Any, kind: Any, value: Any) -> None:
        self.builder = builder
        self.data = context.make_array(kind)(context, builder, value).data

    def eight(self, place: Any) -> Lanes:
        """Return the eight numbers from a place on."""
        return Lanes(self.builder, load(self.builder, self.data, self._place(place), EIGHT))

    def number(self, place: Any) -> Any:
        """Return the number at a place."""
        return self.builder.load(self.builder.gep(self.data, [self._place(place)]), align=8, typ=F64)

    def one(self, place: Any) -> Lanes:
        """Return eight times the number at a place."""
        return Lanes(self.builder, every(self.builder, self.number(place)))

    def put(self, place: Any, lanes: Lanes) -> None:
        """Write eight numbers."""
        self.builder.store(lanes.value, address(self.builder, self.data, self._place(place), EIGHT), align=8)

    def put_whole(self, place: Any, whole: Any) -> None:
        """Write integers of 32 bits."""
        self.builder.store(whole, address(self.builder, self.data, self._place(place), whole.type), align=4)

    def _place(self, place: Any) -> Any:
        return ir.Constant(I64, place) if isinstance(place, int) else place


def sums_of(builder: Any, vectors: list[Any]) -> Any:
    """Return the sums of eight vectors as one: neighbours are added in pairs, three times."""
    even, odd = list(range(0, 16, 2)), list(range(1, 16, 2))
    while len(vectors) > 1:
        vectors = [
            builder.fadd(pick_of_two(builder, left, right, even), pick_of_two(builder, left, right, odd))
            for left, right in zip(vectors[::2], vectors[1::2], strict=True)
        ]
    return vectors[0]


def fused(builder: Any, a: Any, b: Any, c: Any) -> Any:
    """Return ``a b + c`` rounded once, of vectors of one length."""
    kind = ir.FunctionType(a.type, [a.type] * 3)
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{a.type.count}f64"), [a, b, c])


def whole_eight(numbers: list[int]) -> Any:
    """Return eight integers of 64 bits."""
    return ir.Constant(EIGHT_PLACES, [ir.Constant(I64, number) for number in numbers])


def every(builder: Any, value: Any) -> Any:
    """Return eight lanes of one number, whole or not."""
    kind = ir.VectorType(value.type, 8)
    lanes = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(I32, 0))
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
