"""Splats on the grid of pixels, or at chosen places in some of them, tile by tile, drawn in two passes.

Gaal, *Boolean Operations on Point-Sampled Geometry*, sec. 2 and 7, after Zwicker et al., *Surface Splatting*: the first
pass finds what is nearest, the second blends what lies on the same sheet. The plane of each disk is cut exactly.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.rendering.disks import CLIPPED, CREASE, EDGE, ELLIPTIC, PAINTED, Disks
from surfel.rendering.eights import LANES, pick, ramp, some
from surfel.rendering.eights import load_fours as load
from surfel.rendering.eights import store_fours as store
from surfel.rendering.fragments import Fragments
from surfel.rendering.places import STRIDE, Places, chosen, listed, touched
from surfel.rendering.placing import PIXEL, TILE, Placed, View
from surfel.rendering.projection import depth_of, felt, fragment, in_pixels, normal_of, projected, shaped

BLEND = np.float32(0.5)
"""Fragments within this share of their radius behind the nearest one are of its sheet."""
ALIKE = np.float32(0.7)
"""Near an edge of a cloud, only surfels whose normals make a larger cosine than this are blended."""
THIN = np.float32(0.8)
"""Sheets with less weight than this, where they are seen from their edge, are rims of disks that stick out."""

FAR = np.float32(1e30)
"""How far the plane of a cut may be off where nothing is known: smaller disks are drawn beyond their rims."""

NOTHING, SURE, UNSURE, RIM, AWAY = 0, 1, 2, 3, 4
"""States of a pixel: no splat; one kept for certain; one that a cut may pass; the rim of a disk that sticks out; one
that is cut away for certain."""
STATES, TURNED = 7, 8
"""The bits of these, and one that says that the normal was turned towards the camera."""

LEAST = np.float32(1e-6)

_PLANES = 18
_FOUR, _TWO_ROWS, _HALF_LANES = np.uint64(LANES // 2), STRIDE + STRIDE, np.float32(LANES // 2)
_EXACT = 1 << 24  # floats hold all whole numbers up to this
_ZERO, _ONE, _TWO, _INF, _HALF = (np.float32(v) for v in (0.0, 1.0, 2.0, np.inf, 0.5))


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
        :data:`UNSURE` where a cut may pass that sheet, :data:`RIM` where it is none; see
        :data:`STATES`.
    """
    where = chosen(view, places)
    seen, state = Fragments.room(where.number), np.empty(where.number, np.uint8)
    with threads_for(100 * where.number + (64 * len(placed.entries) if where.whole else 0)):
        _draw(
            len(where.tiles), where.tiles, where.slot, where.offsets, where.whole, np.int64(where.reach),
            np.int64(where.most), disks, placed, motions, view, np.int64(placed.fullest), seen.depth, seen.normal,
            seen.color, seen.leaf, seen.row, state,
        )  # fmt: skip
    return seen, state


