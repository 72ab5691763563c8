"""The region of a cut and fill: a polygon laid on a fine lattice, every cell with its share and the middle of that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel
from surfel.core.cast import Floats, Integers, read_only
from surfel.core.errors import InputError

MOST_CELLS = 1 << 24
"""Of the lattice over the polygon's box, however many points there are."""

LEAST_CELLS = 1 << 15
"""However few there are: a sign changes within a cell, so that cells should be small against the region."""


@dataclass(frozen=True, eq=False)
class Lattice:
    """A polygon on a lattice of squares.

    Parameters
    ----------
    low : Floats, shape (2,)
        The corner of the first cell.
    step : float
        The side of a cell.
    shape : tuple of two ints
        Cells along u and v.
    share : Floats, shape ``shape``
        The area of each cell inside the polygon.
    slot : NDArray[np.int32], shape ``shape``
        -2 where a cell lies outside, -1 where it lies inside as a whole, else its row of ``middle``.
    middle : Floats, shape (k, 2)
        The centroid of what is inside, for cells that the polygon's border cuts; in cells from ``low``.
    area : float
        Of the polygon.
    """

    low: Floats
    step: float
    shape: tuple[int, int]
    share: Floats
    slot: NDArray[np.int32]
    middle: Floats
    area: float

    @classmethod
    def over(cls, polygon: Floats, spacing: float) -> Lattice:
        """Lay a lattice over a polygon, with cells of about half a spacing of the points."""
        low, high = polygon.min(axis=0), polygon.max(axis=0)
        width = high - low
        box = float(width[0] * width[1])
        step = float(np.clip(0.5 * spacing, np.sqrt(box / MOST_CELLS), np.sqrt(box / LEAST_CELLS)))
        shape = tuple(int(n) for n in np.maximum(1, np.ceil(width / step)))
        share, slot = np.zeros(shape), np.full(shape, -2, np.int32)
        middle = np.empty((_cut_cells(shape, polygon, step), 2))
        corners = np.ascontiguousarray((polygon - low) / step)
        room = 6 * len(polygon) + 16  # each of four clips may add half as many corners
        count = _lay(corners, share, slot, middle, np.empty((room, 2)), np.empty((room, 2)), np.empty((room, 2)))
        return cls(
            read_only(low), step, (shape[0], shape[1]), read_only(share * step**2), read_only(slot),
            read_only(middle[:count].copy()), abs(signed_area(polygon)),
        )  # fmt: skip

    def places(self, cells: Integers) -> Floats:
        """Return where the cells with these flat numbers are sampled, shape (m, 2)."""
        u, v = np.divmod(cells, self.shape[1])
        place = np.stack([u + 0.5, v + 0.5], axis=1)
        slot = self.slot.ravel()[cells]
        place[slot >= 0] = self.middle[slot[slot >= 0]]
        return np.asarray(place * self.step + self.low)


