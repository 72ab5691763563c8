"""Sifting: places are told apart by the coloured grid, whole blocks at a time; the few that are near are left over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, rows, threads_for
from surfel.core.cast import Booleans, Floats
from surfel.inside.grid import BORDER, IN, OUT, Grid, bit_of, colour_of_ball
from surfel.inside.owners import Owners, owner_of
from surfel.inside.spheres import BLOCK, WIDTH, Spheres

UNDECIDED = -1
"""The kind of places that only a judge can tell."""

_TOP = 2  # spheres of this level (or the highest) are the items that threads share
_STACK = 64


def sift_sorted(
    grid: Grid, owners: Owners, slabs: Floats, spheres: Spheres, points: Floats, motion: Floats, reach: float
) -> tuple[NDArray[np.int8], Booleans]:
    """Sift points that are sorted along a curve, given their spheres, under a rigid motion (3, 4).

    Returns
    -------
    kind : NDArray[np.int8], shape (n,)
        OUT, IN or :data:`UNDECIDED`.
    near : Booleans, shape (n,)
        Whether border lies within ``reach``.
    """
    kind, near = np.empty(len(points), np.int8), np.empty(len(points), bool)
    top = min(_TOP, len(spheres.levels) - 2)
    count = int(spheres.levels[top + 1] - spheres.levels[top])
    with threads_for(len(points)):
        _sift_spheres(
            count, np.int64(top), *spheres, points, motion, reach, *grid, owners.base, owners.owned, slabs, kind, near
        )
    return kind, near


def sift_each(
    grid: Grid, owners: Owners, slabs: Floats, points: Floats, motion: Floats, reach: float
) -> tuple[NDArray[np.int8], Booleans]:
    """Sift points in any order, one by one."""
    kind, near = np.empty(len(points), np.int8), np.empty(len(points), bool)
    with threads_for(len(points)):
        _sift_points(len(points), points, motion, reach, *grid, owners.base, owners.owned, slabs, kind, near)
    return kind, near


@rows
def _sift_spheres(
    first, last, top, levels, centres, radii, points, motion, reach, low, step, table, border, inside, gap, base, owned,
    slabs, kind, near,
):  # fmt: skip
    n = len(points)
    stack = np.empty(_STACK, np.int64)
    for item in range(first, last):
        stack[0], height = (top << 40) | item, 1
        while height > 0:
            height -= 1
            level, node = stack[height] >> 40, stack[height] & 0xFFFFFFFFFF
            here = levels[level] + node
            x, y, z = _moved(motion, centres[here, 0], centres[here, 1], centres[here, 2])
            colour = colour_of_ball(low, step, table, border, inside, gap, x, y, z, radii[here] + reach)
            if colour != BORDER:
                size = BLOCK << (3 * level)
                for i in range(node * size, min(n, (node + 1) * size)):
                    kind[i], near[i] = colour, False
            elif level > 0:
                for child in range(node * WIDTH, min(node * WIDTH + WIDTH, levels[level] - levels[level - 1])):
                    stack[height] = ((level - 1) << 40) | child
                    height += 1
            else:
                _settle(
                    node * BLOCK, min(n, node * BLOCK + BLOCK), points, motion, reach, low, step, table, border, inside,
                    gap, base, owned, slabs, kind, near,
                )  # fmt: skip


@rows
def _sift_points(
    first, last, points, motion, reach, low, step, table, border, inside, gap, base, owned, slabs, kind, near
):  # fmt: skip
    _settle(
        first, last, points, motion, reach, low, step, table, border, inside, gap, base, owned, slabs, kind, near
    )  # fmt: skip


@inlined
def _moved(motion, x, y, z):
    """Return a place under a motion: three rows of four numbers."""
    return (
        motion[0, 0] * x + motion[0, 1] * y + motion[0, 2] * z + motion[0, 3],
        motion[1, 0] * x + motion[1, 1] * y + motion[1, 2] * z + motion[1, 3],
        motion[2, 0] * x + motion[2, 1] * y + motion[2, 2] * z + motion[2, 3],
    )


@inner
def _settle(
    start, stop, points, motion, reach, low, step, table, border, inside, gap, base, owned, slabs, kind, near
):  # fmt: skip
    """Write the kind of each place of a run, and whether it is near: by its cell, or by the slab of its cell."""
    inverse = 1.0 / step
    nx, ny, nz = 8.0 * table.shape[0], 8.0 * table.shape[1], 8.0 * table.shape[2]
    for i in range(start, stop):
        x, y, z = _moved(motion, points[i, 0], points[i, 1], points[i, 2])
        a, b, c = (x - low[0]) * inverse, (y - low[1]) * inverse, (z - low[2]) * inverse
        colour = OUT
        if a >= 0.0 and b >= 0.0 and c >= 0.0 and a < nx and b < ny and c < nz:
            u, v, w = int(a), int(b), int(c)
            brick = table[u >> 3, v >> 3, w >> 3]
            colour = -1 - brick
            if brick >= 0:
                bit = bit_of(v & 7, w & 7)
                colour = IN if inside[brick, u & 7] & bit else OUT
                if border[brick, u & 7] & bit:
                    colour = BORDER
        near[i] = colour == BORDER
        if colour == BORDER:
            colour = UNDECIDED
            if brick < len(base) and len(slabs) > 0:
                cell = owner_of(owned[brick, u & 7], base[brick, u & 7], bit)
                if cell >= 0:
                    along = slabs[cell, 0] * x + slabs[cell, 1] * y + slabs[cell, 2] * z
                    if along < slabs[cell, 3]:
                        colour = IN
                    elif along > slabs[cell, 4]:
                        colour = OUT
        elif reach > 0.0:
            near[i] = colour_of_ball(low, step, table, border, inside, gap, x, y, z, reach) == BORDER
        kind[i] = colour
