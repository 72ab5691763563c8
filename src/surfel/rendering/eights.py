"""Eights: eight floats that kernels compute with at once, as one vector of the processor.

Runs of pixels in a splat are short, and the compiler leaves loops over so few to the slow way. With these a kernel says
that eight neighbours are meant: ``+ - * /`` and comparisons work on them as on single floats, and a single float stands
for eight equal ones. LLVM lowers that on every machine, with shorter vectors if need be.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, register_model

LANES = 8

_F32, _I32 = ir.FloatType(), ir.IntType(32)
_HALF = ir.VectorType(_F32, LANES // 2)
_VECTOR, _MASK = ir.VectorType(_F32, LANES), ir.VectorType(ir.IntType(1), LANES)


class Eight(types.Type):
    """Eight floats."""

    def __init__(self) -> None:
        super().__init__(name="Eight")


class EightTruths(types.Type):
    """What a comparison of eights says."""

    def __init__(self) -> None:
        super().__init__(name="EightTruths")


_EIGHT, _TRUTHS = Eight(), EightTruths()


@register_model(Eight)
class _EightModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, type_: Any) -> None:
        super().__init__(manager, type_, _VECTOR)


@register_model(EightTruths)
class _TruthsModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, type_: Any) -> None:
        super().__init__(manager, type_, _MASK)


def _widened(builder: Any, value: Any, type_: Any) -> Any:
    """Return eight equal floats for a single one."""
    if type_ is _EIGHT or isinstance(type_, Eight):
        return value
    first = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.Constant(_I32, 0))
    return builder.shuffle_vector(
        first, ir.Constant(_VECTOR, ir.Undefined), ir.Constant(ir.VectorType(_I32, LANES), [0] * LANES)
    )


def _register(function: Callable[..., Any], result: types.Type, made: Callable[[Any, Any, Any], Any]) -> None:
    """Let a Python operator work on eights, and on an eight and a float."""
    pairs = [(_EIGHT, _EIGHT), (_EIGHT, types.float32), (types.float32, _EIGHT)]

    class Template(ConcreteTemplate):  # type: ignore[misc]
        cases = [signature(result, *pair) for pair in pairs]  # noqa: RUF012

    def lowered(_context: Any, builder: Any, sig: Any, values: Any) -> Any:
        one, other = (_widened(builder, value, type_) for value, type_ in zip(values, sig.args, strict=True))
        return made(builder, one, other)

    infer_global(function)(Template)
    for pair in pairs:
        lower_builtin(function, *pair)(lowered)


_register(operator.add, _EIGHT, lambda builder, a, b: builder.fadd(a, b))
_register(operator.sub, _EIGHT, lambda builder, a, b: builder.fsub(a, b))
_register(operator.mul, _EIGHT, lambda builder, a, b: builder.fmul(a, b))
_register(operator.truediv, _EIGHT, lambda builder, a, b: builder.fdiv(a, b))
_register(operator.lt, _TRUTHS, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_register(operator.gt, _TRUTHS, lambda builder, a, b: builder.fcmp_ordered(">", a, b))
_register(operator.le, _TRUTHS, lambda builder, a, b: builder.fcmp_ordered("<=", a, b))
_register(operator.eq, _TRUTHS, lambda builder, a, b: builder.fcmp_ordered("==", a, b))


@infer_global(operator.neg)
class _Negative(ConcreteTemplate):  # type: ignore[misc]
    cases = [signature(_EIGHT, _EIGHT)]  # noqa: RUF012


@lower_builtin(operator.neg, Eight)  # type: ignore[untyped-decorator]
def _negative(_context: Any, builder: Any, _sig: Any, values: Any) -> Any:
    return builder.fsub(ir.Constant(_VECTOR, [ir.Constant(_F32, -0.0)] * LANES), values[0])


@infer_global(operator.and_)
class _And(ConcreteTemplate):  # type: ignore[misc]
    cases = [signature(_TRUTHS, _TRUTHS, _TRUTHS)]  # noqa: RUF012


@lower_builtin(operator.and_, EightTruths, EightTruths)  # type: ignore[untyped-decorator]
def _and(_context: Any, builder: Any, _sig: Any, values: Any) -> Any:
    return builder.and_(*values)


@infer_global(operator.or_)
class _Or(ConcreteTemplate):  # type: ignore[misc]
    cases = [signature(_TRUTHS, _TRUTHS, _TRUTHS)]  # noqa: RUF012


@lower_builtin(operator.or_, EightTruths, EightTruths)  # type: ignore[untyped-decorator]
def _or(_context: Any, builder: Any, _sig: Any, values: Any) -> Any:
    return builder.or_(*values)


@intrinsic
def ramp(typing):  # type: ignore[no-untyped-def]
    """Return 0, 1, ... 7."""

    def generate(_context: Any, _builder: Any, _signature: Any, _values: Any) -> Any:
        return ir.Constant(_VECTOR, [ir.Constant(_F32, float(lane)) for lane in range(LANES)])

    return _EIGHT(), generate


@intrinsic
def load(typing, flat, at):  # type: ignore[no-untyped-def]
    """Return ``flat[at : at + 8]``."""

    def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        return builder.load(_pointer(context, builder, sig, values[0], values[1], _VECTOR), align=4)

    return _EIGHT(flat, types.uint64), generate


@intrinsic
def equal(typing, numbers, at, other):  # type: ignore[no-untyped-def]
    """Return whether ``numbers[at : at + 8]``, of 32 bits, are those from ``other`` on."""

    def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        kind, byte = ir.VectorType(_I32, LANES), ir.IntType(LANES)
        one, two = (
            builder.load(_pointer(context, builder, sig, values[0], place, kind), align=4) for place in values[1:]
        )
        unlike = builder.bitcast(builder.icmp_signed("!=", one, two), byte)
        return builder.icmp_unsigned("==", unlike, ir.Constant(byte, 0))

    return types.boolean(numbers, types.uint64, types.uint64), generate


@intrinsic
def load_fours(typing, flat, at, beside):  # type: ignore[no-untyped-def]
    """Return ``flat[at : at + 4]`` and ``flat[beside : beside + 4]`` as eight."""

    def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        one, other = (
            builder.load(_pointer(context, builder, sig, values[0], place, _HALF), align=4) for place in values[1:]
        )
        return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(_I32, LANES), list(range(LANES))))

    return _EIGHT(flat, types.uint64, types.uint64), generate


@intrinsic
def store(typing, flat, at, eight):  # type: ignore[no-untyped-def]
    """Write eight floats to ``flat[at : at + 8]``."""

    def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        builder.store(values[2], _pointer(context, builder, sig, values[0], values[1], _VECTOR), align=4)
        return context.get_dummy_value()

    return types.void(flat, types.uint64, _EIGHT), generate


@intrinsic
def store_fours(typing, flat, at, beside, eight):  # type: ignore[no-untyped-def]
    """Write four floats to ``flat[at : at + 4]`` and then four to ``flat[beside : beside + 4]``."""

    def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        for first, place in ((0, values[1]), (LANES // 2, values[2])):
            half = _half(builder, values[3], first)
            builder.store(half, _pointer(context, builder, sig, values[0], place, _HALF), align=4)
        return context.get_dummy_value()

    return types.void(flat, types.uint64, types.uint64, _EIGHT), generate


@intrinsic
def add_fours(typing, flat, at, beside, eight):  # type: ignore[no-untyped-def]
    """Add four floats to ``flat[at : at + 4]`` and then four to ``flat[beside : beside + 4]``."""

    def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        for first, place in ((0, values[1]), (LANES // 2, values[2])):
            place = _pointer(context, builder, sig, values[0], place, _HALF)
            sum_ = builder.fadd(builder.load(place, align=4), _half(builder, values[3], first))
            builder.store(sum_, place, align=4)
        return context.get_dummy_value()

    return types.void(flat, types.uint64, types.uint64, _EIGHT), generate


def _half(builder: Any, eight: Any, first: int) -> Any:
    """Return four of eight."""
    lanes = ir.Constant(ir.VectorType(_I32, LANES // 2), list(range(first, first + LANES // 2)))
    return builder.shuffle_vector(eight, ir.Constant(_VECTOR, ir.Undefined), lanes)


def _pointer(context: Any, builder: Any, sig: Any, flat: Any, at: Any, kind: Any) -> Any:
    """Return a pointer to some floats of an array."""
    data = context.make_array(sig.args[0])(context, builder, flat).data
    return builder.bitcast(builder.gep(data, [at]), kind.as_pointer())


@intrinsic
def pick(typing, truths, one, other):  # type: ignore[no-untyped-def]
    """Return ``one`` where something holds and ``other`` elsewhere; a float of floats, else eight."""
    single = isinstance(truths, types.Boolean)

    def generate(_context: Any, builder: Any, sig: Any, values: Any) -> Any:
        if single:
            return builder.select(*values)
        one, other = (_widened(builder, values[k], sig.args[k]) for k in (1, 2))
        return builder.select(values[0], one, other)

    return (types.float32 if single else _EIGHT)(truths, one, other), generate


@intrinsic
def root(typing, eight):  # type: ignore[no-untyped-def]
    """Return the square roots."""

    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.sqrt.v8f32"), values)

    return _EIGHT(eight), generate


@intrinsic
def some(typing, truths):  # type: ignore[no-untyped-def]
    """Return whether any of eight holds."""

    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        byte = ir.IntType(LANES)
        return builder.icmp_unsigned("!=", builder.bitcast(values[0], byte), ir.Constant(byte, 0))

    return types.boolean(truths), generate
