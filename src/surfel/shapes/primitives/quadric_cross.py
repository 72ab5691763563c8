"""Where lines cross a quadric in its canonical frame: a x^2 + b y^2 + c z^2 + d z + e <= 0 inside."""

from __future__ import annotations

import math

import numpy as np

from surfel._numba import inlined, rows, threads_for
from surfel.core.cast import Floats
from surfel.core.crossings import Crossings
from surfel.core.lines import Lines
from surfel.roots.quadratic import cross_quadric
from surfel.shapes.primitives.approach import approach
from surfel.shapes.primitives.gather import gather, readable

_REACH = 64.0  # sizes from which the way to the solid is summed with its rounding errors
_WORK = 8  # a line is as much work as this many items of a simple loop


def cross_canonical(lines: Lines, inverse: Floats, form: Floats) -> Crossings:
    """Return the events of every line; they begin at -inf where the line comes from inside, and end likewise.

    Parameters
    ----------
    lines : Lines
        In the world.
    inverse : Floats, shape (3, 4)
        From the world to the canonical frame, in which the solid is of the size of one.
    form : Floats, shape (5,)
        a, b, c, d, e.
    """
    m = len(lines)
    counts, t, cosine = np.empty(m, np.int32), np.empty((m, 4)), np.empty((m, 4))
    with threads_for(_WORK * m):
        _cross(m, np.array(inverse), np.array(form), *readable(lines), counts, t, cosine)
    return gather(counts, t, cosine)


@rows
def _cross(first, last, inverse, form, origins, directions, counts, t, cosine):
    a, b, c, d, e = form[0], form[1], form[2], form[3], form[4]
    for line in range(first, last):
        along = directions[line, 0], directions[line, 1], directions[line, 2]
        shift, x, y, z, dx, dy, dz = approach(
            inverse, _REACH, origins[line, 0], origins[line, 1], origins[line, 2], along[0], along[1], along[2]
        )
        found, s0, s1, square = cross_quadric(a, b, c, d, e, x, y, z, dx, dy, dz)
        if found == 0:
            level = square if square != 0.0 else a * x * x + b * y * y + (c * z + d) * z + e
            from_inside = level < 0.0
        elif found == 1:
            from_inside = a * x * dx + b * y * dy + (c * z + 0.5 * d) * dz > 0.0
        else:
            from_inside = square < 0.0
        count = 0
        if from_inside:
            count = _add(line, count, -math.inf, -1.0, t, cosine)
        for k in range(found):
            s = s0 if k == 0 else s1
            px, py, pz = x + s * dx, y + s * dy, z + s * dz
            slope = _cosine(inverse, a * px, b * py, c * pz + 0.5 * d, dx, dy, dz)
            count = _add(line, count, shift + s, slope, t, cosine)
        if count % 2 == 1:
            count = _add(line, count, math.inf, 1.0, t, cosine)
        counts[line] = count


@inlined
def _add(line, count, t, slope, events, cosine):
    """Write an event; entering ones have a negative cosine also where rounding would have it otherwise.

    An interval without length, as between -inf and a root that is too large for a float, is taken back.
    """
    if count % 2 == 1 and not t > events[line, count - 1]:
        return count - 1
    events[line, count] = t
    cosine[line, count] = -abs(slope) if count % 2 == 0 else abs(slope)
    return count + 1


@inlined
def _cosine(inverse, gx, gy, gz, dx, dy, dz):
    """Return direction . outward normal in the world, for a gradient and a direction in the canonical frame."""
    wx = inverse[0, 0] * gx + inverse[1, 0] * gy + inverse[2, 0] * gz
    wy = inverse[0, 1] * gx + inverse[1, 1] * gy + inverse[2, 1] * gz
    wz = inverse[0, 2] * gx + inverse[1, 2] * gy + inverse[2, 2] * gz
    length = math.sqrt(wx * wx + wy * wy + wz * wz)
    return min(1.0, abs((dx * gx + dy * gy + dz * gz) / length)) if length > 0.0 else 1.0
