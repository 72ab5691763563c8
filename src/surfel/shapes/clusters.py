"""LPSI, the intersection of a line and a point set: points in a cylinder round a line, in clusters along it.

Liu, Yong, Zhang, Yan and Sun, *A quasi-Monte Carlo method for computing areas of point-sampled surfaces*,
Computer-Aided Design 38, 2006, section 3. Where the text leaves a choice, :class:`Reading` names it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, rows, threads_for
from surfel.core.cast import Floats
from surfel.core.lines import Lines
from surfel.index.octree import STACK, PointOctree, leaves_on_line

CELLS = ("line", "cylinder")
HALVES = ("two", "again", "sides")

_ROOM = 1024  # for inclusion points; more is made where a line meets more
_ON_LINE = 1e-12  # of the radius: how near to the line a point lies that is on it


class Reading(NamedTuple):
    """How section 3 is read where it can be read in more than one way.

    Parameters
    ----------
    cells : {"line", "cylinder"}
        Whose points are looked at: those of the boundary cells that the line meets, as the text has it, or those of
        all cells that the cylinder meets, so that the octree changes nothing but the time.
    halves : {"two", "again", "sides"}
        What case 4 makes of a cluster. Two clusters, split at the first point whose normal is on the other side of
        the plane S_p than that of the first point ("two"); the same, but a half that is outside as a whole is removed
        by case 1 ("again"); or one cluster of the points on either side, each of them subject to case 1 ("sides").
    """

    cells: str = "line"
    halves: str = "again"


def clusters_on_lines(
    lines: Lines, tree: PointOctree, normals: Floats, radii: Floats, reading: Reading, *, single: bool, places: bool
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return the resultant clusters of every line as compressed rows.

    Parameters
    ----------
    lines : Lines
        In the coordinates of the tree.
    tree : PointOctree
        Of the points.
    normals : Floats, shape (n, 3)
        Unit normals, in the order of the tree.
    radii : Floats, shape (leaves,)
        Radius of the cylinder in each leaf.
    reading : Reading
        Of the text.
    single : bool
        Only the first cluster of a line, whatever its case, placed as Schaufler and Jensen do.
    places : bool
        Whether positions are wanted, or numbers alone.

    Returns
    -------
    offsets : NDArray[np.int64], shape (m + 1,)
        The clusters of line l are the rows ``offsets[l]:offsets[l + 1]``.
    t, cosine : Floats, shape (k,)
        Position along the line (equation (6)), and mean of direction . normal; empty where only numbers are wanted.
    """
    total, nothing = len(lines), np.empty(0)
    offsets = np.zeros(total + 1, np.int64)
    arguments = (
        np.ascontiguousarray(lines.origins), np.ascontiguousarray(lines.directions), tree.middle, tree.half, tree.first,
        tree.child, np.int64(tree.leaves), tree.points, normals, np.repeat(radii, tree.counts), float(radii.max()),
        np.int64(CELLS.index(reading.cells)), np.int64(HALVES.index(reading.halves)), single, offsets,
    )  # fmt: skip
    with threads_for(64 * total):
        _cross(total, *arguments, False, nothing, nothing)
        np.cumsum(offsets, out=offsets)
        if not places:
            return offsets, nothing, nothing
        t, cosine = np.empty(offsets[-1]), np.empty(offsets[-1])
        _cross(total, *arguments, True, t, cosine)
    return offsets, t, cosine


