"""Splats on the grid of pixels, tile by tile, drawn in two passes.

Gaal, *Boolean Operations on Point-Sampled Geometry*, sec. 2 and 7, after Zwicker et al., *Surface Splatting*: the first
pass finds what is nearest, the second blends what lies on the same sheet. The plane of each disk is cut exactly.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.rendering.disks import CLIPPED, CREASE, EDGE, ELLIPTIC, PAINTED, Disks
from surfel.rendering.eights import LANES, load, pick, ramp, some, store
from surfel.rendering.fragments import Fragments
from surfel.rendering.placing import PIXEL, TILE, Placed, View
from surfel.rendering.projection import depth_of, felt, fragment, in_pixels, normal_of, projected, shaped_eight

BLEND = np.float32(0.5)
"""Fragments within this share of their radius behind the nearest one are of its sheet."""
ALIKE = np.float32(0.7)
"""Near an edge of a cloud, only surfels whose normals make a larger cosine than this are blended."""
THIN = np.float32(0.8)
"""Sheets with less weight than this, where they are seen from their edge, are rims of disks that stick out."""

NOTHING, SURE, UNSURE, RIM = 0, 1, 2, 3
"""States of a pixel: no splat; one kept for certain; one that a cut may pass; the rim of a disk that sticks out."""
STATES, TURNED = 3, 4
"""The bits of these, and one that says that the normal was turned towards the camera."""

LEAST = np.float32(1e-6)

_FIRST = np.uint64(0)
_STRIDE = np.uint64(TILE + LANES)  # of a tile's rows: what falls beyond its right border is never read
_PLANE = np.uint64(TILE * (TILE + LANES))
# planes of a tile: depth of what is nearest, which it is, its label; whether a cut may pass; then the sums
_BEST, _LABEL, _DOUBT = _PLANE, np.uint64(2) * _PLANE, np.uint64(3) * _PLANE
_WEIGHT, _BEHIND = np.uint64(4) * _PLANE, np.uint64(5) * _PLANE
_NX, _NY, _NZ = np.uint64(6) * _PLANE, np.uint64(7) * _PLANE, np.uint64(8) * _PLANE
_RED, _GREEN, _BLUE = np.uint64(9) * _PLANE, np.uint64(10) * _PLANE, np.uint64(11) * _PLANE
_ROOM = 12 * TILE * (TILE + LANES)
_EXACT = 1 << 24  # floats hold all whole numbers up to this
_ZERO, _ONE, _TWO, _INF, _HALF = (np.float32(v) for v in (0.0, 1.0, 2.0, np.inf, 0.5))


def draw(disks: Disks, placed: Placed, motions: NDArray[np.float32], view: View) -> tuple[Fragments, NDArray[np.uint8]]:
    """Draw placed splats: what is nearest at each pixel, blended with what lies on the same sheet.

    Returns
    -------
    seen : Fragments
        The nearest sheet, pixel by pixel, row after row.
    state : NDArray[np.uint8], shape (h, w)
        :data:`UNSURE` where a cut may pass that sheet, :data:`RIM` where it is none; see
        :data:`STATES`.
    """
    seen = Fragments.room(view.width * view.height)
    state = np.empty((view.height, view.width), np.uint8)
    tiles = (len(placed.starts) - 1) // 2
    with threads_for(view.width * view.height + 64 * len(placed.entries)):
        _draw(
            tiles, disks, placed, motions, view, np.int64(placed.fullest), seen.depth, seen.normal, seen.color,
            seen.leaf, seen.row, state,
        )  # fmt: skip
    return seen, state


@rows
def _draw(first, last, disks, placed, motions, view, fullest, depth, normal, color, out_leaf, out_row, state):
    """Draw some tiles, in two passes each; those that face the camera come first, and hide most of the others.

    A disk is cut by eight lines of sight at once. Numbers of surfels are kept as floats as well, which are exact.
    """
    box, starts, entries = placed.box, placed.starts, placed.entries
    points, normals, radii, bends, colors = disks.points, disks.normals, disks.radii, disks.bends, disks.colors
    flags, leaf, clips, planes, own, row = disks.flags, disks.leaf, disks.clips, disks.planes, disks.axes, disks.row
    slope, middle, size, cx, cy, width, height = (
        view.slope, view.depth, view.size, view.cx, view.cy, view.width, view.height
    )  # fmt: skip
    across, special = -(-width // TILE), CLIPPED | ELLIPTIC
    grid, lanes = np.empty(_ROOM, np.float32), np.empty(4 * LANES, np.float32)
    record = np.empty((fullest, 12), np.float32)
    for tile in range(first, last):
        left, top = (tile % across) * TILE, (tile // across) * TILE
        right, bottom = min(left + TILE, width) - 1, min(top + TILE, height) - 1
        begin, turn, end = starts[2 * tile], starts[2 * tile + 1], starts[2 * tile + 2]
        for y in range(top, bottom + 1):
            depth[y * width + left : y * width + right + 1] = _INF
            out_leaf[y * width + left : y * width + right + 1] = -1
            state[y, left : right + 1] = NOTHING
        if begin == end:
            continue
        grid[:_PLANE] = _INF
        grid[_BEST:_LABEL] = -_ONE
        grid[_LABEL:] = _ZERO
        farthest, sides, creased = _INF, 1, False
        for run in range(4):  # what faces the camera and what does not, nearest first; then the same, blended
            side, blend = run & 1, run >= 2
            if blend and side >= sides:
                break
            for entry in range(turn if side == 1 else begin, end if side == 1 else turn):
                i, k = entries[entry], entry - begin
                m, r = leaf[i], radii[i]
                if not blend:
                    ez = depth_of(i, m, points, motions)
                    if side == 1 and ez - r > farthest:
                        record[k, 8] = -_ONE
                        continue
                    nx, ny, nz = normal_of(i, m, normals, motions)
                    sx, sy, pixel, cosine = projected(
                        i, m, ez, nx, ny, nz, points, motions, slope, middle, size, cx, cy
                    )
                    record[k, 0], record[k, 1], record[k, 2], record[k, 3] = sx, sy, pixel, ez
                    record[k, 4], record[k, 5], record[k, 6] = nx, ny, nz
                    record[k, 7], record[k, 8], record[k, 9], record[k, 10] = (
                        _ONE / (r * r),
                        r,
                        cosine,
                        felt(bends[i], r, cosine, pixel, slope),
                    )
                elif record[k, 8] < _ZERO:
                    continue
                sx, sy, pixel, ez = record[k, 0], record[k, 1], record[k, 2], record[k, 3]
                nx, ny, nz, inverse, bend = record[k, 4], record[k, 5], record[k, 6], record[k, 7], record[k, 10]
                mark, mine, me, gate = flags[i], np.float32(2 * m + side), np.float32(min(k, _EXACT)), BLEND * r
                red, green, blue = np.float32(colors[i, 0]), np.float32(colors[i, 1]), np.float32(colors[i, 2])
                small = r < PIXEL * pixel
                x0, x1 = max(left, np.int64(box[i, 0])), min(right, np.int64(box[i, 1]))
                runs = (x1 - x0) // LANES + 1
                for y in range(max(top, np.int64(box[i, 2])), min(bottom, np.int64(box[i, 3])) + 1):
                    row_y = np.float32(y)
                    for part in range(runs):
                        at = np.uint64(y - top) * _STRIDE + np.uint64(x0 - left + LANES * part)
                        x = ramp() + np.float32(x0 + LANES * part)
                        u, z, qx, qy, qz = fragment(
                            x, row_y, sx, sy, pixel, ez, nx, ny, nz, inverse, bend, slope, cx, cy
                        )
                        if mark & special:
                            u = shaped_eight(u, qx, qy, qz, i, flags, own, leaf, clips, planes, motions, lanes)
                        elif small:
                            inside = u < _ONE
                            u = pick(inside, u, in_pixels(x, row_y, sx, sy))
                            z = pick(inside, z, ez)
                        known = load(grid, at)
                        if not blend:
                            hit = (u < _ONE) & (z < known)
                            if some(hit):
                                store(grid, at, pick(hit, z, known))
                                store(grid, _BEST + at, pick(hit, me, load(grid, _BEST + at)))
                                store(grid, _LABEL + at, pick(hit, mine, load(grid, _LABEL + at)))
                            continue
                        over = z - known
                        same = (u < _ONE) & (over <= gate) & (load(grid, _LABEL + at) == mine)
                        if not some(same):
                            continue
                        weight = pick(same, (_ONE - u) * (_ONE - u) + LEAST, _ZERO)
                        if mark & CREASE or creased:
                            store(lanes, _FIRST, weight)
                            for h in range(np.uint64(LANES)):
                                j = np.int64(grid[_BEST + at + h])
                                if j < 0 or not (mark | flags[entries[begin + j]]) & CREASE:
                                    continue
                                if nx * record[j, 4] + ny * record[j, 5] + nz * record[j, 6] < ALIKE:
                                    lanes[h] = _ZERO
                            weight = load(lanes, _FIRST)
                        store(grid, _WEIGHT + at, load(grid, _WEIGHT + at) + weight)
                        store(grid, _BEHIND + at, load(grid, _BEHIND + at) + weight * pick(same, over, _ZERO))
                        store(grid, _NX + at, load(grid, _NX + at) + weight * nx)
                        store(grid, _NY + at, load(grid, _NY + at) + weight * ny)
                        store(grid, _NZ + at, load(grid, _NZ + at) + weight * nz)
                        if mark & PAINTED:
                            store(grid, _RED + at, load(grid, _RED + at) + weight * red)
                            store(grid, _GREEN + at, load(grid, _GREEN + at) + weight * green)
                            store(grid, _BLUE + at, load(grid, _BLUE + at) + weight * blue)
                        if mark & EDGE:
                            store(grid, _DOUBT + at, load(grid, _DOUBT + at) + weight)
            if run == 0:
                farthest = -_INF
                for y in range(np.uint64(bottom - top + 1)):
                    for x in range(np.uint64(right - left + 1)):
                        farthest = max(farthest, grid[y * _STRIDE + x])
            elif run == 1:
                for y in range(np.uint64(bottom - top + 1)):
                    for x in range(np.uint64(right - left + 1)):
                        j = np.int64(grid[_BEST + y * _STRIDE + x])
                        if j >= 0:
                            creased = creased or flags[entries[begin + j]] & CREASE != 0
                            sides = 2 if np.int64(grid[_LABEL + y * _STRIDE + x]) & 1 == 1 else sides
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                at = np.uint64(y - top) * _STRIDE + np.uint64(x - left)
                j = np.int64(grid[_BEST + at])
                if j < 0:
                    continue
                i, p, weight = entries[begin + j], y * width + x, grid[_WEIGHT + at]
                state[y, x] = SURE
                if weight < THIN * (_ONE - record[j, 9]):
                    state[y, x] = RIM
                    continue
                if grid[_DOUBT + at] > _ZERO:
                    state[y, x] = UNSURE
                mean = _ONE / weight
                depth[p], out_leaf[p], out_row[p] = grid[at] + grid[_BEHIND + at] * mean, leaf[i], row[i]
                nx, ny, nz = grid[_NX + at], grid[_NY + at], grid[_NZ + at]
                length = math.sqrt(nx * nx + ny * ny + nz * nz)
                if not length > _ZERO:
                    nx, ny, nz, length = record[j, 4], record[j, 5], record[j, 6], _ONE
                if nz > _ZERO:
                    length = -length
                    state[y, x] |= TURNED
                normal[p, 0], normal[p, 1], normal[p, 2] = nx / length, ny / length, nz / length
                if flags[i] & PAINTED:
                    color[p, 0] = np.uint8(grid[_RED + at] * mean + _HALF)
                    color[p, 1] = np.uint8(grid[_GREEN + at] * mean + _HALF)
                    color[p, 2] = np.uint8(grid[_BLUE + at] * mean + _HALF)
                else:
                    color[p, 0], color[p, 1], color[p, 2] = colors[i, 0], colors[i, 1], colors[i, 2]
