"""Eight points at a time beside the spline of their cell: places, values, residuals and sums, by whole vectors.

The formulas are those of ``frame.project`` and ``evaluate.value_in``, rounded alike: the numbers are the same to the
last bit. Scratch is one flat array ``w`` of ``ROWS * BLOCK`` numbers, so that the compiler sees that its rows do not
overlap. What a cell needs lies in a flat array ``c``: the numbers of the frame (its height axis times the sign), and
from ``NET`` on the 16 coefficients.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from surfel.bounding.vectors import (
    EIGHT_WHOLE,
    I32,
    I64,
    Flat,
    Lanes,
    every,
    pick_of_two,
    three,
    whole_eight,
)

BLOCK = 120
"""Points that are worked on together: their scratch stays in the first cache. No power of two: the rows would then meet
in the same few places of that cache."""

ROWS = 4
LOCAL_U, LOCAL_V, HEIGHT, RESIDUAL = range(ROWS)

AXIS_U, AXIS_V, AXIS_Z, LOW_U, LOW_V, SCALE_U, SCALE_V, CELL_U, CELL_V = 0, 3, 6, 9, 10, 11, 12, 13, 14
CELLS_U, CELLS_V = 13, 14
SPLIT, WIDE, NET = 15, 16, 17
CONSTANTS = NET + 16
"""Places in ``c``; in the numbers of a frame those of a cell are the numbers of cells."""

SUM_Z, SUM_R, LEAST_R = 16, 17, 18
SUMS = 19
"""Rows of eight: the 16 products of weights, the heights, the residuals, and the least residual."""


@intrinsic
def cells_of_eight(typing, p, at, f, places, lane):  # type: ignore[no-untyped-def]
    """Write the cells, counted in rows along v, of the eight points from ``p[at]`` on to ``places[lane]``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, frame, whole = (Flat(context, builder, signature.args[i], values[i]) for i in (0, 2, 3))
        (h, _), (k, _) = _places(frame, *_columns(builder, flat, values[1]))
        whole.put_whole(values[4], h.times_plus(frame.one(CELLS_V), k).whole())
        return context.get_dummy_value()

    return types.void(p, types.int64, f, places, types.int64), generate


@intrinsic
def micro_cells_of_eight(typing, p, at, f, split, places, w, lane):  # type: ignore[no-untyped-def]
    """Write micro-cells as :func:`cells_of_eight` does cells, ``split`` a side of each, and heights to ``w[lane]``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, frame, whole, out = (Flat(context, builder, signature.args[i], values[i]) for i in (0, 2, 4, 5))
        split = Lanes(builder, every(builder, values[3]))
        x, y, z = _columns(builder, flat, values[1])
        a, b = (cell * split + _part(local, split) for cell, local in _places(frame, x, y, z))
        whole.put_whole(values[6], (a * (frame.one(CELLS_V) * split) + b).whole())
        out.put(values[6], _along(frame, AXIS_Z, x, y, z))
        return context.get_dummy_value()

    i = types.int64
    return types.void(p, i, f, types.float64, places, w, i), generate


@intrinsic
def place_eight(typing, p, rank, first, at, count, w, lane, c):  # type: ignore[no-untyped-def]
    """Fill LOCAL_U, LOCAL_V and HEIGHT for eight of the ``count`` points of one cell that are worked on.

    They are those of number ``first + rank[first + at + lane]`` and the seven that follow in ``rank``.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, rank, rows, cell = (Flat(context, builder, signature.args[i], values[i]) for i in (0, 1, 5, 7))
        _placed(flat, rank, values[2], values[3], values[4], rows, values[6], cell)
        return context.get_dummy_value()

    i = types.int64
    return types.void(p, rank, i, i, i, w, i, c), generate


@intrinsic
def compare_eight(typing, p, rank, first, at, count, w, lane, c, marks, sums):  # type: ignore[no-untyped-def]
    """Fill all rows for eight points of one cell, as :func:`place_eight` takes them.

    ``marks[lane]`` is where each point's micro-cell lies, counted from the cell's first in rows of WIDE; in
    ``marks[BLOCK : BLOCK + 8]`` the quarters of the cell are collected. Rows SUM_Z, SUM_R, LEAST_R of ``sums`` go on.
    """
    i = types.int64
    return types.void(p, rank, i, i, i, w, i, c, marks, sums), _comparison(weigh=False)


@intrinsic
def compare_and_weigh_eight(typing, p, rank, first, at, count, w, lane, c, marks, sums):  # type: ignore[no-untyped-def]
    """Compare, and add the 16 products of six times the weights of the points to rows 0 to 15."""
    i = types.int64
    return types.void(p, rank, i, i, i, w, i, c, marks, sums), _comparison(weigh=True)


def _comparison(*, weigh: bool) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flat, rank, rows, cell, whole, total = (
            Flat(context, builder, signature.args[i], values[i]) for i in (0, 1, 5, 7, 8, 9)
        )
        lane = values[6]
        counted, s, t, height = _placed(flat, rank, values[2], values[3], values[4], rows, lane, cell)
        along_u, along_v = _weights(s), _weights(t)
        residual = height - _value(cell, along_u, along_v)
        rows.put(_row(builder, RESIDUAL, lane), residual)
        a, b = (_part(local, cell.one(SPLIT)) for local in (s, t))
        whole.put_whole(lane, a.times_plus(cell.one(WIDE), b).whole())
        whole.put_whole(BLOCK, builder.or_(whole.eight_whole(BLOCK), _quarters(builder, s, t)))
        total.put(8 * SUM_Z, total.eight(8 * SUM_Z) + height.where(counted, 0.0))
        total.put(8 * SUM_R, total.eight(8 * SUM_R) + residual.where(counted, 0.0))
        total.put(8 * LEAST_R, residual.least(total.eight(8 * LEAST_R)))
        if weigh:
            along_v = [weight.where(counted, 0.0) for weight in along_v]
            for i in range(4):
                for j in range(4):
                    at = 8 * (4 * i + j)
                    total.put(at, along_u[i].times_plus(along_v[j], total.eight(at)))
        return context.get_dummy_value()

    return generate


