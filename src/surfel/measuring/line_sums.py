"""What lines add up: weighted hits, and the integrals along the pieces of a line that lie inside."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats
from surfel.core.crossings import Crossings
from surfel.core.lines import Lines

COLUMNS = 14
"""Of a line: weighted hits; 1 if hit; 1 if odd; length; 3 first and 6 second moments of the pieces inside; 1 if these
are not known."""


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


def set_sums(
    lines: Lines, hits: Crossings, events: Crossings, pieces: Crossings, origin: Floats, sets: int, leaves: int = 0
) -> Floats:
    """Return what the lines of each set add up to, shape (sets, 14 + leaves), the columns as in :data:`COLUMNS`.

    Lines run set by set, and each set is added up in the order of its lines.

    Parameters
    ----------
    lines : Lines
        As many for each set.
    hits : Crossings
        Every hit, with its weight: for the area.
    events : Crossings
        One event for each passage through the surface. An odd line leaks.
    pieces : Crossings
        A line is inside between the first and the second, the third and the fourth of these, and so on; where their
        number is odd nothing is known. Mostly they are the events.
    origin : Floats, shape (3,)
        What moments are taken about.
    sets : int
        How many.
    leaves : int
        So many further columns hold the weighted hits of each leaf.
    """
    sums = np.zeros((sets, COLUMNS + leaves))
    with threads_for(2 * len(lines)):
        _add_up(
            sets, len(lines) // sets, lines.origins, lines.directions, origin, hits.offsets, hits.weight, hits.leaf,
            events.offsets, pieces.offsets, pieces.t, leaves, sums,
        )  # fmt: skip
    return sums


def moments_of(sums: Floats, lines: int, measure: float) -> Moments:
    """Turn the column sums of ``lines`` lines that stand for a line measure into estimates.

    With ``int m dL = pi s`` and ``int length dL = 2 pi V`` (Santalo, *Integral Geometry*, chapter 14). For lines of
    which the pieces inside are not known the integrals of the others stand.
    """
    share = measure / lines
    hit, odd, unknown = sums[1], sums[2], sums[13]
    whole = hit / (hit - unknown) if hit > unknown else 0.0
    inside = sums[3:13] * (share / (2.0 * np.pi) * whole)
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
def _add_up(
    first, last, per_set, origins, directions, origin, hit_offsets, weight, leaf, events, offsets, t, leaves, sums
):  # fmt: skip
    for which in range(first, last):
        for line in range(which * per_set, (which + 1) * per_set):
            for k in range(hit_offsets[line], hit_offsets[line + 1]):
                sums[which, 0] += weight[k]
                if leaves > 0:
                    sums[which, COLUMNS + leaf[k]] += weight[k]
            count = events[line + 1] - events[line]
            if count == 0:
                continue
            sums[which, 1] += 1.0
            sums[which, 2] += count % 2
            if (offsets[line + 1] - offsets[line]) % 2 == 1:
                sums[which, 13] += 1.0
                continue
            ox, oy, oz = origins[line, 0] - origin[0], origins[line, 1] - origin[1], origins[line, 2] - origin[2]
            dx, dy, dz = directions[line, 0], directions[line, 1], directions[line, 2]
            for k in range(offsets[line], offsets[line + 1], 2):
                a, b = t[k], t[k + 1]
                one, two, three = b - a, 0.5 * (b * b - a * a), (b * b * b - a * a * a) / 3.0
                sums[which, 3] += one
                sums[which, 4] += ox * one + dx * two
                sums[which, 5] += oy * one + dy * two
                sums[which, 6] += oz * one + dz * two
                sums[which, 7] += ox * ox * one + 2.0 * ox * dx * two + dx * dx * three
                sums[which, 8] += ox * oy * one + (ox * dy + oy * dx) * two + dx * dy * three
                sums[which, 9] += ox * oz * one + (ox * dz + oz * dx) * two + dx * dz * three
                sums[which, 10] += oy * oy * one + 2.0 * oy * dy * two + dy * dy * three
                sums[which, 11] += oy * oz * one + (oy * dz + oz * dy) * two + dy * dz * three
                sums[which, 12] += oz * oz * one + 2.0 * oz * dz * two + dz * dz * three
