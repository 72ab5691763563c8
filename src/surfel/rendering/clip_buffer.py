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

from surfel._numba import rows, threads_for
from surfel.rendering.raster import (
    ALIKE,
    BLEND,
    CLIPPED,
    CREASE,
    EDGE,
    ELLIPTIC,
    PIXEL,
    THIN,
    TILE,
    Disks,
    Placed,
    View,
    fragment,
    in_pixels,
    shaped,
)

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
    counts, starts = np.zeros(m, np.int64), np.zeros(m + 1, np.int64)
    with threads_for(100 * m):
        _count(len(tiles), tiles, placed, view, slot, np.int64(len(offsets)), counts)
        np.cumsum(counts, out=starts[1:])
        room = int(starts[-1])
        found = Lists(starts, counts, np.empty(room, np.float32), np.empty(room, np.float32), np.empty(room, np.int32))
        counts[:] = 0
        _gather(len(tiles), tiles, disks, placed, motions, view, slot, offsets, *found)
    return found


def layers_of(disks: Disks, placed: Placed, lists: Lists) -> Layers:
    """Part the fragments of each place into sheets; the lists are sorted and used up by that."""
    m = len(lists.counts)
    found = Layers(
        np.zeros(m, np.int32),
        np.empty((m, MOST, 7), np.float32),
        np.empty((m, MOST), np.int32),
        np.zeros((m, MOST), np.bool_),
    )
    with threads_for(100 * m):
        _part(m, disks, placed, *lists, *found)
    return found


@rows
def _count(first, last, tiles, placed, view, slot, places, counts):
    """Count how many splats may fall on each place: whose boxes hold its pixel."""
    box, runs, entries, width, height = placed.box, placed.starts, placed.entries, view.width, view.height
    across = -(-width // TILE)
    for t in range(first, last):
        tile = tiles[t]
        left, top = (tile % across) * TILE, (tile // across) * TILE
        right, bottom = min(left + TILE, width) - 1, min(top + TILE, height) - 1
        for entry in range(runs[2 * tile], runs[2 * tile + 2]):
            i = entries[entry]
            for y in range(max(top, box[i, 2] - 1), min(bottom, box[i, 3] + 1) + 1):
                for x in range(max(left, box[i, 0] - 1), min(right, box[i, 1] + 1) + 1):
                    k = slot[np.uint64(y * width + x)]
                    if k >= 0:
                        for s in range(places):
                            counts[np.uint64(k * places + s)] += 1


@rows
def _gather(
    first, last, tiles, disks, placed, motions, view, slot, offsets, starts, counts, out_z, out_weight, out_who
):
    """Store the fragments of the chosen pixels of some tiles."""
    record, own, box, _, runs, entries = placed
    flags, leaf, clips, planes = disks.flags, disks.leaf, disks.clips, disks.planes
    slope, cx, cy, width, height = view.slope, view.cx, view.cy, view.width, view.height
    across, places, special = -(-width // TILE), len(offsets), CLIPPED | ELLIPTIC
    for t in range(first, last):
        tile = tiles[t]
        left, top = (tile % across) * TILE, (tile // across) * TILE
        right, bottom = min(left + TILE, width) - 1, min(top + TILE, height) - 1
        for entry in range(runs[2 * tile], runs[2 * tile + 2]):
            i = entries[entry]
            sx, sy, pixel, ez = record[i, 0], record[i, 1], record[i, 2], record[i, 3]
            nx, ny, nz, inverse, bend = record[i, 4], record[i, 5], record[i, 6], record[i, 7], record[i, 10]
            odd = flags[i] & special
            # places lie up to half a pixel off the centres that the box was rounded to
            for y in range(max(top, box[i, 2] - 1), min(bottom, box[i, 3] + 1) + 1):
                for x in range(max(left, box[i, 0] - 1), min(right, box[i, 1] + 1) + 1):
                    k = slot[np.uint64(y * width + x)]
                    if k < 0:
                        continue
                    for s in range(places):
                        fx, fy = np.float32(x) + offsets[s, 0], np.float32(y) + offsets[s, 1]
                        u, z, qx, qy, qz = fragment(fx, fy, sx, sy, pixel, ez, nx, ny, nz, inverse, bend, slope, cx, cy)
                        if odd:
                            u = shaped(u, qx, qy, qz, i, flags, own, leaf, clips, planes, motions)
                        if not u < _ONE:
                            if odd or record[i, 8] >= PIXEL * pixel:
                                continue
                            u = in_pixels(fx, fy, sx, sy)
                            if u >= _ONE:
                                continue
                            z = ez
                        line = k * places + s
                        at = starts[line] + counts[line]
                        out_z[at], out_who[at] = z, i
                        out_weight[at] = (_ONE - u) * (_ONE - u) + np.float32(1e-6)
                        counts[line] += 1


@rows
def _part(first, last, disks, placed, starts, counts, all_z, all_weight, all_who, count, value, winner, unsure):
    """Sort the fragments of some lines by depth and part them into sheets."""
    record, label = placed.record, placed.label
    colors, flags = disks.colors, disks.flags
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
            widest = np.float32(8.0) * record[lead, 8]
            for b in range(a, end):
                i = all_who[b]
                behind = all_z[b] - nearest
                if behind > widest:
                    break
                if i < 0 or label[i] != label[lead] or behind > BLEND * record[i, 8]:
                    continue
                nx, ny, nz = record[i, 4], record[i, 5], record[i, 6]
                if (flags[i] | flags[lead]) & CREASE and (
                    nx * record[lead, 4] + ny * record[lead, 5] + nz * record[lead, 6] < ALIKE
                ):
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
            if total[0] < THIN * (_ONE - abs(record[lead, 9])):
                continue  # the rims of disks that stick out over the silhouette
            mean = _ONE / total[0]
            value[line, found, 0] = nearest + total[1] * mean
            length = math.sqrt(total[2] * total[2] + total[3] * total[3] + total[4] * total[4])
            for k in range(3):
                value[line, found, 1 + k] = total[2 + k] / length if length > _ZERO else record[lead, 4 + k]
                value[line, found, 4 + k] = total[5 + k] * mean
            winner[line, found], unsure[line, found] = lead, doubt
            found += 1
            if not doubt or found == MOST:
                break
        count[line] = found
