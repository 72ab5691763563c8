"""A spline along a line in one cell: a polynomial of degree six, by its Bernstein coefficients.

They come from blossoms of the B-spline weights at the ends of the line's piece in the cell, by whole vectors.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from surfel.bounding.vectors import EIGHT, F64, FOUR, I32, I64, Flat, Lanes, every, fused, pick, pick_of_two

_BELOW = [1.0, 1.0 / 6.0, 1.0 / 15.0, 1.0 / 20.0, 1.0 / 15.0, 1.0 / 6.0, 1.0, 0.0]
"""One over the binomial coefficients of degree six, and a last place of no use."""


@intrinsic
def restrict(typing, b, place, width, a0, a1, b0, b1, w0, w1, tolerance, c):  # type: ignore[no-untyped-def]
    """Write the Bernstein coefficients of the spline minus the height of the line, along the line in one cell.

    Returns one bit for each that lies above the tolerance, the lowest for the first, and from bit 8 on one for each
    that lies below minus the tolerance; at the tolerance counts, too.

    The 16 coefficients of the cell begin at ``place`` in the flat ``b``, in rows of ``width``. The line runs from
    (a0, b0) to (a1, b1) in local coordinates and from w0 to w1 in height. The product of the Bernstein polynomials i
    and j of degree three is C(3, i) C(3, j) / C(6, i + j) times that of degree six and number i + j. ``c`` has room for
    eight.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, out = (Flat(context, builder, signature.args[i], values[i]) for i in (0, 10))
        _, place, width, a0, a1, b0, b1, w0, w1, tolerance, _ = values
        weights = _blossoms(builder, a0, a1, b0, b1)
        along_v = [pick(builder, weight.value, [4, 5, 6, 7]) for weight in weights]
        rows = []
        for _ in range(4):
            total = None
            for q in range(4):
                number = flat.number(builder.add(place, ir.Constant(I64, q)))
                number = _four(builder, [number])
                total = builder.fmul(number, along_v[q]) if total is None else fused(builder, number, along_v[q], total)
            rows.append(total)
            place = builder.add(place, width)
        sums = Lanes(builder, _constant([0.0] * 8))
        for i in range(4):
            column = None
            for p in range(4):
                weight = pick(builder, weights[p].value, [i] * 4)
                column = builder.fmul(weight, rows[p]) if column is None else fused(builder, weight, rows[p], column)
            many = 3.0 if 0 < i < 3 else 1.0
            column = builder.fmul(column, ir.Constant(FOUR, [ir.Constant(F64, many * x) for x in (1.0, 3.0, 3.0, 1.0)]))
            lanes = [j - i if 0 <= j - i < 4 else 4 for j in range(8)]
            placed = Lanes(builder, pick_of_two(builder, column, ir.Constant(FOUR, [ir.Constant(F64, 0.0)] * 4), lanes))
            sums = sums + placed
        start, end = (Lanes(builder, pick(builder, _four(builder, [w]), [0] * 8)) for w in (w0, w1))
        height = (end - start) * Lanes(builder, _constant([i / 6.0 for i in range(8)])) + start
        coefficients = sums * Lanes(builder, _constant(_BELOW)) - height
        out.put(0, coefficients)
        limit = Lanes(builder, every(builder, tolerance))
        below = _bits(builder, coefficients.at_most(0.0 - limit))
        return builder.or_(_bits(builder, limit.at_most(coefficients)), builder.shl(below, ir.Constant(I64, 8)))

    f, i = types.float64, types.int64
    return i(b, i, i, f, f, f, f, f, f, f, c), generate


@intrinsic
def times_plus(typing, x, y, z):  # type: ignore[no-untyped-def]
    """Return ``x y + z`` of three numbers, rounded once: half the wait of a product and a sum."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.fma(*values)

    f = types.float64
    return f(f, f, f), generate


def _blossoms(builder: Any, a0: Any, a1: Any, b0: Any, b1: Any) -> list[Lanes]:
    """Return the weights of four B-spline coefficients in the four Bernstein coefficients on [a0, a1] and on [b0, b1].

    They are blossoms at (a0, a0, a0), (a0, a0, a1), (a0, a1, a1), (a1, a1, a1) (de Boor), those of u before those of v.
    """
    ends = _four(builder, [a0, a1, b0, b1])
    r, s, t = (
        Lanes(builder, pick(builder, ends, lanes))
        for lanes in ([0, 0, 0, 1, 2, 2, 2, 3], [0, 0, 1, 1, 2, 2, 3, 3], [0, 1, 1, 1, 2, 3, 3, 3])
    )
    third = 1.0 / 3.0
    a, b, c = (1.0 - r) * third, (2.0 - r) * third, (3.0 - r) * third
    p1, p2 = (1.0 - s) * (1.0 - t) * 0.5, (1.0 + s) * (1.0 - t) * 0.5
    q1, q2 = (2.0 - s) * t * 0.5, s * t * 0.5
    middle = p2 + q1
    return [p1 * a, p1 * (1.0 - a) + middle * b, middle * (1.0 - b) + q2 * c, q2 * (1.0 - c)]


def _four(builder: Any, numbers: list[Any]) -> Any:
    """Return four lanes of four numbers, or of one."""
    value = ir.Constant(FOUR, ir.Undefined)
    for lane, number in enumerate(numbers):
        value = builder.insert_element(value, number, ir.Constant(I32, lane))
    return value if len(numbers) > 1 else pick(builder, value, [0] * 4)


def _bits(builder: Any, eight: Any) -> Any:
    """Return the first seven of eight bits as a whole number."""
    bits = builder.zext(builder.bitcast(eight, ir.IntType(8)), I64)
    return builder.and_(bits, ir.Constant(I64, 127))


def _constant(eight: list[float]) -> Any:
    return ir.Constant(EIGHT, [ir.Constant(F64, x) for x in eight])
