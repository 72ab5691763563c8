"""Borders: the mass that the hull of the points lacks.

Inside a surface the cells of the points tile it. Along a border the hull of the points is smaller than the surface.
What is missing is what its outermost points stand for: each open cell adds a share of a cell. Counting all of them errs
less than counting the few whose places the others do not cover; but these tell a border from a gap in a crease, where
cells are open as well.

Points in good order are another matter. Those of a grid may lie on the border, or half a spacing inside, as the middles
of pixels do, and nothing in them tells which. They are read as lying on it; the interval holds both.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, kernel, rows, threads_for
from surfel.core.cast import Floats

CELLS = 12
"""How many closed cells nearby give the size of a border point's cell."""


AT_MOST = 2.0
"""How much larger or smaller than those nearby cells at the border are taken to be."""

UNEVENNESS = np.array([0.03, 0.11, 0.12, 0.135, 0.155, 0.19, 0.24, 0.33])
SHARES = np.array([0.0, 0.325, 0.355, 0.37, 0.40, 0.455, 0.545, 0.685])
"""What an open point adds, in cells, by how unequal the cells are.

Measured on a square, a disk, a Moebius band, a helicoid and a half-sphere, with points at random and kept 0.3 to 0.8
spacings apart, also more so in one direction than in the other. Those kept apart were thrown inside the border alone,
and crowd it: of a part that is cut out of a larger cloud of such points each would stand for 0.5. The points of a grid
are taken to lie on the border.
"""

LEAST_SHARE = 0.35
"""The share of blue noise: what is uncertain about a border is told in it where points lie in better order."""

ORDERLY = 0.11
"""Unevenness below which points are those of a grid, more or less. What noise alone may have brought about is none."""

STIRRED, STIRRED_BELOW = 4.3, 0.45
"""How fast, with the square of the noise in spacings, cells become as unequal as those of random points, and the noise
up to which that is undone."""

HALF = 0.525
"""How much more of a cell the outermost points of a grid may stand for: half of one, and their share of the corners."""

GRID, NO_GRID = 0.095, 0.12
"""Unevenness up to which points may be those of a grid, and from which they are none."""

OPEN_NEARBY, UNCOVERED_NEARBY = 3, 2
"""Along a border at least so many of a point and its 48 neighbours are open, and uncovered: in a crease fewer are."""

CREASED_BY, ALIKE = 12, 0.8
"""A point is in a crease if one of so many neighbours has a normal that makes a smaller cosine with its own."""

_ROUND = 12  # neighbours that a cell is compared with


def border_share(uneven: float) -> float:
    """Return how much of a cell an open point adds: 0.685 for random points, 0.35 for blue noise, 0 for a grid.

    Parameters
    ----------
    uneven : float
        What :func:`unevenness` gave: 0.33 for random points, 0.12 for blue noise, 0 for a grid.
    """
    return float(np.interp(uneven, UNEVENNESS, SHARES))


def doubtful_share(uneven: float) -> float:
    """Return how much more of a cell an open point may stand for, where the points may be those of a grid."""
    return float(np.interp(uneven, [GRID, NO_GRID], [HALF, 0.0]))


def unstirred(uneven: float, noise: float) -> float:
    """Return how unequal the cells were before noise moved the points along the surface, too.

    Parameters
    ----------
    uneven : float
        What :func:`unevenness` gave.
    noise : float
        Standard deviation off the surface, in spacings. Random points stay as random as they were.
    """
    random = float(UNEVENNESS[-1]) ** 2
    left = max(0.0, random - uneven * uneven) * math.exp(STIRRED * min(noise, STIRRED_BELOW) ** 2)
    return math.sqrt(max(0.0, random - left)) if left else uneven


def unevenness(area: Floats, closed: NDArray[np.uint8], near: NDArray[np.int32]) -> float:
    """Return by which share closed cells differ from the mean of those round them: the median; 0 where none is closed.

    Unlike the distance to the nearest point it stays the same where points lie denser along lines than across.
    """
    off = np.empty(len(area))
    with threads_for(len(area)):
        _write_unlike(len(area), area, closed, near, off)
    off = off[off >= 0.0]
    return float(np.median(off)) if len(off) else 0.0


@rows
def _write_unlike(first, last, area, closed, near, off):
    """Write how much each closed cell differs from the mean of the closed ones round it; -1 where there are few."""
    for i in range(first, last):
        off[i] = -1.0
        if closed[i] == 0:
            continue
        total, count = 0.0, 0
        for a in range(min(_ROUND, near.shape[1])):
            j = near[i, a]
            if closed[j] == 1:
                total += area[j]
                count += 1
        if 2 * count >= _ROUND and total > 0.0:
            off[i] = abs(area[i] * count / total - 1.0)


