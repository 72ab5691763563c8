"""Tiles: what is kept of a tile of a picture while it is drawn, plane by plane, and how it is read in the end.

A sheet is one side of one leaf. The nearest sheet of a tile is drawn first, and blended at once, on the guess that all
its disks that lie near each other belong together.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import inlined
from surfel.rendering.disks import CREASE, PAINTED
from surfel.rendering.eights import LANES, load, pick, root, store
from surfel.rendering.projection import depth_of
from surfel.rendering.records import COSINE, NX, NY, NZ

THIN = np.float32(0.8)
"""Sheets with less weight than this, where they are seen from their edge, are rims of disks that stick out."""

ALIKE = np.float32(0.7)
"""Near an edge of a cloud, only surfels whose normals make a larger cosine than this are blended."""

NOTHING, SURE, UNSURE, RIM = 0, 1, 2, 3
"""States of a pixel: no splat; one kept for certain; one that a cut may pass; the rim of a disk that sticks out."""

BEST, WHOSE, LIMIT = (np.uint64(k) for k in (1, 2, 3))
"""Planes after that of the depths of what is nearest: which disk it is, and of which sheet; how near another disk may
be for the guess to hold."""
WEIGHTS, BEHIND, AT_X, AT_Y, AT_Z, DOUBT, ABOVE, OFF, RED, GREEN, BLUE = (np.uint64(k) for k in range(4, 15))
"""Sums: of weights, depths and normals; of weights that a cut may pass, heights over it and how far these may be off;
of colors."""
ON_X, ON_Y, ON_Z, SHARP = (np.uint64(k) for k in range(15, 19))
"""Where the guess was wrong: the normal of what is nearest, and the cosine with it from which others are blended."""
PLANES = 19

_EVERY = 8  # disks of which one tells how near a sheet is
_LANES = np.uint64(LANES)
_ZERO, _HALF, _ONE, _TWO, _INF = (np.float32(v) for v in (0.0, 0.5, 1.0, 2.0, np.inf))


@inlined
def sheets_of(begin, turn, end, entries, leaf, points, radii, motions, bounds, near, order):
    """List the sheets of a tile as runs of its entries, and which comes first; return how many there are."""
    sheets, at = 0, begin
    while at < end:
        stop, m = turn if at < turn else end, leaf[entries[at]]
        if leaf[entries[stop - 1]] != m:  # leaves ascend on either side
            last = at
            while stop - last > 1:
                half = (last + stop) // 2
                last, stop = (half, stop) if leaf[entries[half]] == m else (last, half)
        nearest, entry = _INF, at
        while entry < stop:
            i = np.uint64(entries[entry])
            nearest = min(nearest, depth_of(i, m, points, motions) - radii[i])
            entry += _EVERY - entry % _EVERY
        bounds[sheets], near[sheets] = at, nearest
        sheets, at = sheets + 1, stop
    bounds[sheets] = end
    for k in range(sheets):
        j = k
        while j > 0 and near[order[j - 1]] > near[k]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = k
    return sheets


@inlined
def emptied(grid, plane, sheet):
    """Make the planes ready: nothing is near yet, and what comes will be of a sheet."""
    grid[:plane] = _INF
    grid[plane * BEST : plane * WHOSE] = -_ONE
    grid[plane * WHOSE : plane * LIMIT] = np.float32(sheet)
    grid[plane * LIMIT : plane * WEIGHTS] = -_INF
    grid[plane * WEIGHTS : plane * ON_X] = _ZERO


@inlined
def wrongly_guessed(grid, plane, count, sheet, sheets, who, flags, record, xs, ys, wanted, window):
    """Find where the first sheet is hidden or lies over itself, and prepare that to be blended once more.

    ``wanted`` tells of which sheets, ``window`` the first and last column and row. What was guessed right is closed.
    """
    wanted[:sheets] = False
    window[0], window[1], window[2], window[3] = 1 << 20, -1, 1 << 20, -1
    for k in range(np.uint64(count)):
        if not (grid[plane * LIMIT + k] > grid[k] or grid[plane * WHOSE + k] != np.float32(sheet)):
            grid[k] = -_INF
            continue
        j = np.uint64(np.int64(grid[plane * BEST + k]))
        wanted[np.int64(grid[plane * WHOSE + k])] = True
        for p in range(plane * WEIGHTS + k, plane * ON_X + k, plane):
            grid[p] = _ZERO
        sharp = flags[who[j]] & CREASE
        grid[plane * ON_X + k], grid[plane * ON_Y + k] = record[NX, j], record[NY, j]
        grid[plane * ON_Z + k], grid[plane * SHARP + k] = record[NZ, j], ALIKE if sharp else -_TWO
        x, y = np.int64(xs[k] + _HALF), np.int64(ys[k] + _HALF)
        window[0], window[1] = min(window[0], x), max(window[1], x)
        window[2], window[3] = min(window[2], y), max(window[3], y)


@inlined
def divided(grid, plane, count, from_depth):
    """Turn sums to means: depths in the first plane, normals towards the camera, and their signs in ``BEHIND``."""
    for at in range(np.uint64(0), np.uint64(count), _LANES):
        nx, ny, nz = load(grid, plane * AT_X + at), load(grid, plane * AT_Y + at), load(grid, plane * AT_Z + at)
        length = root(nx * nx + ny * ny + nz * nz)
        length = pick(nz > _ZERO, -length, length)
        store(grid, at, load(grid, plane * BEHIND + at) / load(grid, plane * WEIGHTS + at) + from_depth)
        store(grid, plane * AT_X + at, nx / length)
        store(grid, plane * AT_Y + at, ny / length)
        store(grid, plane * AT_Z + at, nz / length)
        store(grid, plane * BEHIND + at, length)


@inlined
def written(
    grid, plane, count, who, record, lines, flags, leaf, row, colors, known_cuts, depth, normal, color,
    out_leaf, out_row, state,
):  # fmt: skip
    """Write what a tile shows to where it belongs in the picture."""
    for k in range(np.uint64(count)):
        if grid[plane * BEST + k] < _ZERO:
            continue
        j = np.uint64(np.int64(grid[plane * BEST + k]))
        i, p, weight = np.uint64(who[j]), np.uint64(lines[k]), grid[plane * WEIGHTS + k]
        if weight < THIN * (_ONE - record[COSINE, j]):
            state[p] = RIM
            continue
        doubt = grid[plane * DOUBT + k] > _ZERO
        if doubt and known_cuts:
            doubt = not grid[plane * ABOVE + k] > grid[plane * OFF + k]
        depth[p], out_leaf[p], out_row[p] = grid[k], leaf[i], row[i]
        sign, nx, ny, nz = (
            grid[plane * BEHIND + k],
            grid[plane * AT_X + k],
            grid[plane * AT_Y + k],
            grid[plane * AT_Z + k],
        )
        if sign == _ZERO:  # normals that cancel
            sign = -_ONE if record[NZ, j] > _ZERO else _ONE
            nx, ny, nz = sign * record[NX, j], sign * record[NY, j], sign * record[NZ, j]
        normal[p, 0], normal[p, 1], normal[p, 2] = nx, ny, nz
        state[p] = UNSURE if doubt else SURE
        if flags[i] & PAINTED:
            mean = _ONE / weight
            color[p, 0] = np.uint8(grid[plane * RED + k] * mean + _HALF)
            color[p, 1] = np.uint8(grid[plane * GREEN + k] * mean + _HALF)
            color[p, 2] = np.uint8(grid[plane * BLUE + k] * mean + _HALF)
        else:
            color[p, 0], color[p, 1], color[p, 2] = colors[i, 0], colors[i, 1], colors[i, 2]
