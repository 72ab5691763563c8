"""Where lines meet a safe spline: a walk through its cells, and the zeros of a polynomial of degree six in each.

The walk passes over cells whose Bezier nets lie all above or all below the line.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, rows, threads_for
from surfel.bounding.along import blossoms, restrict
from surfel.bounding.bezier import ROUNDING, cell_bounds, cell_planes
from surfel.bounding.occupancy import WHOLE, Quarters, quarter
from surfel.bounding.roots import STACK, WIDTH, zeros
from surfel.core.cast import Floats
from surfel.core.execute import blocks

_SLOTS = 16
"""Hits of a line for which there is room at first; lines with more are walked anew."""

_BLOCK = 1 << 17
_NETS = 1 << 18
_WEIGHT = 20  # a line costs as much as so many plain items


class Sheet(NamedTuple):
    """What a kernel has to know of a spline: coefficients, bounds and planes of its cells, and the trim."""

    coefficients: Floats
    low: Floats
    high: Floats
    planes: Floats
    trim: Quarters

    @classmethod
    def of(cls, coefficients: Floats, trim: Quarters) -> Sheet:
        """Bound the cells, some rows of them at a time: their Bezier nets take much memory."""
        rows, columns = trim.shape
        parts = [coefficients[first : last + 3] for first, last in blocks(rows, max(1, _NETS // columns))]
        low, high = (np.concatenate(side) for side in zip(*map(cell_bounds, parts), strict=True))
        planes = np.concatenate([cell_planes(part) for part in parts])
        return cls(np.array(coefficients), low, high, planes, np.array(trim))


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
        parts.append((found, t[np.arange(t.shape[1]) < found[:, None]]))
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


@rows
def _trace_rows(first, last, sheet, origins, directions, start, found, t):
    weights_u, weights_v = np.empty((4, 4)), np.empty((4, 4))
    c, parts, roots = np.empty(7), np.empty((STACK, WIDTH)), np.empty(8)
    least, most = sheet.low.min(), sheet.high.max()
    span = max(abs(least), abs(most))
    for line in range(first, last):
        found[line] = trace(
            sheet,
            origins[line],
            directions[line],
            start,
            least,
            most,
            span,
            weights_u,
            weights_v,
            c,
            parts,
            roots,
            t[line],
        )


@inlined
def clip(origin, direction, low, high, start, end):
    """Return the part of start .. end in which one coordinate lies between low and high."""
    if direction == 0.0:
        return (start, end) if low <= origin <= high else (1.0, 0.0)
    a, b = (low - origin) / direction, (high - origin) / direction
    return max(start, min(a, b)), min(end, max(a, b))


@inner
def trace(sheet, origin, direction, start, least, most, span, weights_u, weights_v, c, parts, roots, t):
    """Write the first hits of one line, as many as fit, and return how many there are (at least)."""
    cells_u, cells_v = sheet.trim.shape
    du, dv, dw = direction[0], direction[1], direction[2]
    near, far = clip(origin[0], du, 0.0, float(cells_u), start, np.inf)
    near, far = clip(origin[1], dv, 0.0, float(cells_v), near, far)
    near, far = clip(origin[2], dw, least, most, near, far)
    if not near <= far:
        return 0
    # from here on the line starts where it enters: far origins would cost digits
    u, v, w = origin[0] + du * near, origin[1] + dv * near, origin[2] + dw * near
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
        kept = sheet.trim[h, k]
        if kept == 0 or misses(sheet, h, k, u, v, w, du, dv, dw, here, leave):
            touching = False
        else:
            a0, a1 = clamped(u + du * here - h), clamped(u + du * leave - h)
            b0, b1 = clamped(v + dv * here - k), clamped(v + dv * leave - k)
            blossoms(a0, a1, weights_u)
            blossoms(b0, b1, weights_v)
            restrict(sheet.coefficients, h, k, weights_u, weights_v, w_here, w_leave, c)
            tolerance = ROUNDING * (span + max(abs(w_here), abs(w_leave)))
            here_found, touching = zeros(c, tolerance, touching, parts, roots)
            for i in range(min(here_found, len(roots))):
                s = roots[i]
                if kept == WHOLE or (kept & quarter(a0 + s * (a1 - a0), b0 + s * (b1 - b0))) != 0:
                    if count < len(t):
                        t[count] = near + (here + s * (leave - here))
                    count += 1
                elif i == here_found - 1:
                    touching = False  # it was not counted, so the next cell may
            if count and len(t) == 1:
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
def misses(sheet, h, k, u, v, w, du, dv, dw, here, leave):
    """Tell whether a line passes over or under a cell: beyond its heights, or beyond its plane and distances."""
    one, other = w + dw * here, w + dw * leave
    if max(one, other) < sheet.low[h, k] or min(one, other) > sheet.high[h, k]:
        return True
    planes = sheet.planes
    rest = planes[h, k, 0] + planes[h, k, 1] * (u - h) + planes[h, k, 2] * (v - k) - w
    slope = planes[h, k, 1] * du + planes[h, k, 2] * dv - dw
    one, other = rest + slope * here, rest + slope * leave
    return min(one, other) + planes[h, k, 3] > 0.0 or max(one, other) + planes[h, k, 4] < 0.0


@inlined
def clamped(x):
    """Return x, moved into the unit interval."""
    return min(max(x, 0.0), 1.0)