def signed_area(polygon: Floats) -> float:
    """Return the area of a polygon, positive counterclockwise."""
    x, y = (polygon - polygon[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def refuse_crossings(polygon: Floats) -> None:
    """Refuse a polygon that crosses itself."""
    n = len(polygon)
    pair = _first_crossing(np.ascontiguousarray(polygon - polygon[0]))
    if pair >= 0:
        raise InputError(f"region must not cross itself; sides {pair // n} and {pair % n} do")


def _cut_cells(shape: tuple[int, ...], polygon: Floats, step: float) -> int:
    """Return at most how many cells the border passes: each side, rows and columns that it crosses, and some."""
    sides = np.abs(np.roll(polygon, -1, axis=0) - polygon) / step
    return int(min(shape[0] * shape[1], float(np.sum(sides.sum(axis=1) + 4.0) * 2.0)))


@kernel
def _first_crossing(p):
    """Return the numbers of two sides that cross, as ``first * n + second``, or -1."""
    n = len(p)
    for i in range(n):
        ax, ay, bx, by = p[i, 0], p[i, 1], p[(i + 1) % n, 0], p[(i + 1) % n, 1]
        for j in range(i + 2, n):
            if i == 0 and j == n - 1:
                continue
            cx, cy, dx, dy = p[j, 0], p[j, 1], p[(j + 1) % n, 0], p[(j + 1) % n, 1]
            if max(cx, dx) < min(ax, bx) or min(cx, dx) > max(ax, bx):
                continue
            s = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            t = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
            u = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
            w = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
            if ((s > 0.0 and t < 0.0) or (s < 0.0 and t > 0.0)) and ((u > 0.0 and w < 0.0) or (u < 0.0 and w > 0.0)):
                return i * n + j
    return -1


@inlined
def _clipped(polygon, count, axis, at, above, out):
    """Clip a polygon to one side of a line along an axis (Sutherland and Hodgman, 1974); return its corners."""
    kept = 0
    sign = 1.0 if above else -1.0
    other = 1 - axis
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        a, b = sign * (polygon[i, axis] - at), sign * (polygon[j, axis] - at)
        if a >= 0.0:
            out[kept, 0], out[kept, 1] = polygon[i, 0], polygon[i, 1]
            kept += 1
        if (a > 0.0 and b < 0.0) or (a < 0.0 and b > 0.0):
            out[kept, axis] = at
            out[kept, other] = polygon[i, other] + (polygon[j, other] - polygon[i, other]) * (a / (a - b))
            kept += 1
    return kept


@kernel
def _lay(polygon, share, slot, middle, row, cell, spare):
    """Clip the polygon to each column of cells, and that to each cell that its border passes."""
    columns, cells = share.shape
    crossed = np.empty(cells + 1, np.uint8)
    used = 0
    for i in range(columns):
        count = _clipped(polygon, len(polygon), 0, float(i), True, spare)
        count = _clipped(spare, count, 0, float(i + 1), False, row)
        crossed[:] = 0
        for a in range(count):
            b = a + 1 if a + 1 < count else 0
            if row[a, 0] == row[b, 0] and (row[a, 0] == float(i) or row[a, 0] == float(i + 1)):
                continue  # along the side of the column: no border of what is inside
            first, last = min(row[a, 1], row[b, 1]), max(row[a, 1], row[b, 1])
            for j in range(max(0, int(np.floor(first))), min(cells - 1, int(np.floor(last))) + 1):
                crossed[j] = 1
        inside = 0.0
        for j in range(cells):
            if crossed[j] == 0:
                if j == 0 or crossed[j - 1] == 1:  # one look at the middle tells for the whole run
                    inside = _winding(polygon, i + 0.5, j + 0.5)
                if inside != 0.0:
                    share[i, j], slot[i, j] = 1.0, -1
                continue
            kept = _clipped(row, count, 1, float(j), True, spare)
            kept = _clipped(spare, kept, 1, float(j + 1), False, cell)
            area = mu = mv = 0.0
            for a in range(kept):
                b = a + 1 if a + 1 < kept else 0
                au, av, bu, bv = cell[a, 0] - i, cell[a, 1] - j, cell[b, 0] - i, cell[b, 1] - j
                side = au * bv - bu * av
                area += side
                mu += side * (au + bu)
                mv += side * (av + bv)
            if abs(area) > 1e-12:
                middle[used, 0] = i + min(1.0, max(0.0, mu / (3.0 * area)))
                middle[used, 1] = j + min(1.0, max(0.0, mv / (3.0 * area)))
                share[i, j], slot[i, j] = 0.5 * abs(area), used
                used += 1
    return used


@inlined
def _winding(polygon, x, y):
    """Return 1 inside and 0 outside of a polygon: the parity of its sides to the right."""
    inside = 0.0
    n = len(polygon)
    for a in range(n):
        b = a + 1 if a + 1 < n else 0
        ay, by = polygon[a, 1], polygon[b, 1]
        if (ay > y) != (by > y) and x < polygon[a, 0] + (polygon[b, 0] - polygon[a, 0]) * ((y - ay) / (by - ay)):
            inside = 1.0 - inside
    return inside
