"""Where lines meet a safe spline: a walk through its cells, and the zeros of a polynomial of degree six in each.

The walk passes over cells whose Bezier nets lie all above or all below the line.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel, rows, threads_for
from surfel.bounding.along import restrict
from surfel.bounding.bezier import ROUNDING, cell_bounds, cell_planes
from surfel.bounding.occupancy import WHOLE, Quarters, quarter
from surfel.bounding.roots import ALL_ABOVE, ALL_BELOW, ENOUGH, STACK, WIDTH, change_once, zero_between, zeros
from surfel.core.cast import Floats
from surfel.core.execute import blocks

_SLOTS = 16
"""Hits of a line for which there is room at first; lines with more are walked anew."""

_BLOCK = 1 << 17
_NETS = 1 << 18
_WEIGHT = 20  # a line costs as much as so many plain items


class Sheet(NamedTuple):
    """What a kernel has to know of a spline: coefficients, bounds of its cells, the trim.

    In ``table`` each cell has eight numbers side by side: its plane and how far the spline lies below and above that
    (:func:`surfel.bounding.bezier.cell_planes`), its least and largest height, its trim.
    """

    coefficients: Floats
    low: Floats
    high: Floats
    table: Floats
    trim: Quarters

    @classmethod
    def of(cls, coefficients: Floats, trim: Quarters) -> Sheet:
        """Bound the cells, some rows of them at a time: their Bezier nets take much memory."""
        rows, columns = trim.shape
        parts = [coefficients[first : last + 3] for first, last in blocks(rows, max(1, _NETS // columns))]
        low, high = (np.concatenate(side) for side in zip(*map(cell_bounds, parts), strict=True))
        planes = np.concatenate([cell_planes(part) for part in parts])
        table = np.concatenate([planes, np.stack([low, high, trim], axis=-1)], axis=-1)
        return cls(np.array(coefficients), low, high, table, np.array(trim))


class Hits(NamedTuple):
    """Hits in compressed rows: those of line l are ``t[offsets[l] : offsets[l + 1]]``, ascending."""

    offsets: NDArray[np.int64]
    t: Floats


def find_hits(sheet: Sheet, origins: Floats, directions: Floats, start: float, *, first_only: bool) -> Hits:
    """Find where lines meet a spline.

    Parameters
    ----------
    sheet : Sheet
        The spline.
    origins, directions : Floats, shape (m, 3)
        In the coordinates of the domain (two along the cells, one along the height); t counts directions.
    start : float
        Nothing before this t: 0 for rays, minus infinity for lines.
    first_only : bool
        Only the first hit of each.

    Returns
    -------
    Hits
        For every line.
    """
    slots, parts = 1 if first_only else _SLOTS, []
    for first, last in blocks(len(origins), _BLOCK):
        found, t = _trace(sheet, origins[first:last], directions[first:last], start, slots)
        if first_only:
            found = np.minimum(found, 1)
        elif int(found.max()) > slots:
            many, few = np.flatnonzero(found > slots), t
            t = np.empty((last - first, int(found.max())))
            t[:, :slots] = few
            t[many] = _trace(sheet, origins[first:last][many], directions[first:last][many], start, t.shape[1])[1]
        packed = np.empty(int(found.sum()))
        _pack(found, t, packed)
        parts.append((found, packed))
    found = np.concatenate([np.zeros(1, np.int64), *(part[0] for part in parts)])
    return Hits(np.cumsum(found), np.concatenate([np.empty(0), *(part[1] for part in parts)]))


def _trace(
    sheet: Sheet, origins: Floats, directions: Floats, start: float, slots: int
) -> tuple[NDArray[np.int64], Floats]:
    found = np.zeros(len(origins), np.int64)
    t = np.empty((len(origins), slots))
    with threads_for(_WEIGHT * len(origins)):
        _trace_rows(len(origins), sheet, np.array(origins), np.array(directions), float(start), found, t)
    return found, t


@kernel
def _pack(found, t, out):
    at = 0
    for line in range(found.shape[0]):
        for i in range(found[line]):
            out[at] = t[line, i]
            at += 1


@rows
def _trace_rows(first, last, sheet, origins, directions, start, found, t):
    flat, table, c = sheet.coefficients.ravel(), sheet.table.ravel(), np.empty(8)
    parts, roots = np.empty((STACK, WIDTH)), np.empty(8)
    least, most = sheet.low.min(), sheet.high.max()
    span = max(abs(least), abs(most))
    for line in range(first, last):
        found[line] = trace(
            sheet.trim,
            origins,
            directions,
            line,
            start,
            least,
            most,
            span,
            flat,
            table,
            c,
            parts,
            roots,
            t,
        )


@inlined
def clip(origin, direction, low, high, start, end):
    """Return the part of start .. end in which one coordinate lies between low and high."""
    if direction == 0.0:
        return (start, end) if low <= origin <= high else (1.0, 0.0)
    a, b = (low - origin) / direction, (high - origin) / direction
    return max(start, min(a, b)), min(end, max(a, b))


@inlined
def trace(trim, origins, directions, line, start, least, most, span, flat, table, c, parts, roots, t):
    """Write the first hits of one line, as many as fit, and return how many there are (at least)."""
    cells_u, cells_v = trim.shape
    slots = t.shape[1]
    x, y, z = origins[line, 0], origins[line, 1], origins[line, 2]
    du, dv, dw = directions[line, 0], directions[line, 1], directions[line, 2]
    near, far = clip(x, du, 0.0, float(cells_u), start, np.inf)
    near, far = clip(y, dv, 0.0, float(cells_v), near, far)
    near, far = clip(z, dw, least, most, near, far)
    if not near <= far:
        return 0
    # from here on the line starts where it enters: far origins would cost digits
    u, v, w = x + du * near, y + dv * near, z + dw * near
    end = far - near
    h = min(max(int(u), 0), cells_u - 1)
    k = min(max(int(v), 0), cells_v - 1)
    count = 0
    here, touching = 0.0, False
    step_u, step_v = (1 if du > 0.0 else -1), (1 if dv > 0.0 else -1)
    ahead_u, ahead_v = max(step_u, 0) - u, max(step_v, 0) - v
    slow_u, slow_v = (1.0 / du if du != 0.0 else np.inf), (1.0 / dv if dv != 0.0 else np.inf)
    while True:
        leave_u = (h + ahead_u) * slow_u if du != 0.0 else np.inf
        leave_v = (k + ahead_v) * slow_v if dv != 0.0 else np.inf
        leave = max(min(min(leave_u, leave_v), end), here)
        w_here, w_leave = w + dw * here, w + dw * leave
        place = 8 * (h * cells_v + k)
        p, q, r = table[place], table[place + 1], table[place + 2]
        rest, slope = p + q * (u - h) + r * (v - k) - w, q * du + r * dv - dw
        one, other = rest + slope * here, rest + slope * leave
        kept = np.uint8(table[place + 7])
        misses = (kept == 0) | (max(w_here, w_leave) < table[place + 5]) | (min(w_here, w_leave) > table[place + 6])
        if misses | (min(one, other) + table[place + 3] > 0.0) | (max(one, other) + table[place + 4] < 0.0):
            touching = False
        else:
            a0, a1 = clamped(u + du * here - h), clamped(u + du * leave - h)
            b0, b1 = clamped(v + dv * here - k), clamped(v + dv * leave - k)
            tolerance = ROUNDING * (span + max(abs(w_here), abs(w_leave)))
            signs = restrict(flat, h * (cells_v + 3) + k, cells_v + 3, a0, a1, b0, b1, w_here, w_leave, tolerance, c)
            if signs in (ALL_ABOVE, ALL_BELOW):
                here_found, touching = 0, False
            elif change_once(signs):
                s, rising = c[0] / (c[0] - c[6]), c[6] > 0.0
                roots[0] = zero_between(
                    c[0], c[1], c[2], c[3], c[4], c[5], c[6], 0.0, s, 1.0, rising, ENOUGH * tolerance
                )
                here_found, touching = 1, False
            else:
                here_found, touching = zeros(c, tolerance, touching, parts, roots)
            for i in range(min(here_found, len(roots))):
                s = roots[i]
                if kept == WHOLE or (kept & quarter(a0 + s * (a1 - a0), b0 + s * (b1 - b0))) != 0:
                    if count < slots:
                        t[line, count] = near + (here + s * (leave - here))
                    count += 1
                elif i == here_found - 1:
                    touching = False  # it was not counted, so the next cell may
            if count and slots == 1:
                return count
        if leave >= end:
            return count
        if leave_u <= leave:
            h += step_u
        if leave_v <= leave:
            k += step_v
        if h < 0 or h >= cells_u or k < 0 or k >= cells_v:
            return count
        here = leave


@inlined
def clamped(x):
    """Return x, moved into the unit interval."""
    return min(max(x, 0.0), 1.0)
