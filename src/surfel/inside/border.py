"""Border: the cells that the disks of the surfels meet, found conservatively, so that nothing seeps between them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, kernel, rows, threads_for
from surfel.core.cast import Floats
from surfel.inside.grid import Frame

EMPTY = 21.0
"""So many surfels are expected where a cell of the surface stays free of disks: exp(-21) of such cells are missed."""

LARGEST = 12.0
"""And at most this many cells: strays shall not fill space."""

_RUN = 16  # surfels that follow each other in the order, and mark bricks together
_TOGETHER = 27  # bricks at the most


class Bricks(NamedTuple):
    """The bricks that disks meet.

    Parameters
    ----------
    table : NDArray[np.int32], shape (x, y, z)
        The number of each brick, -1 where no disk comes near.
    border : NDArray[np.uint64], shape (bricks, 8)
        Bits of the cells that a disk meets.
    owned : NDArray[np.uint64], shape (bricks, 8)
        Bits of the cells that hold a surfel's centre.
    """

    table: NDArray[np.int32]
    border: NDArray[np.uint64]
    owned: NDArray[np.uint64]


def mark_border(frame: Frame, points: Floats, normals: Floats, radii: Floats) -> Bricks:
    """Mark the cells that the disks meet: those in the box round a disk that its plane passes through.

    The outermost layer of cells stays free. A surfel without a normal (zero) takes the whole box of its ball.
    """
    n = len(points)
    touched = np.zeros(frame.bricks, np.uint8)
    with threads_for(4 * n):
        _touch_runs(-(-n // _RUN), points, normals, radii, frame.low, frame.step, touched)
        table, count = number_bricks(touched)
        cells = np.zeros((count, 512), np.uint8)
        _mark(n, points, normals, radii, frame.low, frame.step, table, cells)
        _own(n, points, frame.low, frame.step, table, cells)
        border, owned = np.zeros((count, 8), np.uint64), np.zeros((count, 8), np.uint64)
        _pack(count, cells, border, owned)
    return Bricks(table, border, owned)


def touched_bricks(frame: Frame, points: Floats, normals: Floats, radii: Floats) -> NDArray[np.uint8]:
    """Return 1 for each brick that the box round a disk meets."""
    touched = np.zeros(frame.bricks, np.uint8)
    _touch(len(points), points, normals, radii, frame.low, frame.step, touched)
    return touched


def disk_radii(spacings: Floats, areas: Floats, step: float) -> Floats:
    """Return the radii of the disks that make the border.

    A cell of side h that the surface crosses is missed if no centre lies within the radius R of it, on an area of
    ``h^2 + 4 h R + pi R^2``. R is such that :data:`EMPTY` surfels at random are expected there: 1.3 spacings for
    cells of 2.2, and 2.6 for cells that are small against the spacing.
    """
    radii = np.empty(len(spacings))
    with threads_for(len(spacings)):
        _radii(len(spacings), spacings, areas, step, radii)
    return radii


@rows
def _radii(first, last, spacings, areas, step, radii):
    for n in range(first, last):
        apart = max(spacings[n], math.sqrt(areas[n]))
        lacking = max(EMPTY * apart * apart - step * step, 0.0)
        radius = (math.sqrt(4.0 * step * step + math.pi * lacking) - 2.0 * step) / math.pi
        radii[n] = min(max(radius, 0.7 * apart), LARGEST * step)


@kernel
def number_bricks(touched):
    """Return the table of the touched bricks, numbered in its order, and how many there are."""
    table = np.full(touched.shape, -1, np.int32)
    count = 0
    for i in range(touched.shape[0]):
        for j in range(touched.shape[1]):
            for k in range(touched.shape[2]):
                if touched[i, j, k]:
                    table[i, j, k] = count
                    count += 1
    return table, count


# Several threads may store to one byte below. They all store the same value, so the order does not matter.


@rows
def _touch_runs(first, last, points, normals, radii, low, step, touched):
    """Mark the bricks that the boxes round runs of disks meet: a few more than the disks themselves do.

    Where a run leaps from one part of the cloud to another, each disk marks its own.
    """
    inverse = 1.0 / step
    corner, end = np.empty(3, np.int64), np.empty(3, np.int64)
    for run in range(first, last):
        start, stop = run * _RUN, min(len(points), run * _RUN + _RUN)
        reach = 0.0
        for n in range(start, stop):
            reach = max(reach, radii[n])
        bricks = 1
        for axis in range(3):
            lowest = highest = points[start, axis]
            for n in range(start + 1, stop):
                lowest, highest = min(lowest, points[n, axis]), max(highest, points[n, axis])
            corner[axis] = int(max((lowest - reach - low[axis]) * inverse, 1.0)) >> 3
            end[axis] = int(min((highest + reach - low[axis]) * inverse, 8.0 * touched.shape[axis] - 1.5)) >> 3
            bricks *= end[axis] + 1 - corner[axis]
        if bricks <= _TOGETHER:
            for i in range(corner[0], end[0] + 1):
                for j in range(corner[1], end[1] + 1):
                    for k in range(corner[2], end[2] + 1):
                        touched[i, j, k] = 1
        else:
            for n in range(start, stop):
                _touch_one(n, points, normals, radii, low, inverse, touched, corner, end)


@rows
def _touch(first, last, points, normals, radii, low, step, touched):
    """Mark the bricks that the box round each disk meets."""
    corner, end = np.empty(3, np.int64), np.empty(3, np.int64)
    for n in range(first, last):
        _touch_one(n, points, normals, radii, low, 1.0 / step, touched, corner, end)


@inner
def _touch_one(n, points, normals, radii, low, inverse, touched, corner, end):
    """Mark the bricks that the box round a disk meets; the outermost cells are left out."""
    for axis in range(3):
        reach = radii[n] * inverse * math.sqrt(max(0.0, 1.0 - normals[n, axis] * normals[n, axis]))
        middle = (points[n, axis] - low[axis]) * inverse
        corner[axis] = int(max(middle - reach, 1.0)) >> 3
        end[axis] = int(min(middle + reach, 8.0 * touched.shape[axis] - 1.5)) >> 3
    for i in range(corner[0], end[0] + 1):
        for j in range(corner[1], end[1] + 1):
            for k in range(corner[2], end[2] + 1):
                touched[i, j, k] = 1


@rows
def _mark(first, last, points, normals, radii, low, step, table, cells):
    """Mark the cells of the box round each disk that its plane meets; the outermost cells are left out."""
    inverse = 1.0 / step
    most_x, most_y, most_z = 8.0 * table.shape[0] - 1.5, 8.0 * table.shape[1] - 1.5, 8.0 * table.shape[2] - 1.5
    for n in range(first, last):
        nx, ny, nz = normals[n, 0], normals[n, 1], normals[n, 2]
        # the plane meets a cell where its middle is no farther than half the cell's extent along the normal
        half = 0.5 * (abs(nx) + abs(ny) + abs(nz)) * (1.0 + 1e-12)
        x, y, z = (
            (points[n, 0] - low[0]) * inverse,
            (points[n, 1] - low[1]) * inverse,
            (points[n, 2] - low[2]) * inverse,
        )
        r = radii[n] * inverse
        rx = r * math.sqrt(max(0.0, 1.0 - nx * nx))
        ry = r * math.sqrt(max(0.0, 1.0 - ny * ny))
        rz = r * math.sqrt(max(0.0, 1.0 - nz * nz))
        i0, i1 = int(max(x - rx, 1.0)), int(min(x + rx, most_x))
        j0, j1 = int(max(y - ry, 1.0)), int(min(y + ry, most_y))
        k0, k1 = int(max(z - rz, 1.0)), int(min(z + rz, most_z))
        for i in range(i0, i1 + 1):
            at_x = nx * (i + 0.5 - x)
            for j in range(j0, j1 + 1):
                at_y = at_x + ny * (j + 0.5 - y)
                for k in range(k0, k1 + 1):
                    if abs(at_y + nz * (k + 0.5 - z)) <= half:
                        cells[table[i >> 3, j >> 3, k >> 3], ((i & 7) << 6) | ((j & 7) << 3) | (k & 7)] = 1


@rows
def _own(first, last, points, low, step, table, cells):
    for n in range(first, last):
        i, j, k = (
            int((points[n, 0] - low[0]) / step),
            int((points[n, 1] - low[1]) / step),
            int((points[n, 2] - low[2]) / step),
        )
        brick = table[i >> 3, j >> 3, k >> 3]
        if brick >= 0:
            cells[brick, ((i & 7) << 6) | ((j & 7) << 3) | (k & 7)] = 2


@rows
def _pack(first, last, cells, border, owned):
    one = np.uint64(1)
    for brick in range(first, last):
        for layer in range(8):
            marked = centred = np.uint64(0)
            for bit in range(64):
                cell = cells[brick, 64 * layer + bit]
                marked |= (one if cell > 0 else np.uint64(0)) << np.uint64(bit)
                centred |= (one if cell == 2 else np.uint64(0)) << np.uint64(bit)
            border[brick, layer], owned[brick, layer] = marked, centred
