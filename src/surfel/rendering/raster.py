"""Splats on the grid of pixels, or at chosen places in some of them, tile by tile, drawn in two passes.

Gaal, *Boolean Operations on Point-Sampled Geometry*, sec. 2 and 7, after Zwicker et al., *Surface Splatting*: the first
pass finds what is nearest, the second blends what lies on the same sheet. The plane of each disk is cut exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.rendering.disks import CLIPPED, CREASE, EDGE, ELLIPTIC, PAINTED, Disks
from surfel.rendering.eights import LANES, add_fours, pick, ramp, some
from surfel.rendering.eights import load_fours as load
from surfel.rendering.eights import store_fours as store
from surfel.rendering.fragments import Fragments
from surfel.rendering.memory import room
from surfel.rendering.places import STRIDE, Places, all_listed, chosen, listed, touched
from surfel.rendering.placing import PIXEL, TILE, Placed, View
from surfel.rendering.projection import depth_of, fragment, in_pixels, shaped
from surfel.rendering.records import (
    AT_COLUMN,
    AT_ROW,
    BEND,
    BEYOND,
    CUT,
    CUT_OFF,
    CUT_X,
    CUT_Y,
    CUT_Z,
    DEPTH,
    INVERSE,
    NX,
    NY,
    NZ,
    RADIUS,
    ROWS,
    SIZE,
    recorded,
)  # fmt: skip
from surfel.rendering.tiles import (
    ABOVE,
    ALIKE,
    AT_X,
    AT_Y,
    AT_Z,
    BEHIND,
    BEST,
    BLUE,
    DOUBT,
    GREEN,
    LIMIT,
    NOTHING,
    OFF,
    ON_X,
    ON_Y,
    ON_Z,
    PLANES,
    RED,
    SHARP,
    WEIGHTS,
    WHOSE,
    divided,
    emptied,
    sheets_of,
    written,
    wrongly_guessed,
)  # fmt: skip

BLEND = np.float32(0.5)
"""Fragments within this share of their radius behind the nearest one are of its sheet."""

LEAST = np.float32(1e-6)

_FOUR, _TWO_ROWS, _HALF_LANES = np.uint64(LANES // 2), STRIDE + STRIDE, np.float32(LANES // 2)
_EXACT = 1 << 24  # floats hold all whole numbers up to this
_ZERO, _ONE, _TWO, _INF = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(np.inf)


def draw(
    disks: Disks, placed: Placed, motions: NDArray[np.float32], view: View, places: Places | None = None
) -> tuple[Fragments, NDArray[np.uint8]]:
    """Draw placed splats: what is nearest at each place, blended with what lies on the same sheet.

    Parameters
    ----------
    disks, placed, motions, view
        The splats, where they fall, and the picture.
    places : Places, optional
        Where; by default the centres of all pixels, row after row.

    Returns
    -------
    seen : Fragments
        The nearest sheet, place by place.
    state : NDArray[np.uint8], shape (m,)
        As :mod:`surfel.rendering.tiles` names them.
    """
    where = chosen(view, places)
    seen, state = Fragments.room(where.number), room(where.number, np.uint8)
    with threads_for(100 * where.number + (64 * len(placed.entries) if where.whole else 0)):
        _draw(
            len(where.tiles), where.tiles, where.pixels, where.rank, where.offsets, where.whole, np.int64(where.reach),
            np.int64(where.most), disks, placed, motions, view, np.int64(2 * len(motions)), np.int64(placed.fullest),
            seen.depth, seen.normal, seen.color, seen.leaf, seen.row, state,
        )  # fmt: skip
    return seen, state


@rows
def _draw(
    first, last, tiles, pixels, rank, offsets, whole, reach, most, disks, placed, motions, view, most_sheets, fullest,
    depth, normal, color, out_leaf, out_row, state,
):  # fmt: skip
    """Draw some tiles, sheet after sheet: a sheet is one side of one leaf.

    The nearest sheet comes first, and is blended while it is drawn, on the guess that all its disks belong together.
    Where the guess was wrong, because it lies over itself or another sheet comes before it, it is blended once more
    when what is nearest is known. A disk is cut by eight lines of sight at once. Numbers of disks are kept as floats.
    """
    box, starts, entries = placed.box, placed.starts, placed.entries
    points, radii, bends, colors = disks.points, disks.radii, disks.bends, disks.colors
    flags, leaf, clips, planes, own, row = disks.flags, disks.leaf, disks.clips, disks.planes, disks.axes, disks.row
    cuts = disks.cuts
    slope, cx, cy, width, height = view.slope, view.cx, view.cy, view.width, view.height
    across, special = -(-width // TILE), CLIPPED | ELLIPTIC
    grid, known_cuts = np.empty(PLANES * most, np.float32), len(cuts) > 0
    begins, sums = np.empty(TILE * (TILE + 1), np.int32), np.zeros((TILE + 1) * (TILE + 1), np.int32)
    lines, xs, ys = np.empty(most, np.int64), np.zeros(most, np.float32), np.zeros(most, np.float32)
    record, who = np.zeros((ROWS, fullest + LANES), np.float32), np.empty(fullest + LANES, np.int32)
    runs, window = np.empty((most_sheets, 2), np.int64), np.empty(4, np.int64)
    bounds, order = np.empty(most_sheets + 1, np.int64), np.empty(most_sheets, np.int64)
    near, wanted = np.empty(most_sheets, np.float32), np.empty(most_sheets, np.bool_)
    for t in range(first, last):
        tile = tiles[t]
        left, top = (tile % across) * TILE, (tile // across) * TILE
        right, bottom = min(left + TILE, width) - 1, min(top + TILE, height) - 1
        begin, turn, end = starts[2 * tile], starts[2 * tile + 1], starts[2 * tile + 2]
        if whole:  # as below, by runs of neighbours
            for y in range(top, bottom + 1):
                p = np.uint64(y * width + left)
                for k in range(np.uint64(right + 1 - left)):
                    depth[p + k], out_leaf[p + k], state[p + k] = _INF, -1, NOTHING
        else:
            count = listed(pixels, rank, left, right, top, bottom, width, offsets, begins, sums, lines, xs, ys)
            for k in range(np.uint64(count)):
                p = np.uint64(lines[k])
                depth[p], out_leaf[p], state[p] = _INF, -1, NOTHING
        if begin == end:
            continue
        if whole:
            count = all_listed(left, right, top, bottom, width, begins, sums, lines, xs, ys)
        sheets = sheets_of(begin, turn, end, entries, leaf, points, radii, motions, bounds, near, order)
        plane = np.uint64(count + LANES)
        emptied(grid, plane, order[0])
        from_depth = depth_of(np.uint64(entries[begin]), leaf[entries[begin]], points, motions)
        farthest, found, low_x, high_x, low_y, high_y = _INF, 0, 0, 0, 0, 0
        for step in range(2 * sheets):  # each sheet, the nearest first; then those again that were guessed wrong
            again, n = step >= sheets, order[step % sheets]
            if again and not wanted[n]:
                continue
            if not again:
                runs[n, 0] = found
                found = recorded(
                    found, bounds[n], bounds[n + 1], farthest, whole, reach, left, right, top, bottom, entries, disks,
                    box, sums, motions, leaf[entries[bounds[n]]], view, who, record,
                )  # fmt: skip
                runs[n, 1] = found
            for k in range(np.uint64(runs[n, 0]), np.uint64(runs[n, 1])):
                i = np.uint64(who[k])
                x0, x1, y0, y1, _ = touched(i, box, reach, left, right, top, bottom, sums)
                if again:
                    x0, x1 = max(x0, np.uint64(low_x)), min(x1, np.uint64(high_x))
                    y0, y1 = max(y0, np.uint64(low_y)), min(y1, np.uint64(high_y))
                    if x0 >= x1:
                        continue
                sx, sy, pixel, ez = record[AT_COLUMN, k], record[AT_ROW, k], record[SIZE, k], record[DEPTH, k]
                nx, ny, nz = record[NX, k], record[NY, k], record[NZ, k]
                inverse, bend, r = record[INVERSE, k], record[BEND, k], record[RADIUS, k]
                mark, gate, small = flags[i], BLEND * r, r < PIXEL * pixel
                mine, me = np.float32(n), np.float32(min(k, _EXACT))
                slack = -_INF if mark & CREASE else gate  # what is creased asks for the normal of what is nearest
                least = ez - r - gate if again else ez - r  # where less is known, the disk is hidden
                least = -_INF if bend > _ZERO else least  # bent disks reach a little beyond their planes' rims
                cut = known_cuts and mark & EDGE
                cut_x, cut_y, cut_z = record[CUT_X, k], record[CUT_Y, k], record[CUT_Z, k]
                cut_at, cut_off = record[CUT, k], record[CUT_OFF, k]
                beyond = -BEYOND * cut_off - bends[i] * r * r
                narrow = whole and x1 - x0 <= _FOUR
                for y in range(y0, y1, _TWO_ROWS if narrow else STRIDE):
                    stop = begins[y + x1]
                    for start in range(begins[y + x0], stop, LANES):
                        at, number, others = np.uint64(start), stop - start, stop - start - LANES // 2
                        beside = at + _FOUR
                        if narrow:  # four pixels of this row and four of the next; there is room behind the last
                            beside, others = np.uint64(count), 0
                            if y + STRIDE < y1:
                                beside, others = np.uint64(begins[y + STRIDE + x0]), number
                        x, row_y, known = load(xs, at, beside), load(ys, at, beside), load(grid, at, beside)
                        if step > 0 and not some(known > least):
                            continue
                        u, z, qx, qy, qz = fragment(
                            x, row_y, sx, sy, pixel, ez, nx, ny, nz, inverse, bend, slope, cx, cy
                        )
                        if mark & special:
                            u = shaped(u, qx, qy, qz, i, flags, own, leaf, clips, planes, motions)
                        elif small:
                            inside = u < _ONE
                            u = pick(inside, u, in_pixels(x, row_y, sx, sy))
                            z = pick(inside, z, ez)
                        if cut:  # what lies beyond it for certain is not there
                            rise = cut_x * qx + cut_y * qy + cut_z * qz + cut_at
                            u = pick(rise < beyond, _TWO, u)
                        lane = ramp()  # what lies beyond the run's end belongs to the next row, and is met there
                        free = pick(
                            lane < _HALF_LANES, lane - np.float32(number), lane - np.float32(others + LANES // 2)
                        )
                        hit = (u < _ONE) & (free < _ZERO)
                        if step == 0 or again:
                            hit = hit & (z - known <= gate)
                            if again:
                                hit = hit & (load(grid, plane * WHOSE + at, plane * WHOSE + beside) == mine)
                        else:
                            hit = hit & (z < known)
                        if not some(hit):
                            continue
                        if not again:
                            first_of, best = hit & (z < known), plane * BEST
                            store(grid, at, beside, pick(first_of, z, known))
                            before = load(grid, best + at, best + beside)
                            store(grid, best + at, best + beside, pick(first_of, me, before))
                            if step > 0:
                                before = load(grid, plane * WHOSE + at, plane * WHOSE + beside)
                                store(grid, plane * WHOSE + at, plane * WHOSE + beside, pick(first_of, mine, before))
                                continue
                            next_to, before = z - slack, load(grid, plane * LIMIT + at, plane * LIMIT + beside)
                            next_to = pick(hit & (next_to > before), next_to, before)
                            store(grid, plane * LIMIT + at, plane * LIMIT + beside, next_to)
                        weight = pick(hit, (_ONE - u) * (_ONE - u) + LEAST, _ZERO)
                        if again:  # blend nothing over a sharp edge with what is nearest
                            cosine = (
                                nx * load(grid, plane * ON_X + at, plane * ON_X + beside)
                                + ny * load(grid, plane * ON_Y + at, plane * ON_Y + beside)
                                + nz * load(grid, plane * ON_Z + at, plane * ON_Z + beside)
                            )
                            if mark & CREASE:
                                weight = pick(cosine < ALIKE, _ZERO, weight)
                            else:
                                alike = load(grid, plane * SHARP + at, plane * SHARP + beside)
                                weight = pick(cosine < alike, _ZERO, weight)
                        add_fours(grid, plane * WEIGHTS + at, plane * WEIGHTS + beside, weight)
                        over = weight * pick(hit, z - from_depth, _ZERO)
                        add_fours(grid, plane * BEHIND + at, plane * BEHIND + beside, over)
                        add_fours(grid, plane * AT_X + at, plane * AT_X + beside, weight * nx)
                        add_fours(grid, plane * AT_Y + at, plane * AT_Y + beside, weight * ny)
                        add_fours(grid, plane * AT_Z + at, plane * AT_Z + beside, weight * nz)
                        if mark & PAINTED:
                            red, green, blue = colors[i, 0], colors[i, 1], colors[i, 2]
                            add_fours(grid, plane * RED + at, plane * RED + beside, weight * np.float32(red))
                            add_fours(grid, plane * GREEN + at, plane * GREEN + beside, weight * np.float32(green))
                            add_fours(grid, plane * BLUE + at, plane * BLUE + beside, weight * np.float32(blue))
                        if mark & EDGE:
                            add_fours(grid, plane * DOUBT + at, plane * DOUBT + beside, weight)
                            if cut:
                                rise = weight * pick(hit, rise, _ZERO)
                                add_fours(grid, plane * ABOVE + at, plane * ABOVE + beside, rise)
                                add_fours(grid, plane * OFF + at, plane * OFF + beside, weight * cut_off)
            if step < sheets - 1:
                farthest = -_INF
                for k in range(np.uint64(count)):
                    farthest = max(farthest, grid[k])
            elif step == sheets - 1:
                wrongly_guessed(grid, plane, count, order[0], sheets, who, flags, record, xs, ys, wanted, window)
                low_x, high_x = max(window[0] - left, 0), max(window[1] - left + 1, 0)
                low_y, high_y = max(window[2] - top, 0) * (TILE + 1), max(window[3] - top + 1, 0) * (TILE + 1)
        divided(grid, plane, count, from_depth)
        written(
            grid, plane, count, who, record, lines, flags, leaf, row, colors, known_cuts, depth, normal,
            color, out_leaf, out_row, state,
        )  # fmt: skip
