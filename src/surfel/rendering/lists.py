"""Lists: all fragments of chosen places, as Wicke's clip buffer keeps them (Gaal, sec. 4.3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.rendering.disks import CLIPPED, ELLIPTIC, Disks
from surfel.rendering.eights import LANES, load, pick, some, store
from surfel.rendering.places import STRIDE, Places, chosen, listed, touched
from surfel.rendering.placing import PIXEL, TILE, Placed, View
from surfel.rendering.projection import depth_of, felt, fragment, in_pixels, normal_of, projected, shaped
from surfel.rendering.raster import LEAST

_ONE = np.float32(1.0)


class Lists(NamedTuple):
    """The fragments of each place: rows ``starts[line]`` up to ``starts[line] + counts[line]``."""

    starts: NDArray[np.int64]
    counts: NDArray[np.int64]
    z: NDArray[np.float32]
    weight: NDArray[np.float32]
    who: NDArray[np.int32]  # the surfel; -1 for one that was taken out


def lists_at(disks: Disks, placed: Placed, motions: NDArray[np.float32], view: View, places: Places) -> Lists:
    """Return all fragments at places, in no order.

    Parameters
    ----------
    disks, placed, motions, view
        As drawn.
    places : Places
        In chosen pixels, each of them once.
    """
    where = chosen(view, places)
    m, tiles = where.number, where.tiles
    room, first = np.zeros(len(tiles), np.int64), np.zeros(len(tiles) + 1, np.int64)
    shape = (where.slot, where.offsets, np.int64(where.reach), np.int64(where.most))
    with threads_for(100 * m):
        _bound(len(tiles), tiles, placed, view, *shape, room)
        np.cumsum(room, out=first[1:])
        most = int(first[-1])
        found = Lists(
            np.zeros(m, np.int64), np.zeros(m, np.int64),
            np.empty(most, np.float32), np.empty(most, np.float32), np.empty(most, np.int32),
        )  # fmt: skip
        _gather(len(tiles), tiles, disks, placed, motions, view, *shape, first, *found)
    return found


@rows
def _bound(first, last, tiles, placed, view, slot, offsets, reach, most, room):
    """Tell how many fragments there are at most in some tiles."""
    box, runs, entries, width, height = placed.box, placed.starts, placed.entries, view.width, view.height
    across = -(-width // TILE)
    begins, sums = np.empty(TILE * (TILE + 1), np.int32), np.zeros((TILE + 1) * (TILE + 1), np.int32)
    lines, xs, ys = np.empty(most, np.int64), np.empty(most, np.float32), np.empty(most, np.float32)
    for t in range(first, last):
        tile = tiles[t]
        left, top = (tile % across) * TILE, (tile // across) * TILE
        right, bottom = min(left + TILE, width) - 1, min(top + TILE, height) - 1
        listed(slot, left, right, top, bottom, width, offsets, begins, sums, lines, xs, ys)
        total = 0
        for entry in range(runs[2 * tile], runs[2 * tile + 2]):
            total += touched(np.uint64(entries[entry]), box, reach, left, right, top, bottom, sums)[4]
        room[t] = total * len(offsets)


@rows
def _gather(
    first,
    last,
    tiles,
    disks,
    placed,
    motions,
    view,
    slot,
    offsets,
    reach,
    most,
    begin_of,
    starts,
    counts,
    out_z,
    out_weight,
    out_who,
):
    """Store the fragments at the places in some tiles, place after place."""
    box, runs, entries = placed.box, placed.starts, placed.entries
    points, normals, radii, bends = disks.points, disks.normals, disks.radii, disks.bends
    flags, leaf, clips, planes, own = disks.flags, disks.leaf, disks.clips, disks.planes, disks.axes
    slope, middle, size, cx, cy, width, height = (
        view.slope, view.depth, view.size, view.cx, view.cy, view.width, view.height
    )  # fmt: skip
    across, special = -(-width // TILE), CLIPPED | ELLIPTIC
    zero = np.uint64(0)
    begins, lines = np.empty(TILE * (TILE + 1), np.int32), np.empty(most, np.int64)
    sums = np.zeros((TILE + 1) * (TILE + 1), np.int32)
    xs, ys, lanes = np.zeros(most, np.float32), np.zeros(most, np.float32), np.empty(2 * LANES, np.float32)
    for t in range(first, last):
        tile = tiles[t]
        left, top = (tile % across) * TILE, (tile // across) * TILE
        right, bottom = min(left + TILE, width) - 1, min(top + TILE, height) - 1
        listed(slot, left, right, top, bottom, width, offsets, begins, sums, lines, xs, ys)
        room, found = begin_of[t + 1] - begin_of[t], 0
        z_here, weight_here = np.empty(room, np.float32), np.empty(room, np.float32)
        who_here, line_here = np.empty(room, np.int32), np.empty(room, np.int64)
        for entry in range(runs[2 * tile], runs[2 * tile + 2]):
            i = np.uint64(entries[entry])
            x0, x1, y0, y1, held = touched(i, box, reach, left, right, top, bottom, sums)
            if held == 0:
                continue
            m, r, odd = leaf[i], radii[i], flags[i] & special
            ez = depth_of(i, m, points, motions)
            nx, ny, nz = normal_of(i, m, normals, motions)
            sx, sy, pixel, cosine = projected(i, m, ez, nx, ny, nz, points, motions, slope, middle, size, cx, cy)
            inverse, bend = _ONE / (r * r), felt(bends[i], r, cosine, pixel, slope)
            for y in range(y0, y1, STRIDE):
                end = begins[y + x1]
                for begin in range(begins[y + x0], end, LANES):
                    fx, fy = load(xs, np.uint64(begin)), load(ys, np.uint64(begin))
                    u, z, qx, qy, qz = fragment(fx, fy, sx, sy, pixel, ez, nx, ny, nz, inverse, bend, slope, cx, cy)
                    if odd:
                        u = shaped(u, qx, qy, qz, i, flags, own, leaf, clips, planes, motions)
                    elif r < PIXEL * pixel:
                        inside = u < _ONE
                        u, z = pick(inside, u, in_pixels(fx, fy, sx, sy)), pick(inside, z, ez)
                    if not some(u < _ONE):
                        continue
                    store(lanes, zero, u)
                    store(lanes, np.uint64(LANES), z)
                    for h in range(min(LANES, end - begin)):
                        if not lanes[h] < _ONE:
                            continue
                        z_here[found], who_here[found], line_here[found] = lanes[LANES + h], i, lines[begin + h]
                        weight_here[found] = (_ONE - lanes[h]) * (_ONE - lanes[h]) + LEAST
                        counts[lines[begin + h]] += 1
                        found += 1
        at = begin_of[t]
        for k in range(begins[(TILE + 1) * (bottom - top) + right + 1 - left]):
            starts[lines[k]] = at
            at += counts[lines[k]]
            counts[lines[k]] = 0
        for k in range(found):
            line = line_here[k]
            at = starts[line] + counts[line]
            out_z[at], out_weight[at], out_who[at] = z_here[k], weight_here[k], who_here[k]
            counts[line] += 1
