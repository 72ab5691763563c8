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

from surfel._numba import inner, rows, threads_for
from surfel.rendering.disks import CREASE, EDGE, Disks
from surfel.rendering.lists import Lists, gathered, in_order, room_for, tables
from surfel.rendering.memory import room
from surfel.rendering.places import Places, chosen
from surfel.rendering.placing import PIXEL, Placed, View
from surfel.rendering.projection import depth_of, height_over, normal_of, projected
from surfel.rendering.raster import BLEND
from surfel.rendering.records import FAR
from surfel.rendering.tiles import ALIKE, THIN

MOST = 6
"""Sheets that are looked at along a line of sight; the first that no cut may pass is the last."""

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


class Layers(NamedTuple):
    """Sheets along lines of sight, nearest first, of each line the first ``number``."""

    number: NDArray[np.int32]  # (m,)
    value: NDArray[np.float32]  # (m, MOST, 7): depth, normal (3), color (3)
    winner: NDArray[np.int32]  # (m, MOST): the nearest surfel of each
    unsure: NDArray[np.bool_]  # (m, MOST): whether a cut may pass it


def peeled(
    disks: Disks, placed: Placed, motions: NDArray[np.float32], view: View, places: Places, rows: NDArray[np.int64]
) -> Layers:
    """Return the sheets at some places, given by their rows, which ascend; those cut away for certain are left out."""
    where, found = chosen(view, places, rows), _room_for(len(rows))
    with threads_for(100 * len(rows)):
        _peel(len(where.tiles), where, disks, placed, motions, view, np.int64(where.most), found)
    return found


def layers_of(
    disks: Disks,
    label: NDArray[np.int32],
    motions: NDArray[np.float32],
    view: View,
    lists: Lists,
    places: Places,
    rows: NDArray[np.int64],
) -> Layers:
    """Part the fragments of each place into sheets; the lists are sorted and used up by that."""
    m = len(lists.counts)
    found, (x, y) = _room_for(m), places.columns_and_rows(view.width, rows)
    with threads_for(100 * m):
        _part(m, np.arange(m), x.astype(np.float32), y.astype(np.float32), disks, label, motions, view, lists, found)
    return found


def _room_for(m: int) -> Layers:
    return Layers(
        np.zeros(m, np.int32),
        room((m, MOST, 7), np.float32),
        np.empty((m, MOST), np.int32),
        np.zeros((m, MOST), np.bool_),
    )


@rows
def _peel(first, last, where, disks, placed, motions, view, most, layers):
    """List the fragments of some tiles and part them into sheets, tile by tile."""
    table, found, sorted_ones = tables(most), room_for(0), room_for(0)
    for t in range(first, last):
        count, number, found = gathered(where, t, disks, placed, motions, view, table, found)
        if number > len(sorted_ones.z):
            sorted_ones = room_for(2 * number)
        z, weight, who = sorted_ones.z, sorted_ones.weight, sorted_ones.who
        in_order(count, number, found, 0, table, z, weight, who)
        parted(
            0, count, table.lines, table.xs, table.ys, table.starts, table.counts, z, weight, who, disks, placed.label,
            motions, view, layers,
        )  # fmt: skip


@rows
def _part(first, last, lines, xs, ys, disks, label, motions, view, lists, layers):
    parted(
        first, last, lines, xs, ys, lists.starts, lists.counts, lists.z, lists.weight, lists.who, disks, label, motions,
        view, layers,
    )  # fmt: skip


@inner
def parted(
    first, last, lines, xs, ys, starts, counts, all_z, all_weight, all_who, disks, label, motions, view, layers
):  # fmt: skip
    """Sort the fragments of some places by depth and part them into sheets."""
    points, normals, radii, leaf, colors, flags = (
        disks.points, disks.normals, disks.radii, disks.leaf, disks.colors, disks.flags
    )  # fmt: skip
    value, winner, unsure = layers.value, layers.winner, layers.unsure
    slope, middle, size, cx, cy = view.slope, view.depth, view.size, view.cx, view.cy
    total, cuts = np.empty(8, np.float32), disks.cuts
    for place in range(first, last):
        begin, end, line = starts[place], starts[place] + counts[place], lines[place]
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
        found, across, down = 0, xs[place] - cx, ys[place] - cy
        for a in range(begin, end):
            lead = all_who[a]
            if lead < 0:
                continue
            nearest, doubt, above, off = all_z[a], False, _ZERO, _ZERO
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
                all_who[b] = -1
                if flags[i] & EDGE:
                    doubt = True
                    if len(cuts) > 0:
                        z = all_z[b]
                        wide = (middle + z) * slope if slope > _ZERO else size
                        above += weight * height_over(i, across * wide, down * wide, z, cuts, points, leaf, motions)
                        off += weight * (cuts[i, 4] if radii[i] >= PIXEL * wide else FAR)
            ez = depth_of(lead, leaf[lead], points, motions)
            cosine = projected(lead, leaf[lead], ez, tx, ty, tz, points, motions, slope, middle, size, cx, cy)[3]
            if total[0] < THIN * (_ONE - cosine):
                continue  # the rims of disks that stick out over the silhouette
            if doubt and -above > off:
                continue
            doubt = doubt and not above > off
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
        layers.number[line] = found
