"""The clip buffer: all fragments of chosen pixels, nearest first, gathered into the sheets that a line of sight passes.

Where a cut may pass a pixel, what is nearest may not be what is seen. Wicke et al. (*CSG-Tree Rendering for
Point-Sampled Objects*; Gaal, sec. 4.3) keep there a list of the surfels that fall on the pixel and clip them by each
other. Here the list is first blended to sheets, and the tree is asked once for the blended point of each, so that the
edge of a cut does not show the disks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, rows, threads_for
from surfel.rendering.disks import CLIPPED, CREASE, EDGE, ELLIPTIC, Disks
from surfel.rendering.eights import LANES, load, pick, some, store
from surfel.rendering.placing import PIXEL, TILE, Placed, View
from surfel.rendering.projection import depth_of, felt, fragment, in_pixels, normal_of, projected, shaped_eight
from surfel.rendering.raster import ALIKE, BLEND, LEAST, THIN

MOST = 6
"""Sheets that are looked at along a line of sight; the first that no cut may pass is the last."""

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


class Layers(NamedTuple):
    """Sheets along lines of sight, nearest first, of each line the first ``number``."""

    number: NDArray[np.int32]  # (m,)
    value: NDArray[np.float32]  # (m, MOST, 7): depth, normal (3), color (3)
    winner: NDArray[np.int32]  # (m, MOST): the nearest surfel of each
    unsure: NDArray[np.bool_]  # (m, MOST): whether a cut may pass it


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
    pixels: NDArray[np.int64],
    offsets: NDArray[np.float32],
) -> Lists:
    """Return all fragments at places in chosen pixels, in no order.

    Parameters
    ----------
    disks, placed, motions, view
        As drawn.
    pixels : NDArray[np.int64], shape (p,)
        Numbers of pixels, row after row; each once.
    offsets : NDArray[np.float32], shape (s, 2)
        Places in each pixel, from its centre; line k s + i is the i-th place of the k-th pixel.
    """
    m = len(pixels) * len(offsets)
    slot = np.full(view.width * view.height, -1, np.int32)
    slot[pixels] = np.arange(len(pixels), dtype=np.int32)
    across = -(-view.width // TILE)
    tiles = np.unique((pixels // view.width // TILE) * across + pixels % view.width // TILE)
    room, first = np.zeros(len(tiles), np.int64), np.zeros(len(tiles) + 1, np.int64)
    with threads_for(100 * m):
        _bound(len(tiles), tiles, placed, view, slot, offsets, room)
        np.cumsum(room, out=first[1:])
        most = int(first[-1])
        found = Lists(
            np.zeros(m, np.int64), np.zeros(m, np.int64),
            np.empty(most, np.float32), np.empty(most, np.float32), np.empty(most, np.int32),
        )  # fmt: skip
        _gather(len(tiles), tiles, disks, placed, motions, view, slot, offsets, first, *found)
    return found


def layers_of(disks: Disks, placed: Placed, motions: NDArray[np.float32], view: View, lists: Lists) -> Layers:
    """Part the fragments of each place into sheets; the lists are sorted and used up by that."""
    m = len(lists.counts)
    found = Layers(
        np.zeros(m, np.int32),
        np.empty((m, MOST, 7), np.float32),
        np.empty((m, MOST), np.int32),
        np.zeros((m, MOST), np.bool_),
    )
    with threads_for(100 * m):
        _part(m, disks, placed.label, motions, view, *lists, *found)
    return found


@inlined
def _listed(slot, left, right, top, bottom, width, offsets, begins, sums, lines, xs, ys):
    """List the places of a tile row after row.

    ``begins[33 y + x]`` is how many come before a pixel, ``sums[33 y + x]`` how many chosen pixels lie above and to the
    left of it.
    """
    count, places = 0, len(offsets)
    for y in range(top, bottom + 1):
        at, total = np.uint64((TILE + 1) * (y - top)), 0
        for x in range(np.uint64(right + 1 - left)):
            begins[at + x] = count
            sums[at + np.uint64(TILE + 1) + x] = sums[at + x] + total
            k = slot[np.uint64(y * width + left) + x]
            if k >= 0:
                total += 1
                for s in range(places):
                    lines[count], xs[count], ys[count] = (
                        k * places + s, np.float32(np.int64(x) + left) + offsets[s, 0], np.float32(y) + offsets[s, 1]
                    )  # fmt: skip
                    count += 1
        x = np.uint64(right + 1 - left)
        begins[at + x] = count
        sums[at + np.uint64(TILE + 1) + x] = sums[at + x] + total


@inlined
def _touched(i, box, left, right, top, bottom, sums):
    """Return the part of a tile that a splat may fall on, its border moved out, and how many chosen pixels it holds."""
    # places lie up to half a pixel off the centres that the box was rounded to
    stride = np.uint64(TILE + 1)
    x0 = np.uint64(max(left, np.int64(box[i, 0]) - 1) - left)
    x1 = np.uint64(min(right, np.int64(box[i, 1]) + 1) - left + 1)
    y0 = np.uint64(max(top, np.int64(box[i, 2]) - 1) - top) * stride
    y1 = np.uint64(min(bottom, np.int64(box[i, 3]) + 1) - top + 1) * stride
    return x0, x1, y0, y1, sums[y1 + x1] - sums[y1 + x0] - sums[y0 + x1] + sums[y0 + x0]


@rows
def _bound(first, last, tiles, placed, view, slot, offsets, room):
    """Tell how many fragments there are at most in some tiles."""
    box, runs, entries, width, height = placed.box, placed.starts, placed.entries, view.width, view.height
    across, most = -(-width // TILE), TILE * TILE * len(offsets) + LANES
    begins, sums = np.empty(TILE * (TILE + 1), np.int32), np.zeros((TILE + 1) * (TILE + 1), np.int32)
    lines, xs, ys = np.empty(most, np.int64), np.empty(most, np.float32), np.empty(most, np.float32)
    for t in range(first, last):
        tile = tiles[t]
        left, top = (tile % across) * TILE, (tile // across) * TILE
        right, bottom = min(left + TILE, width) - 1, min(top + TILE, height) - 1
        _listed(slot, left, right, top, bottom, width, offsets, begins, sums, lines, xs, ys)
        total = 0
        for entry in range(runs[2 * tile], runs[2 * tile + 2]):
            total += _touched(np.uint64(entries[entry]), box, left, right, top, bottom, sums)[4]
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
    most, zero, stride = TILE * TILE * len(offsets) + LANES, np.uint64(0), np.uint64(TILE + 1)
    begins, lines = np.empty(TILE * (TILE + 1), np.int32), np.empty(most, np.int64)
    sums = np.zeros((TILE + 1) * (TILE + 1), np.int32)
    xs, ys, lanes = np.zeros(most, np.float32), np.zeros(most, np.float32), np.empty(4 * LANES, np.float32)
    for t in range(first, last):
        tile = tiles[t]
        left, top = (tile % across) * TILE, (tile // across) * TILE
        right, bottom = min(left + TILE, width) - 1, min(top + TILE, height) - 1
        _listed(slot, left, right, top, bottom, width, offsets, begins, sums, lines, xs, ys)
        room, found = begin_of[t + 1] - begin_of[t], 0
        z_here, weight_here = np.empty(room, np.float32), np.empty(room, np.float32)
        who_here, line_here = np.empty(room, np.int32), np.empty(room, np.int64)
        for entry in range(runs[2 * tile], runs[2 * tile + 2]):
            i = np.uint64(entries[entry])
            x0, x1, y0, y1, touched = _touched(i, box, left, right, top, bottom, sums)
            if touched == 0:
                continue
            m, r, odd = leaf[i], radii[i], flags[i] & special
            ez = depth_of(i, m, points, motions)
            nx, ny, nz = normal_of(i, m, normals, motions)
            sx, sy, pixel, cosine = projected(i, m, ez, nx, ny, nz, points, motions, slope, middle, size, cx, cy)
            inverse, bend = _ONE / (r * r), felt(bends[i], r, cosine, pixel, slope)
            for y in range(y0, y1, stride):
                end = begins[y + x1]
                for begin in range(begins[y + x0], end, LANES):
                    fx, fy = load(xs, np.uint64(begin)), load(ys, np.uint64(begin))
                    u, z, qx, qy, qz = fragment(fx, fy, sx, sy, pixel, ez, nx, ny, nz, inverse, bend, slope, cx, cy)
                    if odd:
                        u = shaped_eight(u, qx, qy, qz, i, flags, own, leaf, clips, planes, motions, lanes)
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


@rows
def _part(
    first, last, disks, label, motions, view, starts, counts, all_z, all_weight, all_who, count, value, winner, unsure
):
    """Sort the fragments of some lines by depth and part them into sheets."""
    points, normals, radii, leaf, colors, flags = (
        disks.points, disks.normals, disks.radii, disks.leaf, disks.colors, disks.flags
    )  # fmt: skip
    slope, middle, size, cx, cy = view.slope, view.depth, view.size, view.cx, view.cy
    total = np.empty(8, np.float32)
    for line in range(first, last):
        begin, end = starts[line], starts[line] + counts[line]
        gap = 1
        while gap < (end - begin) // 9:
            gap = 3 * gap + 1
        while gap > 0:  # Shell's sort; surfels break ties, so that the order is always the same
            for a in range(begin + gap, end):
                z, weight, who = all_z[a], all_weight[a], all_who[a]
                b = a
                while b >= begin + gap and (all_z[b - gap] > z or (all_z[b - gap] == z and all_who[b - gap] > who)):
                    all_z[b], all_weight[b], all_who[b] = all_z[b - gap], all_weight[b - gap], all_who[b - gap]
                    b -= gap
                all_z[b], all_weight[b], all_who[b] = z, weight, who
            gap //= 3
        found = 0
        for a in range(begin, end):
            lead = all_who[a]
            if lead < 0:
                continue
            nearest, doubt = all_z[a], False
            total[:] = _ZERO
            widest = np.float32(8.0) * radii[lead]
            tx, ty, tz = normal_of(lead, leaf[lead], normals, motions)
            for b in range(a, end):
                i = all_who[b]
                behind = all_z[b] - nearest
                if behind > widest:
                    break
                if i < 0 or label[i] != label[lead] or behind > BLEND * radii[i]:
                    continue
                nx, ny, nz = normal_of(i, leaf[i], normals, motions)
                if (flags[i] | flags[lead]) & CREASE and nx * tx + ny * ty + nz * tz < ALIKE:
                    continue
                weight = all_weight[b]
                total[0] += weight
                total[1] += weight * behind
                total[2] += weight * nx
                total[3] += weight * ny
                total[4] += weight * nz
                for k in range(3):
                    total[5 + k] += weight * np.float32(colors[i, k])
                doubt = doubt or flags[i] & EDGE != 0
                all_who[b] = -1
            ez = depth_of(lead, leaf[lead], points, motions)
            cosine = projected(lead, leaf[lead], ez, tx, ty, tz, points, motions, slope, middle, size, cx, cy)[3]
            if total[0] < THIN * (_ONE - cosine):
                continue  # the rims of disks that stick out over the silhouette
            mean = _ONE / total[0]
            value[line, found, 0] = nearest + total[1] * mean
            length = math.sqrt(total[2] * total[2] + total[3] * total[3] + total[4] * total[4])
            if not length > _ZERO:
                total[2], total[3], total[4], length = tx, ty, tz, _ONE
            for k in range(3):
                value[line, found, 1 + k] = total[2 + k] / length
                value[line, found, 4 + k] = total[5 + k] * mean
            winner[line, found], unsure[line, found] = lead, doubt
            found += 1
            if not doubt or found == MOST:
                break
        count[line] = found