def _placed(
    flat: Flat, rank: Flat, first: Any, at: Any, count: Any, rows: Flat, lane: Any, cell: Flat
) -> tuple[Any, Lanes, Lanes, Lanes]:
    """Fill the local coordinates and the height for eight points; return which there are, and these three."""
    builder = rows.builder
    counted = builder.icmp_signed(
        "<", builder.add(every(builder, lane), whole_eight(list(range(8)))), every(builder, count)
    )
    begin, last = builder.add(first, at), builder.sub(count, ir.Constant(I64, 1))
    places = []
    for i in range(8):  # lanes behind the last point repeat it
        number = builder.add(lane, ir.Constant(I64, i))
        number = builder.select(builder.icmp_signed("<", number, last), number, last)
        ranked = builder.load(builder.gep(rank.data, [builder.add(begin, number)]), align=4, typ=I32)
        places.append(builder.mul(builder.add(first, builder.sext(ranked, I64)), ir.Constant(I64, 3)))
    x, y, z = (flat.taken([builder.add(place, ir.Constant(I64, axis)) for place in places]) for axis in range(3))
    s = _place(cell, AXIS_U, LOW_U, SCALE_U, x, y, z) - cell.one(CELL_U)
    t = _place(cell, AXIS_V, LOW_V, SCALE_V, x, y, z) - cell.one(CELL_V)
    height = _along(cell, AXIS_Z, x, y, z)
    for number, lanes in ((LOCAL_U, s), (LOCAL_V, t), (HEIGHT, height)):
        rows.put(_row(builder, number, lane), lanes)
    return counted, s, t, height


def _row(builder: Any, number: int, lane: Any) -> Any:
    """Return where the eight lanes from one on lie in a row of scratch."""
    return builder.add(lane, ir.Constant(I64, number * BLOCK))


def _weights(t: Lanes) -> list[Lanes]:
    q = 1.0 - t
    t2, q2 = t * t, q * q
    return [q2 * q, t2.times_plus(t.times_plus(3.0, -6.0), 4.0), q2.times_plus(q.times_plus(3.0, -6.0), 4.0), t2 * t]


def _value(cell: Flat, along_u: list[Lanes], along_v: list[Lanes]) -> Lanes:
    columns = []
    for j in range(4):
        column = along_u[0] * cell.one(NET + j)
        for i in range(1, 4):
            column = along_u[i].times_plus(cell.one(NET + 4 * i + j), column)
        columns.append(column)
    total = along_v[0] * columns[0]
    for j in range(1, 4):
        total = along_v[j].times_plus(columns[j], total)
    return total * (1.0 / 36.0)


def _quarters(builder: Any, s: Lanes, t: Lanes) -> Any:
    bits = [ir.Constant(EIGHT_WHOLE, [ir.Constant(I32, bit)] * 8) for bit in (4, 2, 1, 8)]
    below, early = t.at_most(s), t.at_most(1.0 - s)
    return builder.select(below, builder.select(early, bits[0], bits[1]), builder.select(early, bits[2], bits[3]))


def _part(local: Lanes, split: Lanes) -> Lanes:
    """Return the micro-cell along one axis."""
    return (local * split).floor().least(split - 1.0)


def _places(frame: Flat, x: Lanes, y: Lanes, z: Lanes) -> list[tuple[Lanes, Lanes]]:
    """Return the cell and the local coordinate along u, and along v."""
    found = []
    for axis, low, scale, cells in ((AXIS_U, LOW_U, SCALE_U, CELLS_U), (AXIS_V, LOW_V, SCALE_V, CELLS_V)):
        place = _place(frame, axis, low, scale, x, y, z)
        cell = place.floor().least(frame.one(cells) - 1.0)
        found.append((cell, place - cell))
    return found


def _place(frame: Flat, axis: int, low: int, scale: int, x: Lanes, y: Lanes, z: Lanes) -> Lanes:
    return (_along(frame, axis, x, y, z) - frame.one(low)) * frame.one(scale)


def _along(frame: Flat, axis: int, x: Lanes, y: Lanes, z: Lanes) -> Lanes:
    return frame.one(axis) * x + frame.one(axis + 1) * y + frame.one(axis + 2) * z


def _columns(builder: Any, flat: Flat, at: Any) -> list[Lanes]:
    """Return x, y and z of the eight points that begin at a place."""
    first, second, third = three(builder, flat.data, at)
    columns = []
    for axis in range(3):
        lanes = [i for i in range(axis, 24, 3) if i < 16]
        both = pick_of_two(builder, first, second, lanes + [0] * (8 - len(lanes)))
        rest = [8 + i - 16 for i in range(axis, 24, 3) if i >= 16]
        columns.append(Lanes(builder, pick_of_two(builder, both, third, [*range(8 - len(rest)), *rest])))
    return columns