@rows
def _draw(
    first, last, tiles, slot, offsets, whole, reach, most, disks, placed, motions, view, fullest, depth, normal, color,
    out_leaf, out_row, state,
):  # fmt: skip
    """Draw some tiles, in two passes each; those that face the camera come first, and hide most of the others.

    A disk is cut by eight lines of sight at once. Numbers of surfels are kept as floats as well, which are exact.
    """
    box, starts, entries = placed.box, placed.starts, placed.entries
    points, normals, radii, bends, colors = disks.points, disks.normals, disks.radii, disks.bends, disks.colors
    flags, leaf, clips, planes, own, row = disks.flags, disks.leaf, disks.clips, disks.planes, disks.axes, disks.row
    cuts = disks.cuts
    slope, middle, size, cx, cy, width, height = (
        view.slope, view.depth, view.size, view.cx, view.cy, view.width, view.height
    )  # fmt: skip
    across, special = -(-width // TILE), CLIPPED | ELLIPTIC
    grid = np.empty(_PLANES * most, np.float32)
    begins, sums = np.empty(TILE * (TILE + 1), np.int32), np.zeros((TILE + 1) * (TILE + 1), np.int32)
    lines, xs, ys = np.empty(most, np.int64), np.zeros(most, np.float32), np.zeros(most, np.float32)
    record = np.empty((fullest, 16), np.float32)
    for t in range(first, last):
        tile = tiles[t]
        left, top = (tile % across) * TILE, (tile // across) * TILE
        right, bottom = min(left + TILE, width) - 1, min(top + TILE, height) - 1
        begin, turn, end = starts[2 * tile], starts[2 * tile + 1], starts[2 * tile + 2]
        count = listed(whole, slot, left, right, top, bottom, width, offsets, begins, sums, lines, xs, ys)
        for k in range(count):
            line = lines[k]
            depth[line], out_leaf[line], state[line] = _INF, -1, NOTHING
        if begin == end:
            continue
        # planes of a tile: depth of what is nearest, which it is, its label; whether a cut may pass; the sums; where
        # there are sharp edges, the normal of what is nearest, and the cosine from which others are blended; and how
        # far from a cut it is
        plane = np.uint64(count + LANES)
        best, label = plane, plane + plane
        doubt, weights, behind = label + plane, label + label, label + label + plane
        at_x, at_y, at_z = doubt + doubt, doubt + weights, weights + weights
        at_red, at_green, at_blue = at_z + plane, at_z + label, at_z + doubt
        on_x, on_y, on_z, sharp = at_red + doubt, at_red + weights, at_blue + doubt, at_blue + weights
        above, off = sharp + plane, sharp + label
        grid[:plane] = _INF
        grid[best:label] = -_ONE
        grid[label : at_blue + plane] = _ZERO
        grid[above : off + plane] = _ZERO
        farthest, sides, creased = _INF, 1, False
        for run in range(4):  # what faces the camera and what does not, nearest first; then the same, blended
            side, blend = run & 1, run >= 2
            if blend and side >= sides:
                break
            for entry in range(turn if side == 1 else begin, end if side == 1 else turn):
                i, k = np.uint64(entries[entry]), entry - begin
                m, r = leaf[i], radii[i]
                if not blend:
                    record[k, 8] = -_ONE
                    ez = depth_of(i, m, points, motions)
                    if side == 1 and ez - r > farthest:
                        continue
                elif record[k, 8] < _ZERO:
                    continue
                x0, x1, y0, y1, held = touched(i, box, reach, left, right, top, bottom, sums)
                if held == 0:
                    continue
                if not blend:
                    nx, ny, nz = normal_of(i, m, normals, motions)
                    sx, sy, pixel, cosine = projected(
                        i, m, ez, nx, ny, nz, points, motions, slope, middle, size, cx, cy
                    )
                    record[k, 0], record[k, 1], record[k, 2], record[k, 3] = sx, sy, pixel, ez
                    record[k, 4], record[k, 5], record[k, 6] = nx, ny, nz
                    record[k, 7], record[k, 8], record[k, 9] = _ONE / (r * r), r, cosine
                    record[k, 10] = felt(bends[i], r, cosine, pixel, slope)
                    if flags[i] & EDGE and len(cuts) > 0:
                        a, b, c = cuts[i, 0], cuts[i, 1], cuts[i, 2]
                        record[k, 11] = motions[m, 0, 0] * a + motions[m, 0, 1] * b + motions[m, 0, 2] * c
                        record[k, 12] = motions[m, 1, 0] * a + motions[m, 1, 1] * b + motions[m, 1, 2] * c
                        record[k, 13] = motions[m, 2, 0] * a + motions[m, 2, 1] * b + motions[m, 2, 2] * c
                        record[k, 14] = cuts[i, 3]
                        record[k, 15] = cuts[i, 4] if r >= PIXEL * pixel else FAR
                sx, sy, pixel, ez = record[k, 0], record[k, 1], record[k, 2], record[k, 3]
                nx, ny, nz, inverse, bend = record[k, 4], record[k, 5], record[k, 6], record[k, 7], record[k, 10]
                mark, mine, me, gate = flags[i], np.float32(2 * m + side), np.float32(min(k, _EXACT)), BLEND * r
                red, green, blue = np.float32(colors[i, 0]), np.float32(colors[i, 1]), np.float32(colors[i, 2])
                small, creased = r < PIXEL * pixel, creased or mark & CREASE != 0
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
                        x, row_y = load(xs, at, beside), load(ys, at, beside)
                        u, z, qx, qy, qz = fragment(
                            x, row_y, sx, sy, pixel, ez, nx, ny, nz, inverse, bend, slope, cx, cy
                        )
                        if mark & special:
                            u = shaped(u, qx, qy, qz, i, flags, own, leaf, clips, planes, motions)
                        elif small:
                            inside = u < _ONE
                            u = pick(inside, u, in_pixels(x, row_y, sx, sy))
                            z = pick(inside, z, ez)
                        known = load(grid, at, beside)
                        if not blend:
                            hit = (u < _ONE) & (z < known)
                            if some(hit):
                                store(grid, at, beside, pick(hit, z, known))
                                store(
                                    grid, best + at, best + beside, pick(hit, me, load(grid, best + at, best + beside))
                                )
                                store(
                                    grid,
                                    label + at,
                                    label + beside,
                                    pick(hit, mine, load(grid, label + at, label + beside)),
                                )
                            continue
                        over = z - known  # what lies beyond the run's end belongs to the next row, and is met there
                        same = (u < _ONE) & (over <= gate) & (load(grid, label + at, label + beside) == mine)
                        lane = ramp()
                        free = pick(
                            lane < _HALF_LANES, lane - np.float32(number), lane - np.float32(others + LANES // 2)
                        )
                        same = same & (free < _ZERO)
                        if not some(same):
                            continue
                        weight = pick(same, (_ONE - u) * (_ONE - u) + LEAST, _ZERO)
                        if creased:  # blend nothing over a sharp edge with what is nearest
                            cosine = (
                                nx * load(grid, on_x + at, on_x + beside)
                                + ny * load(grid, on_y + at, on_y + beside)
                                + nz * load(grid, on_z + at, on_z + beside)
                            )
                            if mark & CREASE:
                                weight = pick(cosine < ALIKE, _ZERO, weight)
                            else:
                                weight = pick(cosine < load(grid, sharp + at, sharp + beside), _ZERO, weight)
                        store(grid, weights + at, weights + beside, load(grid, weights + at, weights + beside) + weight)
                        store(
                            grid,
                            behind + at,
                            behind + beside,
                            load(grid, behind + at, behind + beside) + weight * pick(same, over, _ZERO),
                        )
                        store(grid, at_x + at, at_x + beside, load(grid, at_x + at, at_x + beside) + weight * nx)
                        store(grid, at_y + at, at_y + beside, load(grid, at_y + at, at_y + beside) + weight * ny)
                        store(grid, at_z + at, at_z + beside, load(grid, at_z + at, at_z + beside) + weight * nz)
                        if mark & PAINTED:
                            store(
                                grid,
                                at_red + at,
                                at_red + beside,
                                load(grid, at_red + at, at_red + beside) + weight * red,
                            )
                            store(
                                grid,
                                at_green + at,
                                at_green + beside,
                                load(grid, at_green + at, at_green + beside) + weight * green,
                            )
                            store(
                                grid,
                                at_blue + at,
                                at_blue + beside,
                                load(grid, at_blue + at, at_blue + beside) + weight * blue,
                            )
                        if mark & EDGE:
                            store(grid, doubt + at, doubt + beside, load(grid, doubt + at, doubt + beside) + weight)
                            if len(cuts) > 0:
                                rise = record[k, 11] * qx + record[k, 12] * qy + record[k, 13] * qz + record[k, 14]
                                store(
                                    grid,
                                    above + at,
                                    above + beside,
                                    load(grid, above + at, above + beside) + weight * pick(same, rise, _ZERO),
                                )
                                store(
                                    grid,
                                    off + at,
                                    off + beside,
                                    load(grid, off + at, off + beside) + weight * record[k, 15],
                                )
            if run == 0:
                farthest = -_INF
                for k in range(np.uint64(count)):
                    farthest = max(farthest, grid[k])
            elif run == 1:
                for k in range(np.uint64(count)):
                    j = np.int64(grid[best + k])
                    if j >= 0:
                        if creased:
                            on = np.uint64(j)
                            grid[on_x + k], grid[on_y + k], grid[on_z + k] = record[on, 4], record[on, 5], record[on, 6]
                            grid[sharp + k] = ALIKE if flags[entries[begin + j]] & CREASE else -_TWO
                        sides = 2 if np.int64(grid[label + k]) & 1 == 1 else sides
        for k in range(np.uint64(count)):
            j = np.int64(grid[best + k])
            if j < 0:
                continue
            i, p, weight = entries[begin + j], lines[k], grid[weights + k]
            state[p] = SURE
            if weight < THIN * (_ONE - record[j, 9]):
                state[p] = RIM
                continue
            if grid[doubt + k] > _ZERO:
                state[p] = UNSURE
                if len(cuts) > 0 and abs(grid[above + k]) > grid[off + k]:
                    state[p] = SURE if grid[above + k] > _ZERO else AWAY
            mean = _ONE / weight
            depth[p], out_leaf[p], out_row[p] = grid[k] + grid[behind + k] * mean, leaf[i], row[i]
            nx, ny, nz = grid[at_x + k], grid[at_y + k], grid[at_z + k]
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            if not length > _ZERO:
                nx, ny, nz, length = record[j, 4], record[j, 5], record[j, 6], _ONE
            if nz > _ZERO:
                length = -length
                state[p] |= TURNED
            normal[p, 0], normal[p, 1], normal[p, 2] = nx / length, ny / length, nz / length
            if flags[i] & PAINTED:
                color[p, 0] = np.uint8(grid[at_red + k] * mean + _HALF)
                color[p, 1] = np.uint8(grid[at_green + k] * mean + _HALF)
                color[p, 2] = np.uint8(grid[at_blue + k] * mean + _HALF)
            else:
                color[p, 0], color[p, 1], color[p, 2] = colors[i, 0], colors[i, 1], colors[i, 2]
