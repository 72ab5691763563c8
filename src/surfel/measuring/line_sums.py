"""What lines add up: weighted hits, and the integrals along the pieces of a line that lie inside."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats
from surfel.core.crossings import Crossings
from surfel.core.lines import Lines

COLUMNS = 13
"""Per line: weighted hits; 1 where hit; 1 where odd; length; 3 first and 6 second moments of the pieces inside."""


class Moments(NamedTuple):
    """Estimates from one set of lines.

    Area, volume, first moments (3,), second moments (6,), and the shares of lines that hit and, of those, that are odd.
    """

    area: float
    volume: float
    first: Floats
    second: Floats
    hit: float
    odd: float


def line_values(lines: Lines, hits: Crossings, events: Crossings, origin: Floats) -> Floats:
    """Return what each line adds, shape (m, 13), the columns as in :data:`COLUMNS`.

    Parameters
    ----------
    lines : Lines
        The lines.
    hits : Crossings
        Every hit, with its weight: for the area.
    events : Crossings
        One event for each passage through the surface: a line is inside between the first and the second, the third
        and the fourth, and so on. An odd line leaks: its pieces are not counted.
    origin : Floats, shape (3,)
        What moments are taken about.
    """
    values = np.zeros((len(lines), COLUMNS))
    with threads_for(2 * len(lines)):
        _integrate(
            len(lines), lines.origins, lines.directions, origin, hits.offsets, hits.weight, events.offsets, events.t,
            values,
        )  # fmt: skip
    return values


def moments_of(sums: Floats, lines: int, measure: float) -> Moments:
    """Turn the column sums of ``lines`` lines that stand for a line measure into estimates.

    With ``int m dL = pi s`` and ``int length dL = 2 pi V`` (Santalo, *Integral Geometry*, chapter 14). Odd lines tell
    nothing about the inside; the integrals of the others stand for them.
    """
    share = measure / lines
    hit, odd = sums[1], sums[2]
    whole = hit / (hit - odd) if hit > odd else 0.0
    inside = sums[3:] * (share / (2.0 * np.pi) * whole)
    return Moments(
        float(sums[0] * share / np.pi), float(inside[0]), inside[1:4], inside[4:10], hit / lines, odd / max(hit, 1.0)
    )


def inertia_tensor(volume: float, first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Return the centroid and the inertia tensor about it at unit density, from moments about any origin.

    Parameters
    ----------
    volume : float
        Not zero.
    first : Floats, shape (3,)
        Integrals of x, y, z.
    second : Floats, shape (6,)
        Integrals of xx, xy, xz, yy, yz, zz.
    """
    centre = first / volume
    xx, xy, xz, yy, yz, zz = second - volume * np.array(
        [centre[i] * centre[j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    )
    tensor = np.array([[yy + zz, -xy, -xz], [-xy, xx + zz, -yz], [-xz, -yz, xx + yy]])
    return centre, tensor


@rows
def _integrate(first, last, origins, directions, origin, hit_offsets, weight, offsets, t, values):
    for line in range(first, last):
        total = 0.0
        for k in range(hit_offsets[line], hit_offsets[line + 1]):
            total += weight[k]
        values[line, 0] = total
        count = offsets[line + 1] - offsets[line]
        if count == 0:
            continue
        values[line, 1] = 1.0
        if count % 2 == 1:
            values[line, 2] = 1.0
            continue
        ox, oy, oz = origins[line, 0] - origin[0], origins[line, 1] - origin[1], origins[line, 2] - origin[2]
        dx, dy, dz = directions[line, 0], directions[line, 1], directions[line, 2]
        for k in range(offsets[line], offsets[line + 1], 2):
            a, b = t[k], t[k + 1]
            one, two, three = b - a, 0.5 * (b * b - a * a), (b * b * b - a * a * a) / 3.0
            values[line, 3] += one
            values[line, 4] += ox * one + dx * two
            values[line, 5] += oy * one + dy * two
            values[line, 6] += oz * one + dz * two
            values[line, 7] += ox * ox * one + 2.0 * ox * dx * two + dx * dx * three
            values[line, 8] += ox * oy * one + (ox * dy + oy * dx) * two + dx * dy * three
            values[line, 9] += ox * oz * one + (ox * dz + oz * dx) * two + dx * dz * three
            values[line, 10] += oy * oy * one + 2.0 * oy * dy * two + dy * dy * three
            values[line, 11] += oy * oz * one + (oy * dz + oz * dy) * two + dy * dz * three
            values[line, 12] += oz * oz * one + 2.0 * oz * dz * two + dz * dz * three


def shift_sums(values: Floats, shifts: int) -> Floats:
    """Return the column sums of each shift, shape (shifts, 13); the rows of ``values`` run shift by shift."""
    return np.asarray(values.reshape(shifts, -1, COLUMNS).sum(axis=1))