@rows
def _cross(
    first, last, origins, directions, middle, half, starts, child, leaf_count, points, normals, reach, widest,
    all_cells, halves, single, offsets, write, places, cosines,
):  # fmt: skip
    """Count the clusters of each line into ``offsets``, or write them from there on."""
    stack, leaves = np.empty(STACK, np.int32), np.empty(leaf_count + 1, np.int32)
    ts, ids = np.empty(_ROOM), np.empty(_ROOM, np.int32)
    grown = widest if all_cells else 0.0
    for line in range(first, last):
        ox, oy, oz = origins[line, 0], origins[line, 1], origins[line, 2]
        dx, dy, dz = directions[line, 0], directions[line, 1], directions[line, 2]
        met = leaves_on_line(middle, half, child, ox, oy, oz, dx, dy, dz, grown, stack, leaves)
        m = 0
        for k in range(met):
            cell = leaves[k]
            begin, end = starts[cell], starts[cell + 1]
            if m + end - begin >= len(ts):
                room = 2 * (m + end - begin + 1)
                more_ts, more_ids = np.empty(room), np.empty(room, np.int32)
                more_ts[:m], more_ids[:m] = ts[:m], ids[:m]
                ts, ids = more_ts, more_ids
            square = reach[begin] * reach[begin]  # one for all points of a cell
            for i in range(begin, end):
                x, y, z = points[i, 0] - ox, points[i, 1] - oy, points[i, 2] - oz
                t = x * dx + y * dy + z * dz
                x, y, z = x - t * dx, y - t * dy, z - t * dz
                ts[m], ids[m] = t, i
                m += x * x + y * y + z * z < square  # kept or written over: no branch to be foreseen
        _sort(ts, ids, m)
        at = offsets[line]
        found = 0
        begin = 0
        while begin < m:
            end = begin + 1
            while end < m and ts[end] - ts[end - 1] <= reach[ids[end]] + reach[ids[end - 1]]:
                end += 1
            if single:
                if write:
                    places[at], cosines[at] = _disks(
                        ox, oy, oz, dx, dy, dz, points, normals, ts, ids, reach, begin, end
                    )
                found = 1
                break
            # which projections are outside, and on which side of the plane S_p the normals are
            size, split = end - begin, end
            outside, on_line, up, down, outside_up, outside_first = 0, 0, 0, 0, 0, 0
            for k in range(begin, end):
                i, t = ids[k], ts[k]
                x, y, z = ox + t * dx - points[i, 0], oy + t * dy - points[i, 1], oz + t * dz - points[i, 2]
                out = normals[i, 0] * x + normals[i, 1] * y + normals[i, 2] * z > 0.0
                f = normals[i, 0] * dx + normals[i, 1] * dy + normals[i, 2] * dz
                outside += out
                on_line += x * x + y * y + z * z <= (_ON_LINE * reach[i]) ** 2
                up += f > 0.0
                down += f <= 0.0
                outside_up += out and f > 0.0
                if split == end:
                    if up > 0 and down > 0:
                        split = k
                    else:
                        outside_first += out
            if outside == size:  # case 1
                begin = end
                continue
            one = on_line == size or split == end  # cases 2 and 3
            if one or halves == 0:
                keep_a, keep_b = True, not one
            elif halves == 1:
                keep_a = outside_first < split - begin
                keep_b = outside - outside_first < end - split
            else:
                keep_a = outside_up < up
                keep_b = outside - outside_up < down
            if write:
                if halves == 2 and not one:
                    ta, fa = _mean_of_side(dx, dy, dz, normals, ts, ids, begin, end, True)
                    tb, fb = _mean_of_side(dx, dy, dz, normals, ts, ids, begin, end, False)
                    if ta > tb and keep_a and keep_b:
                        ta, fa, tb, fb = tb, fb, ta, fa
                else:
                    ta, fa = _mean(dx, dy, dz, normals, ts, ids, begin, end if one else split)
                    tb, fb = _mean(dx, dy, dz, normals, ts, ids, split, end)
                if keep_a:
                    places[at + found], cosines[at + found] = ta, fa
                if keep_b:
                    places[at + found + keep_a], cosines[at + found + keep_a] = tb, fb
            found += keep_a + keep_b
            begin = end
        if not write:
            offsets[line + 1] = found


@inner
def _mean(dx, dy, dz, normals, ts, ids, begin, end):
    """Return the mean of the projections (equation (6), whose integral sign stands for a sum) and of d . n."""
    t, f = 0.0, 0.0
    for k in range(begin, end):
        i = ids[k]
        t += ts[k]
        f += normals[i, 0] * dx + normals[i, 1] * dy + normals[i, 2] * dz
    return t / (end - begin), f / (end - begin)


@inner
def _mean_of_side(dx, dy, dz, normals, ts, ids, begin, end, up):
    """Return the same over the points on one side of S_p."""
    t, f, count = 0.0, 0.0, 0
    for k in range(begin, end):
        i = ids[k]
        g = normals[i, 0] * dx + normals[i, 1] * dy + normals[i, 2] * dz
        if (g > 0.0) == up:
            t += ts[k]
            f += g
            count += 1
    return t / count, f / count


@inner
def _disks(ox, oy, oz, dx, dy, dz, points, normals, ts, ids, reach, begin, end):
    """Return where the line meets the disks of a cluster and d . n, weighted by how near they lie to the line."""
    total, place, normal = 0.0, 0.0, 0.0
    for k in range(begin, end):
        i, t = ids[k], ts[k]
        x, y, z = points[i, 0] - ox, points[i, 1] - oy, points[i, 2] - oz
        away = np.sqrt((x - t * dx) ** 2 + (y - t * dy) ** 2 + (z - t * dz) ** 2)
        f = normals[i, 0] * dx + normals[i, 1] * dy + normals[i, 2] * dz
        hit = t
        if abs(f) > 1e-12:
            height = normals[i, 0] * x + normals[i, 1] * y + normals[i, 2] * z
            hit = min(max(height / f, t - reach[i]), t + reach[i])  # a disk seen edge-on is met near its centre
        weight = max(reach[i] - away, 1e-3 * reach[i])
        total += weight
        place += weight * hit
        normal += weight * f
    return place / total, normal / total


@inner
def _sort(ts, ids, m):
    """Sort by t, and by number where equal: a comb sort that ends as an insertion sort."""
    gap = m if m > 32 else 2
    while gap > 1:
        gap = gap * 10 // 13
        if gap < 6:
            gap = 1
        for j in range(gap, m):
            t, i = ts[j], ids[j]
            k = j
            while k >= gap and (ts[k - gap] > t or (ts[k - gap] == t and ids[k - gap] > i)):
                ts[k], ids[k] = ts[k - gap], ids[k - gap]
                k -= gap
            ts[k], ids[k] = t, i