def along_border(
    chosen: NDArray[np.int32], neighbours: NDArray[np.int32], opened: NDArray[np.bool_], uncovered: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Tell for each chosen open point whether enough points round it are open for a border, and uncovered as well."""
    enough: NDArray[np.bool_] = 1 + opened[neighbours].sum(axis=1) >= OPEN_NEARBY
    return enough, enough & (uncovered[chosen] + uncovered[neighbours].sum(axis=1) >= UNCOVERED_NEARBY)


def in_crease(
    points: Floats, normals: Floats, neighbours: NDArray[np.int32], chosen: NDArray[Any]
) -> NDArray[np.bool_]:
    """Tell which chosen points have neighbours whose normals differ, or that lie on another sheet."""
    near = neighbours[chosen, :CREASED_BY]
    offset = points[near] - points[chosen][:, None]
    own = np.abs(np.einsum("ijk,ik->ij", offset, normals[chosen]))
    other = np.abs(np.einsum("ijk,ijk->ij", offset, normals[near]))
    cosine = np.abs(np.einsum("ijk,ik->ij", normals[near], normals[chosen]))
    steep = (own + other) ** 2 > 0.36 * np.einsum("ijk,ijk->ij", offset, offset)
    return np.asarray(((cosine < ALIKE) | steep).any(axis=1))


def nearby_cells(
    chosen: NDArray[np.int32], neighbours: NDArray[np.int32], area: Floats, closed: NDArray[np.uint8], spacing: Floats
) -> Floats:
    """Return the mean area of the nearest closed cells round each chosen point; half a square spacing if none."""
    out = np.empty(len(chosen))
    with threads_for(len(chosen)):
        _nearby(len(chosen), chosen, neighbours, area, closed, spacing, out)
    return out


@rows
def _nearby(first, last, chosen, neighbours, area, closed, spacing, out):
    for row in range(first, last):
        total, count = 0.0, 0
        for a in range(neighbours.shape[1]):
            j = neighbours[row, a]
            if closed[j] == 1:
                total += area[j]
                count += 1
                if count >= CELLS:
                    break
        h = spacing[chosen[row]]
        out[row] = total / count if count >= 4 else 0.5 * h * h


def border_cells(
    points: Floats, chosen: NDArray[np.int32], neighbours: NDArray[np.int32], area: Floats, closed: NDArray[np.uint8]
) -> Floats:
    """Return how large cells are at each chosen border point, as those farther inside let expect.

    The closed cells nearby all lie to one side. Where the points become sparser towards the border, these are smaller
    than the cells there. So a line is fitted to their areas, and followed from their middle to the point.
    """
    out = np.zeros(len(chosen))
    with threads_for(len(chosen)):
        _towards(len(chosen), points, chosen, neighbours, area, closed, out)
    return out


@rows
def _towards(first, last, points, chosen, neighbours, area, closed, out):
    for row in range(first, last):
        i = chosen[row]
        cx, cy, cz, mean, count = 0.0, 0.0, 0.0, 0.0, 0
        for a in range(neighbours.shape[1]):
            j = neighbours[row, a]
            if closed[j] == 1:
                cx, cy, cz = cx + points[j, 0], cy + points[j, 1], cz + points[j, 2]
                mean += area[j]
                count += 1
        if count == 0:
            continue
        cx, cy, cz, mean = cx / count, cy / count, cz / count, mean / count
        dx, dy, dz = points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz
        square = dx * dx + dy * dy + dz * dz
        joint = spread = 0.0
        for a in range(neighbours.shape[1]):
            j = neighbours[row, a]
            if closed[j] == 1:
                s = (points[j, 0] - cx) * dx + (points[j, 1] - cy) * dy + (points[j, 2] - cz) * dz
                joint += s * (area[j] - mean)
                spread += s * s
        rise = joint / spread * square if spread > 0.0 else 0.0
        out[row] = min(max(mean + rise, mean / AT_MOST), mean * AT_MOST)


@kernel
def is_covered(u, v, count, x, y, cap2):
    """Tell whether (x, y) lies in a Delaunay triangle of the points (u, v)[:count] with squared circumradius <= cap2.

    The triangle is found as the facet of the lower hull of the lifted points below (x, y): start from any triangle
    that holds the place and exchange one corner after another for the point farthest below its plane.
    """
    near, best = -1, 1e300
    for a in range(count):
        d = (u[a] - x) * (u[a] - x) + (v[a] - y) * (v[a] - y)
        if d < best:
            best, near = d, a
    ax, ay = u[near] - x, v[near] - y
    left = right = -1
    left_angle = right_angle = -1.0
    for a in range(count):
        if a == near:
            continue
        bx, by = u[a] - x, v[a] - y
        angle = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
        if angle >= 0.0 and angle > left_angle:
            left_angle, left = angle, a
        if angle < 0.0 and -angle > right_angle:
            right_angle, right = -angle, a
    if left < 0 or right < 0 or left_angle + right_angle < math.pi:
        return False
    p, q, r = near, left, right
    for _ in range(200):
        ax, ay, bx, by, cx, cy = u[p] - x, v[p] - y, u[q] - x, v[q] - y, u[r] - x, v[r] - y
        az, bz, cz = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
        det = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if abs(det) < 1e-15 * (az + bz + cz):
            return False
        gx = ((bz - az) * (cy - ay) - (cz - az) * (by - ay)) / det
        gy = ((bx - ax) * (cz - az) - (cx - ax) * (bz - az)) / det
        g = az - gx * ax - gy * ay
        lowest, new = -1e-12 * (az + bz + cz), -1
        for a in range(count):
            wx, wy = u[a] - x, v[a] - y
            below = wx * wx + wy * wy - (gx * wx + gy * wy + g)
            if below < lowest:
                lowest, new = below, a
        if new < 0:
            return g + 0.25 * (gx * gx + gy * gy) <= cap2
        wx, wy = u[new] - x, v[new] - y
        if _holds_origin(bx, by, cx, cy, wx, wy):
            p = new
        elif _holds_origin(cx, cy, ax, ay, wx, wy):
            q = new
        elif _holds_origin(ax, ay, bx, by, wx, wy):
            r = new
        else:
            return False
    return True


@inner
def _holds_origin(ax, ay, bx, by, cx, cy):
    s, t, w = ax * by - ay * bx, bx * cy - by * cx, cx * ay - cy * ax
    eps = 1e-15 * (abs(ax) + abs(ay) + abs(bx) + abs(by)) * (abs(cx) + abs(cy))
    return (s >= -eps and t >= -eps and w >= -eps) or (s <= eps and t <= eps and w <= eps)
