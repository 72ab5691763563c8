"""Sifting: places are told apart by the coloured grid, whole blocks at a time; the few that are near are left over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, rows, threads_for
from surfel.core.cast import Booleans, Floats
from surfel.inside.grid import BORDER, IN, OUT, Grid, colour_of_ball
from surfel.inside.owners import Owners, owner_of
from surfel.inside.slabs import SAFE, Slabs, guard
from surfel.inside.spheres import BLOCK, WIDTH, Spheres
from surfel.inside.widened import REACH

UNDECIDED = -1
"""The kind of places that only a judge can tell."""

_TOP = 2  # spheres of this level (or the highest) are the items that threads share
_STACK = 64
_RUN = 256  # places that are settled together
_SMALL = REACH - 1e-6  # radius, in cells, of balls that the widened border is asked about
_ENOUGH = 3  # slabs that have to agree about a cell that holds no surfel


def sift_sorted(
    grid: Grid, wide: NDArray[np.uint64], owners: Owners, slabs: Slabs, spheres: Spheres, points: Floats,
    motion: Floats, reach: float,
) -> tuple[NDArray[np.int8], Booleans]:  # fmt: skip
    """Sift points that are sorted along a curve, given their spheres, under a rigid motion (3, 4).

    ``wide`` is the border of the grid, widened.

    Returns
    -------
    kind : NDArray[np.int8], shape (n,)
        OUT, IN or :data:`UNDECIDED`.
    near : Booleans, shape (n,)
        Whether border lies within ``reach``.
    """
    kind, near = np.zeros(len(points), np.int8), np.zeros(len(points), bool)  # OUT, which is not written
    top = min(_TOP, len(spheres.levels) - 2)
    count = int(spheres.levels[top + 1] - spheres.levels[top])
    with threads_for(len(points)):
        _sift_spheres(
            count, np.int64(top), *spheres, points, motion, reach, *grid, wide, owners.base, owners.owned, *slabs, kind,
            near,
        )  # fmt: skip
    return kind, near


def sift_each(
    grid: Grid, owners: Owners, slabs: Slabs, points: Floats, motion: Floats, reach: float
) -> tuple[NDArray[np.int8], Booleans]:
    """Sift points in any order, one by one."""
    kind, near = np.zeros(len(points), np.int8), np.zeros(len(points), bool)  # OUT, which is not written
    nothing = np.empty((0, 8), np.uint64)
    with threads_for(len(points)):
        _sift_points(len(points), points, motion, reach, *grid, nothing, owners.base, owners.owned, *slabs, kind, near)
    return kind, near


@rows
def _sift_spheres(
    first, last, top, levels, centres, radii, points, motion, reach, low, step, table, border, inside, gap, wide, base,
    owned, slabs, safe, doubt, kind, near,
):  # fmt: skip
    n = len(points)
    stack, todo = np.empty(_STACK, np.int64), np.empty(BLOCK << (3 * _TOP), np.int64)
    left, cells, bricks = np.empty_like(todo), np.empty_like(todo), np.empty_like(todo)
    inverse = 1.0 / step
    nx, ny, nz = 8.0 * table.shape[0], 8.0 * table.shape[1], 8.0 * table.shape[2]
    lx, ly, lz = low[0], low[1], low[2]
    one = np.uint64(1)
    for item in range(first, last):
        stack[0], height, count = (top << 40) | item, 1, 0
        while height > 0:
            height -= 1
            level, node = stack[height] >> 40, stack[height] & 0xFFFFFFFFFF
            here = levels[level] + node
            x, y, z = _moved(motion, centres[here, 0], centres[here, 1], centres[here, 2])
            colour = UNDECIDED
            a, b, c = (x - lx) * inverse, (y - ly) * inverse, (z - lz) * inverse
            if a >= 0.0 and b >= 0.0 and c >= 0.0 and a < nx and b < ny and c < nz:
                u, v, w = int(a), int(b), int(c)
                brick = table[u >> 3, v >> 3, w >> 3]
                if brick >= 0:
                    bit = one << np.uint64(8 * (v & 7) + (w & 7))
                    if wide[brick, u & 7] & bit:
                        colour = BORDER
                    elif (radii[here] + reach) * inverse < _SMALL:
                        colour = IN if inside[brick, u & 7] & bit else OUT
            if colour == UNDECIDED:
                colour = colour_of_ball(low, step, table, border, inside, gap, x, y, z, radii[here] + reach)
            if colour == IN:
                size = BLOCK << (3 * level)
                for i in range(node * size, min(n, (node + 1) * size)):
                    kind[i] = IN
            elif colour == BORDER and level > 0:
                for child in range(node * WIDTH, min(node * WIDTH + WIDTH, levels[level] - levels[level - 1])):
                    stack[height] = ((level - 1) << 40) | child
                    height += 1
            elif colour == BORDER:
                for i in range(node * BLOCK, min(n, node * BLOCK + BLOCK)):
                    todo[count] = i
                    count += 1
        _settle(
            todo, count, points, motion, reach, low, step, table, border, inside, gap, wide, base, owned, slabs, safe,
            doubt, kind, near, left, cells, bricks,
        )  # fmt: skip


@rows
def _sift_points(
    first, last, points, motion, reach, low, step, table, border, inside, gap, wide, base, owned, slabs, safe, doubt,
    kind, near,
):  # fmt: skip
    todo = np.empty(_RUN, np.int64)
    left, cells, bricks = np.empty_like(todo), np.empty_like(todo), np.empty_like(todo)
    for start in range(first, last, _RUN):
        count = min(_RUN, last - start)
        for m in range(count):
            todo[m] = start + m
        _settle(
            todo, count, points, motion, reach, low, step, table, border, inside, gap, wide, base, owned, slabs, safe,
            doubt, kind, near, left, cells, bricks,
        )  # fmt: skip


@inlined
def _moved(motion, x, y, z):
    """Return a place under a motion: three rows of four numbers."""
    return (
        motion[0, 0] * x + motion[0, 1] * y + motion[0, 2] * z + motion[0, 3],
        motion[1, 0] * x + motion[1, 1] * y + motion[1, 2] * z + motion[1, 3],
        motion[2, 0] * x + motion[2, 1] * y + motion[2, 2] * z + motion[2, 3],
    )


# Several threads may write to one byte of ``safe``. They all write the same value, so the order does not matter.


@inner
def _settle(
    todo, many, points, motion, reach, low, step, table, border, inside, gap, wide, base, owned, slabs, safe, doubt,
    kind, near, left, cells, bricks,
):  # fmt: skip
    """Write the kind of the first ``many`` places of ``todo``, and which are near: by their cells, or by slabs.

    What is outside and far is not written. The cells are looked up without the branches that nobody could predict, and
    those of the border are kept in ``left``, ``cells`` and ``bricks``, scratch as long as ``todo``. A border cell that
    holds no surfel has no slab: there the slabs of all cells round it have to agree.
    """
    inverse = 1.0 / step
    nx, ny, nz = 8.0 * table.shape[0], 8.0 * table.shape[1], 8.0 * table.shape[2]
    lx, ly, lz = low[0], low[1], low[2]
    m00, m01, m02, m03 = motion[0, 0], motion[0, 1], motion[0, 2], motion[0, 3]
    m10, m11, m12, m13 = motion[1, 0], motion[1, 1], motion[1, 2], motion[1, 3]
    m20, m21, m22, m23 = motion[2, 0], motion[2, 1], motion[2, 2], motion[2, 3]
    one = np.uint64(1)
    count = 0
    for m in range(many):
        i = todo[m]
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        a = (m00 * px + m01 * py + m02 * pz + m03 - lx) * inverse
        b = (m10 * px + m11 * py + m12 * pz + m13 - ly) * inverse
        c = (m20 * px + m21 * py + m22 * pz + m23 - lz) * inverse
        if not (a >= 0.0 and b >= 0.0 and c >= 0.0 and a < nx and b < ny and c < nz):
            continue
        u, v, w = int(a), int(b), int(c)
        brick = table[u >> 3, v >> 3, w >> 3]
        if brick < 0:
            kind[i] = -1 - brick
            continue
        place = np.uint64(8 * (v & 7) + (w & 7))
        within = (border[brick, u & 7] >> place) & one
        kind[i] = np.int64((inside[brick, u & 7] >> place) & one)
        near[i] = within
        left[count], cells[count], bricks[count] = i, (u << 42) | (v << 21) | w, brick
        count += np.int64(within)
    for m in range(count):
        i, brick = left[m], bricks[m]
        colour = UNDECIDED
        if brick < len(base) and len(slabs) > 0:
            u, v, w = cells[m] >> 42, (cells[m] >> 21) & 0x1FFFFF, cells[m] & 0x1FFFFF
            layer, bit = u & 7, one << np.uint64(8 * (v & 7) + (w & 7))
            x, y, z = _moved(motion, points[i, 0], points[i, 1], points[i, 2])
            cell = owner_of(owned[brick, layer], base[brick, layer], bit)
            if cell >= 0:
                if safe[cell] == 0:
                    safe[cell] = guard(u, v, w, cell, table, base, owned, slabs)
                along = slabs[cell, 0] * x + slabs[cell, 1] * y + slabs[cell, 2] * z
                if along < slabs[cell, 3] and safe[cell] == SAFE:
                    colour = IN
                elif along > slabs[cell, 4] and safe[cell] == SAFE:
                    colour = OUT
            elif brick >= len(doubt) or doubt[brick, layer] & bit == np.uint64(0):
                below = above = 0
                for square in range(9):
                    if below > 0 and above > 0:
                        break  # nothing can be said
                    e, f = u - 1 + square // 3, v - 1 + square % 3
                    for g in range(w - 1, w + 2):
                        other = table[e >> 3, f >> 3, g >> 3]
                        if other < 0 or other >= len(base):
                            continue
                        word, there = owned[other, e & 7], one << np.uint64(8 * (f & 7) + (g & 7))
                        if word & there == np.uint64(0):
                            continue
                        cell = owner_of(word, base[other, e & 7], there)
                        if safe[cell] == 0:
                            safe[cell] = guard(e, f, g, cell, table, base, owned, slabs)
                        along = slabs[cell, 0] * x + slabs[cell, 1] * y + slabs[cell, 2] * z
                        if safe[cell] != SAFE or (along >= slabs[cell, 3] and along <= slabs[cell, 4]):
                            below, above = 1, 1
                            break
                        below += 1 if along < slabs[cell, 3] else 0
                        above += 1 if along > slabs[cell, 4] else 0
                if above == 0 and below >= _ENOUGH:
                    colour = IN
                elif below == 0 and above >= _ENOUGH:
                    colour = OUT
        kind[i] = colour
    small = len(wide) > 0 and reach * inverse < _SMALL
    for m in range(many if reach > 0.0 else 0):
        i = todo[m]
        if near[i]:
            continue
        x, y, z = _moved(motion, points[i, 0], points[i, 1], points[i, 2])
        a, b, c = (x - lx) * inverse, (y - ly) * inverse, (z - lz) * inverse
        if small and a >= 0.0 and b >= 0.0 and c >= 0.0 and a < nx and b < ny and c < nz:
            u, v, w = int(a), int(b), int(c)
            brick = table[u >> 3, v >> 3, w >> 3]
            if brick >= 0 and (wide[brick, u & 7] >> np.uint64(8 * (v & 7) + (w & 7))) & one == np.uint64(0):
                continue
        near[i] = colour_of_ball(low, step, table, border, inside, gap, x, y, z, reach) == BORDER
