"""Sifting: places are told apart by the coloured grid, whole blocks at a time; the few that are near are left over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, rows, threads_for
from surfel.core.cast import Booleans, Floats
from surfel.inside.grid import ALL_IN, BORDER, IN, OUT
from surfel.inside.looks import BORDERS, INSIDE, NEAR, NEAR_REACH, REACH, WIDER, Looks
from surfel.inside.settle import moved_to, settle
from surfel.inside.slabs import Slabs
from surfel.inside.spheres import BLOCK, WIDTH, Spheres

_TOP = 2  # spheres of this level (or the highest) are the items that threads share
_STACK = 64
_RUN = BLOCK << (3 * _TOP)  # places that are settled together
_TESTED = 32  # a box longer than this in cells is not looked at cell by cell
_ROUNDED = 1e-9  # cells: what is added to a radius
_ONE, _NONE, _FULL = np.uint64(1), np.uint64(0), np.uint64(0xFFFFFFFFFFFFFFFF)
_BYTES = np.uint64(0x0101010101010101)
_U3, _U7, _U8 = np.uint64(3), np.uint64(7), np.uint64(8)


def sift(
    looks: Looks, slabs: Slabs, spheres: Spheres | None, points: Floats, motion: Floats, reach: float
) -> tuple[NDArray[np.int8], Booleans]:
    """Sift points under a rigid motion (3, 4): by whole blocks where they are sorted and have spheres, or one by one.

    Returns
    -------
    kind : NDArray[np.int8], shape (n,)
        OUT, IN or :data:`surfel.inside.settle.UNDECIDED`.
    near : Booleans, shape (n,)
        Whether border lies within ``reach``.
    """
    kind, near = np.zeros(len(points), np.int8), np.zeros(len(points), bool)  # OUT, which is not written
    cells = motion.copy()  # the same motion, whose result counts cells from the lowest corner
    cells[:, 3] -= looks.low
    cells /= looks.step
    tree = spheres if spheres is not None else Spheres(np.zeros(0, np.int64), np.empty((0, 3)), np.empty(0))
    top = min(_TOP, len(tree.levels) - 2)
    count = -(-len(points) // _RUN) if spheres is None else int(tree.levels[top + 1] - tree.levels[top])
    with threads_for(len(points)):
        _sift(
            count, np.int64(top), *tree, points, motion, cells, reach, 1.0 / looks.step, looks.table, looks.words,
            looks.gap, *slabs, kind, near,
        )  # fmt: skip
    return kind, near


@rows
def _sift(
    first, last, top, levels, centres, radii, points, motion, cells, reach, inverse, table, words, gap, slabs, safe,
    kind, near,
):  # fmt: skip
    """Ask balls for their one colour: spheres of the tree from the top down, then places that may have border near.

    In between, the places of spheres that are not of one colour are settled. All of it stands in one loop because
    numba counts references to arrays at each call, and that takes longer than to ask a ball.
    """
    n = len(points)
    stack, todo = np.empty(_STACK, np.int64), np.empty(_RUN, np.int64)
    left, where = np.empty_like(todo), np.empty((3, len(todo)), np.uint64)
    nx, ny, nz = 8.0 * table.shape[0], 8.0 * table.shape[1], 8.0 * table.shape[2]
    for item in range(first, last):
        height = count = asked = 0
        settled = False
        if top >= 0:
            stack[0], height = (top << 40) | item, 1
        for i in range(item * _RUN if top < 0 else n, min(n, (item + 1) * _RUN)):
            todo[count] = i
            count += 1
        while True:
            if height > 0:
                height -= 1
                level, node = stack[height] >> 40, stack[height] & 0xFFFFFFFFFF
                here = levels[level] + node
                a, b, c = moved_to(cells, centres[here, 0], centres[here, 1], centres[here, 2])
                r = (radii[here] + reach) * inverse + _ROUNDED
            elif not settled:
                settle(todo, count, points, motion, cells, table, words, slabs, safe, kind, near, left, where)
                settled = True
                asked = count if reach > 0.0 else 0
                continue
            elif asked > 0:
                asked -= 1
                level, node = -1, todo[asked]
                if near[node]:
                    continue
                a, b, c = moved_to(cells, points[node, 0], points[node, 1], points[node, 2])
                r = reach * inverse + _ROUNDED
            else:
                break

            colour = -1  # the one colour of all cells that the box round the ball meets, or BORDER
            if a + r < 0.0 or b + r < 0.0 or c + r < 0.0 or a - r >= nx or b - r >= ny or c - r >= nz:
                colour = OUT
            elif a >= 0.0 and b >= 0.0 and c >= 0.0 and a < nx and b < ny and c < nz:
                u, v, w = np.uint64(np.int64(a)), np.uint64(np.int64(b)), np.uint64(np.int64(c))
                brick = np.int64(table[u >> _U3, v >> _U3, w >> _U3])
                if brick >= 0:
                    row, bit = _U8 * np.uint64(brick) + (u & _U7), _ONE << (_U8 * (v & _U7) + (w & _U7))
                    if words[row, NEAR] & bit:
                        if r >= NEAR_REACH or level >= 0:  # small spheres that are merely near are looked into as well
                            colour = BORDER
                    elif r < NEAR_REACH or (r < REACH and words[row, WIDER] & bit == _NONE):
                        colour = IN if words[row, INSIDE] & bit else OUT
                    elif r >= REACH and words[row, WIDER] & bit:
                        colour = BORDER
                elif r < REACH:
                    colour = -1 - brick
                else:
                    e, f, g = a - np.float64(u & ~_U7), b - np.float64(v & ~_U7), c - np.float64(w & ~_U7)
                    wall = min(min(min(e, 8.0 - e), min(f, 8.0 - f)), min(g, 8.0 - g))
                    if 8.0 * (np.float64(gap[u >> _U3, v >> _U3, w >> _U3]) - 1.0) + wall > r:
                        colour = -1 - brick
            if colour < 0 and 2.0 * r > _TESTED:
                colour = BORDER
            elif colour < 0:  # free cells that fill a box are connected, so they have one colour
                i0, i1 = np.int64(max(a - r, 0.0)), np.int64(min(a + r, nx - 1.0))
                j0, j1 = np.int64(max(b - r, 0.0)), np.int64(min(b + r, ny - 1.0))
                k0, k1 = np.int64(max(c - r, 0.0)), np.int64(min(c + r, nz - 1.0))
                some_border = some_inside = _NONE
                for p in range(i0 >> 3, (i1 >> 3) + 1):
                    for q in range(j0 >> 3, (j1 >> 3) + 1):
                        for s in range(k0 >> 3, (k1 >> 3) + 1):
                            brick = np.int64(table[np.uint64(p), np.uint64(q), np.uint64(s)])
                            if some_border:
                                break
                            if brick < 0:
                                some_inside |= _ONE if brick == ALL_IN else _NONE
                                continue
                            y0, y1 = max(j0 - 8 * q, 0), min(j1 - 8 * q, 7)
                            z0, z1 = max(k0 - 8 * s, 0), min(k1 - 8 * s, 7)
                            mask = _box_mask(y0, y1, z0, z1)
                            for layer in range(max(i0 - 8 * p, 0), min(i1 - 8 * p, 7) + 1):
                                row = np.uint64(8 * brick + layer)
                                some_border |= words[row, BORDERS] & mask
                                some_inside |= words[row, INSIDE] & mask
                free = IN if some_inside else OUT
                colour = BORDER if some_border else free

            if level < 0:
                near[node] = colour == BORDER
            elif colour == IN:
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


@inlined
def _box_mask(y0, y1, z0, z1):
    """Return the word with the bits of y0..y1 and z0..z1 of a layer."""
    row = ((_ONE << np.uint64(z1 - z0 + 1)) - _ONE) << np.uint64(z0)
    bytes_ = ((_FULL >> np.uint64(56 - 8 * (y1 - y0))) << np.uint64(8 * y0)) & _BYTES
    return row * bytes_
