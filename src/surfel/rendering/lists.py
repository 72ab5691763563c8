"""Lists: all fragments of chosen places, as Wicke's clip buffer keeps them (Gaal, sec. 4.3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, rows, threads_for
from surfel.rendering.disks import CLIPPED, EDGE, ELLIPTIC, Disks
from surfel.rendering.eights import LANES, load, pick, some, store
from surfel.rendering.places import STRIDE, Places, chosen, listed, touched
from surfel.rendering.placing import PIXEL, TILE, Placed, View
from surfel.rendering.projection import depth_of, felt, fragment, in_pixels, normal_of, projected, shaped, turned
from surfel.rendering.raster import LEAST
from surfel.rendering.records import BEYOND, FAR

_ZERO, _ONE, _TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)


class Lists(NamedTuple):
    """The fragments of each place: rows ``starts[line]`` up to ``starts[line] + counts[line]``."""

    starts: NDArray[np.int64]
    counts: NDArray[np.int64]
    z: NDArray[np.float32]
    weight: NDArray[np.float32]
    who: NDArray[np.int32]  # the surfel; -1 for one that was taken out


def lists_at(
    disks: Disks,
    placed: Placed,
    motions: NDArray[np.float32],
    view: View,
    places: Places,
    rows: NDArray[np.int64] | None = None,
) -> Lists:
    """Return all fragments at places, in no order.

    Parameters
    ----------
    disks, placed, motions, view
        As drawn.
    places : Places
        In chosen pixels.
    rows : NDArray[np.int64], optional
        Which of these places, ascending; by default all.
    """
    where = chosen(view, places, rows)
    m, tiles = where.number, where.tiles
    room, first = np.zeros(len(tiles), np.int64), np.zeros(len(tiles) + 1, np.int64)
    with threads_for(100 * m):
        _bound(len(tiles), where, placed, view, np.int64(where.most), room)
        np.cumsum(room, out=first[1:])
        most = int(first[-1])
        found = Lists(
            np.zeros(m, np.int64), np.zeros(m, np.int64),
            np.empty(most, np.float32), np.empty(most, np.float32), np.empty(most, np.int32),
        )  # fmt: skip
        _gather(len(tiles), where, disks, placed, motions, view, np.int64(where.most), first, found)
    return found


class Tables(NamedTuple):
    """What a thread needs to list the places of a tile and their fragments."""

    begins: NDArray[np.int32]
    sums: NDArray[np.int32]
    lines: NDArray[np.int64]  # of each place, its number
    xs: NDArray[np.float32]
    ys: NDArray[np.float32]
    starts: NDArray[np.int64]  # of each place, where its fragments begin, and how many they are
    counts: NDArray[np.int64]
    lanes: NDArray[np.float32]


@inner
def tables(most):
    """Return room for places and their fragments."""
    return Tables(
        np.empty(TILE * (TILE + 1), np.int32), np.zeros((TILE + 1) * (TILE + 1), np.int32), np.empty(most, np.int64),
        np.zeros(most, np.float32), np.zeros(most, np.float32), np.empty(most, np.int64), np.empty(most, np.int64),
        np.empty(2 * LANES, np.float32),
    )  # fmt: skip


class Found(NamedTuple):
    """Fragments as they are found: of which place of the tile, how deep, of what weight, and of which surfel."""

    line: NDArray[np.int32]
    z: NDArray[np.float32]
    weight: NDArray[np.float32]
    who: NDArray[np.int32]


@inner
def room_for(number):
    """Return room for so many fragments."""
    return Found(
        np.empty(number, np.int32), np.empty(number, np.float32), np.empty(number, np.float32),
        np.empty(number, np.int32),
    )  # fmt: skip


@rows
def _bound(first, last, where, placed, view, most, room):
    """Tell how many fragments there are at most in some tiles."""
    box, runs, entries, width, height = placed.box, placed.starts, placed.entries, view.width, view.height
    across, table = -(-width // TILE), tables(most)
    for t in range(first, last):
        tile = where.tiles[t]
        left, top = (tile % across) * TILE, (tile // across) * TILE
        right, bottom = min(left + TILE, width) - 1, min(top + TILE, height) - 1
        listed(
            where.pixels, where.rank, left, right, top, bottom, width, where.offsets, table.begins, table.sums,
            table.lines, table.xs, table.ys,
        )  # fmt: skip
        total = 0
        for entry in range(runs[2 * tile], runs[2 * tile + 2]):
            i = np.uint64(entries[entry])
            total += touched(i, box, where.reach, left, right, top, bottom, table.sums)[4]
        room[t] = total * len(where.offsets)


@rows
def _gather(first, last, where, disks, placed, motions, view, most, begin_of, lists):
    """Store the fragments at the places in some tiles, place after place."""
    table, found = tables(most), room_for(0)
    for t in range(first, last):
        count, number, found = gathered(where, t, disks, placed, motions, view, table, found)
        in_order(count, number, found, begin_of[t], table, lists.z, lists.weight, lists.who)
        for k in range(count):
            lists.starts[table.lines[k]], lists.counts[table.lines[k]] = table.starts[k], table.counts[k]


@inner
def gathered(where, t, disks, placed, motions, view, table, found):
    """Find the fragments at the places in a tile; return how many places and fragments there are, and these."""
    box, runs, entries = placed.box, placed.starts, placed.entries
    points, normals, radii, bends, cuts = disks.points, disks.normals, disks.radii, disks.bends, disks.cuts
    flags, leaf, clips, planes, own = disks.flags, disks.leaf, disks.clips, disks.planes, disks.axes
    slope, middle, size, cx, cy, width, height = (
        view.slope, view.depth, view.size, view.cx, view.cy, view.width, view.height
    )  # fmt: skip
    begins, sums, lines, xs, ys, _, counts, lanes = table
    line_here, z_here, weight_here, who_here = found
    special, known_cuts, zero, reach = CLIPPED | ELLIPTIC, len(cuts) > 0, np.uint64(0), where.reach
    across, tile = -(-width // TILE), where.tiles[t]
    left, top = (tile % across) * TILE, (tile // across) * TILE
    right, bottom = min(left + TILE, width) - 1, min(top + TILE, height) - 1
    count = listed(
        where.pixels, where.rank, left, right, top, bottom, width, where.offsets, begins, sums, lines, xs, ys
    )
    counts[:count] = 0
    number = 0
    for entry in range(runs[2 * tile], runs[2 * tile + 2]):
        i = np.uint64(entries[entry])
        x0, x1, y0, y1, held = touched(i, box, reach, left, right, top, bottom, sums)
        if held == 0:
            continue
        if number + held * len(where.offsets) > len(z_here):
            more = room_for(2 * (number + held * len(where.offsets)) + 1024)
            more.line[:number], more.z[:number] = line_here[:number], z_here[:number]
            more.weight[:number], more.who[:number] = weight_here[:number], who_here[:number]
            line_here, z_here, weight_here, who_here = more
        m, r, odd = leaf[i], radii[i], flags[i] & special
        ez = depth_of(i, m, points, motions)
        nx, ny, nz = normal_of(i, m, normals, motions)
        sx, sy, pixel, cosine = projected(i, m, ez, nx, ny, nz, points, motions, slope, middle, size, cx, cy)
        inverse, bend = _ONE / (r * r), felt(bends[i], r, cosine, pixel, slope)
        cut_x = cut_y = cut_z = cut_at = beyond = _ZERO
        cut = known_cuts and flags[i] & EDGE
        if cut:
            cut_x, cut_y, cut_z = turned(m, cuts[i, 0], cuts[i, 1], cuts[i, 2], motions)
            cut_at = cuts[i, 3]
            beyond = -BEYOND * (cuts[i, 4] if r >= PIXEL * pixel else FAR) - bends[i] * r * r
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
                if cut:  # as while drawing
                    u = pick(cut_x * qx + cut_y * qy + cut_z * qz + cut_at < beyond, _TWO, u)
                if not some(u < _ONE):
                    continue
                store(lanes, zero, u)
                store(lanes, np.uint64(LANES), z)
                for h in range(min(LANES, end - begin)):
                    if not lanes[h] < _ONE:
                        continue
                    z_here[number], who_here[number], line_here[number] = lanes[LANES + h], i, begin + h
                    weight_here[number] = (_ONE - lanes[h]) * (_ONE - lanes[h]) + LEAST
                    counts[begin + h] += 1
                    number += 1
    return count, number, Found(line_here, z_here, weight_here, who_here)


@inner
def in_order(count, number, found, begin, table, z, weight, who):
    """Write the fragments of a tile place after place, from ``begin`` on."""
    starts, counts = table.starts, table.counts
    for k in range(count):
        starts[k] = begin
        begin += counts[k]
        counts[k] = 0
    for j in range(number):
        k = found.line[j]
        at = starts[k] + counts[k]
        z[at], weight[at], who[at] = found.z[j], found.weight[j], found.who[j]
        counts[k] += 1
