"""Splats on the grid of pixels: placed, sorted into tiles, drawn in two passes.

Gaal, *Boolean Operations on Point-Sampled Geometry*, sec. 2 and 7, after Zwicker et al., *Surface Splatting*: the first
pass finds what is nearest, the second blends what lies on the same sheet. The plane of each disk is cut exactly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel, rows, threads_for
from surfel.rendering.camera import Camera
from surfel.rendering.fragments import Fragments

TILE = 32
CHUNKS = 32  # runs of surfels that are placed and counted apart; a fixed number, so that their order never changes
BLEND = np.float32(0.5)
"""Fragments within this share of their radius behind the nearest one are of its sheet."""
ALIKE = np.float32(0.7)
"""Near an edge of a cloud, only surfels whose normals make a larger cosine than this are blended."""

EDGE, CREASE, CLIPPED, ELLIPTIC, PAINTED = 1, 2, 4, 8, 16
"""Bits of a surfel: a cut may pass it; its neighbours' normals spread; it has clip planes, axes, a color of its own."""

NOTHING, SURE, UNSURE = 0, 1, 2
"""States of a pixel: no splat; one that is kept for certain; one that a cut may pass."""

PIXEL = np.float32(0.5)  # pixels: smaller disks are drawn as circles of this radius
THIN = np.float32(0.8)
"""Sheets with less weight than this, where they are seen from their edge, are rims of disks that stick out."""

_LEAST = np.float32(1e-6)
_PIXELS = np.float32(1.0) / (PIXEL * PIXEL)
_ZERO, _ONE, _TWO, _INF = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(np.inf)


class Disks(NamedTuple):
    """Surfels to be drawn, of all clouds together, each in the frame of its own cloud."""

    points: NDArray[np.float32]  # (n, 3)
    normals: NDArray[np.float32]  # (n, 3)
    radii: NDArray[np.float32]  # (n,)
    bends: NDArray[np.float32]  # (n,): curvature, where convex
    colors: NDArray[np.uint8]  # (n, 3)
    leaf: NDArray[np.int32]  # (n,)
    flags: NDArray[np.uint8]  # (n,)
    row: NDArray[np.int32]  # (n,): of the cloud as it was given
    clips: NDArray[np.int32]  # (n + 1,): runs of planes
    planes: NDArray[np.float32]  # (k, 4): n . (x - centre) <= d
    axes: NDArray[np.float32]  # (n, 6), or (0, 6) where all are round


class View(NamedTuple):
    """A camera and a size as the kernels take them."""

    width: int
    height: int
    cx: np.float32
    cy: np.float32
    slope: np.float32  # of the line of sight, a pixel; 0 in parallel pictures
    size: np.float32  # of a pixel at the depth of the scene's middle
    depth: np.float32  # of the scene's middle, which all depths are relative to
    near: np.float32  # least depth, relative as well


class Placed(NamedTuple):
    """Splats in a picture, and which tiles they fall in."""

    record: NDArray[np.float32]  # (n, 11): x, y, size of a pixel, depth, normal (3), 1 / r^2, r, cosine, bend
    axes: NDArray[np.float32]  # (n, 6), or (0, 6)
    box: NDArray[np.int32]  # (n, 4): first and last column, first and last row
    label: NDArray[np.int32]  # (n,): twice the leaf, plus one where seen from its back; -1 where not seen
    starts: NDArray[np.int64]  # (2 tiles + 1,): of each tile those that face the camera, then the others
    entries: NDArray[np.int32]


def view_of(camera: Camera, size: tuple[int, int], middle: float, reach: float) -> View:
    """Return the view of a scene whose middle lies at a depth and which reaches so far round it."""
    width, height = size
    focal = camera.focal(height)
    near = -np.inf if camera.orthographic else 1e-4 * min(camera.distance, max(reach, 1e-300)) - middle
    return View(
        width,
        height,
        np.float32(0.5 * (width - 1)),
        np.float32(0.5 * (height - 1)),
        np.float32(0.0 if camera.orthographic else 1.0 / focal),
        np.float32((camera.distance if camera.orthographic else middle) / focal),
        np.float32(middle),
        np.float32(near),
    )


def place(disks: Disks, motions: NDArray[np.float32], view: View) -> Placed:
    """Place surfels in a picture and sort them into tiles.

    Parameters
    ----------
    disks : Disks
        The surfels.
    motions : NDArray[np.float32], shape (leaves, 3, 4)
        From the frame of each cloud to the camera's, depth relative to the scene's middle.
    view : View
        The picture.
    """
    n = len(disks.points)
    across, down = -(-view.width // TILE), -(-view.height // TILE)
    record = np.empty((n, 11), np.float32)
    axes = np.empty((n if len(disks.axes) else 0, 6), np.float32)
    box, label = np.empty((n, 4), np.int32), np.empty(n, np.int32)
    counts = np.zeros((CHUNKS, 2 * across * down), np.int64)
    starts = np.empty(2 * across * down + 1, np.int64)
    with threads_for(4 * n):
        _place(CHUNKS, disks, motions, view, np.int64(across), record, axes, box, label, counts)
        _starts_of(counts, starts)
        entries = np.empty(int(starts[-1]), np.int32)
        _enter(CHUNKS, box, label, np.int64(across), counts, entries)
    return Placed(record, axes, box, label, starts, entries)


def draw(disks: Disks, placed: Placed, motions: NDArray[np.float32], view: View) -> tuple[Fragments, NDArray[np.uint8]]:
    """Draw placed splats: what is nearest at each pixel, blended with what lies on the same sheet.

    Returns
    -------
    seen : Fragments
        What is seen for certain, pixel by pixel, row after row.
    state : NDArray[np.uint8], shape (h, w)
        :data:`UNSURE` where there are splats, but a cut may pass; those are not in ``seen``.
    """
    seen = Fragments.room(view.width * view.height)
    state = np.empty((view.height, view.width), np.uint8)
    tiles = (len(placed.starts) - 1) // 2
    with threads_for(view.width * view.height + 64 * len(placed.entries)):
        _draw(
            tiles, disks, placed, motions, view, seen.depth, seen.normal, seen.color, seen.leaf, seen.row, state
        )  # fmt: skip
    return seen, state


@rows
def _place(first, last, disks, motions, view, across, record, axes, box, label, counts):
    """Place the surfels of some chunks, and count how many fall in each tile."""
    points, normals, radii, leaf, flags, own = (
        disks.points, disks.normals, disks.radii, disks.leaf, disks.flags, disks.axes
    )  # fmt: skip
    slope, middle, near, cx, cy = view.slope, view.depth, view.near, view.cx, view.cy
    right, bottom = np.float32(view.width - 1), np.float32(view.height - 1)
    n = len(points)
    for chunk in range(first, last):
        for i in range(n * chunk // CHUNKS, n * (chunk + 1) // CHUNKS):
            label[i] = -1
            m = leaf[i]
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            ez = motions[m, 2, 0] * x + motions[m, 2, 1] * y + motions[m, 2, 2] * z + motions[m, 2, 3]
            if not ez > near:
                continue
            ex = motions[m, 0, 0] * x + motions[m, 0, 1] * y + motions[m, 0, 2] * z + motions[m, 0, 3]
            ey = motions[m, 1, 0] * x + motions[m, 1, 1] * y + motions[m, 1, 2] * z + motions[m, 1, 3]
            a, b, c = normals[i, 0], normals[i, 1], normals[i, 2]
            nx = motions[m, 0, 0] * a + motions[m, 0, 1] * b + motions[m, 0, 2] * c
            ny = motions[m, 1, 0] * a + motions[m, 1, 1] * b + motions[m, 1, 2] * c
            nz = motions[m, 2, 0] * a + motions[m, 2, 1] * b + motions[m, 2, 2] * c
            r = radii[i]
            pixel, tx, ty, nearest = view.size, _ZERO, _ZERO, view.size
            toward = nz
            if slope > _ZERO:
                depth = middle + ez
                pixel = depth * slope
                tx, ty = ex / depth, ey / depth
                nearest = (depth - r * math.sqrt(max(_ONE - nz * nz, _ZERO))) * slope
                if not nearest > _ZERO:
                    continue
                toward = nx * tx + ny * ty + nz
            sx, sy = cx + ex / pixel, cy + ey / pixel
            one, two = nx - tx * nz, ny - ty * nz
            least = PIXEL if r < PIXEL * pixel else _ZERO
            half_x = max(r * math.sqrt(max(_ONE + tx * tx - one * one, _ZERO)) / nearest, least)
            half_y = max(r * math.sqrt(max(_ONE + ty * ty - two * two, _ZERO)) / nearest, least)
            if not (sx + half_x >= _ZERO and sy + half_y >= _ZERO and sx - half_x <= right and sy - half_y <= bottom):
                continue
            x0, x1 = math.ceil(max(sx - half_x, _ZERO)), math.floor(min(sx + half_x, right))
            y0, y1 = math.ceil(max(sy - half_y, _ZERO)), math.floor(min(sy + half_y, bottom))
            if x1 < x0 or y1 < y0:
                continue
            back = 1 if toward > _ZERO else 0
            label[i] = 2 * m + back
            box[i, 0], box[i, 1], box[i, 2], box[i, 3] = x0, x1, y0, y1
            record[i, 0], record[i, 1], record[i, 2], record[i, 3] = sx, sy, pixel, ez
            record[i, 4], record[i, 5], record[i, 6] = nx, ny, nz
            record[i, 7], record[i, 8], record[i, 10] = _ONE / (r * r), r, disks.bends[i]
            record[i, 9] = toward / math.sqrt(_ONE + tx * tx + ty * ty)
            if flags[i] & ELLIPTIC:
                for k in range(2):
                    a, b, c = own[i, 3 * k], own[i, 3 * k + 1], own[i, 3 * k + 2]
                    scale = _ONE / (a * a + b * b + c * c)
                    for t in range(3):
                        axes[i, 3 * k + t] = scale * (
                            motions[m, t, 0] * a + motions[m, t, 1] * b + motions[m, t, 2] * c
                        )
            for v in range(y0 // TILE, y1 // TILE + 1):
                for u in range(x0 // TILE, x1 // TILE + 1):
                    counts[chunk, 2 * (v * across + u) + back] += 1


@kernel
def _starts_of(counts, starts):
    """Turn the counts by chunk and tile into where each writes first."""
    total = 0
    for tile in range(counts.shape[1]):
        starts[tile] = total
        for chunk in range(counts.shape[0]):
            here = counts[chunk, tile]
            counts[chunk, tile] = total
            total += here
    starts[counts.shape[1]] = total


@rows
def _enter(first, last, box, label, across, places, entries):
    n = len(label)
    for chunk in range(first, last):
        for i in range(n * chunk // CHUNKS, n * (chunk + 1) // CHUNKS):
            if label[i] < 0:
                continue
            back = label[i] & 1
            for v in range(box[i, 2] // TILE, box[i, 3] // TILE + 1):
                for u in range(box[i, 0] // TILE, box[i, 1] // TILE + 1):
                    bin = 2 * (v * across + u) + back
                    entries[places[chunk, bin]] = i
                    places[chunk, bin] += 1


@inlined
def fragment(x, y, sx, sy, pixel, ez, nx, ny, nz, inverse, bend, slope, cx, cy):
    """Cut the line of sight through a place of the picture with the plane of a disk.

    Returns the square of the distance from the disk's centre over that of its radius, the depth, and where the plane
    is cut, seen from the centre (for ellipses and clips). Depths are taken from the centre's own, so that no digits
    are lost in far cameras. Near a silhouette the line may cut the plane and miss the surface, which bends away: the
    height n . p = -bend |p|^2 / 2 over the line is a quadratic, and where it has no zero the distance is 2.
    """
    ax, ay = (x - sx) * pixel, (y - sy) * pixel
    dx, dy = (x - cx) * slope, (y - cy) * slope
    toward = nx * dx + ny * dy + nz
    s = -(nx * ax + ny * ay) / toward
    qx, qy = ax + s * dx, ay + s * dy
    square = qx * qx + qy * qy + s * s
    turned = toward + bend * (qx * dx + qy * dy + s)
    missed = turned * turned < bend * bend * (dx * dx + dy * dy + _ONE - toward * toward) * square
    return _TWO if missed else square * inverse, ez + s, qx, qy, s


@inlined
def in_pixels(x, y, sx, sy):
    """Return the square of the distance from a splat's middle, over that of the least circle that it covers."""
    return ((x - sx) * (x - sx) + (y - sy) * (y - sy)) * _PIXELS


@rows
def _draw(first, last, disks, placed, motions, view, depth, normal, color, out_leaf, out_row, state):
    """Draw some tiles, in two passes each; those that face the camera come first, and hide most of the others.

    A disk is cut row by row: first all of a row at once, which the compiler turns into vectors, then what is odd.
    """
    record, own, box, label, starts, entries = placed
    colors, flags, leaf, clips, planes = disks.colors, disks.flags, disks.leaf, disks.clips, disks.planes
    slope, cx, cy, width, height, row = view.slope, view.cx, view.cy, view.width, view.height, disks.row
    across, special = -(-width // TILE), CLIPPED | ELLIPTIC
    nearest, best = np.empty(TILE * TILE, np.float32), np.empty(TILE * TILE, np.int32)
    owner, total = np.empty(TILE * TILE, np.int32), np.empty((TILE * TILE, 8), np.float32)
    us, zs = np.empty(TILE, np.float32), np.empty(TILE, np.float32)
    for tile in range(first, last):
        left, top = (tile % across) * TILE, (tile // across) * TILE
        right, bottom = min(left + TILE, width) - 1, min(top + TILE, height) - 1
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                p = y * width + x
                state[y, x], depth[p], out_leaf[p], out_row[p] = NOTHING, _INF, -1, -1
                for k in range(3):
                    normal[p, k], color[p, k] = _ZERO, _ZERO
        if starts[2 * tile] == starts[2 * tile + 2]:
            continue
        nearest[:], best[:], owner[:], total[:, :] = _INF, -1, -1, _ZERO
        farthest, sides, creased = _INF, 1, False
        for run in range(4):  # what faces the camera and what does not, nearest first; then the same, blended
            side, blend = run & 1, run >= 2
            if blend and side >= sides:
                break
            for entry in range(starts[2 * tile + side], starts[2 * tile + side + 1]):
                i = entries[entry]
                sx, sy, pixel, ez = record[i, 0], record[i, 1], record[i, 2], record[i, 3]
                nx, ny, nz, inverse, r = record[i, 4], record[i, 5], record[i, 6], record[i, 7], record[i, 8]
                if side == 1 and ez - r > farthest:
                    continue
                mark, mine, gate, bend = flags[i], label[i], BLEND * r, record[i, 10]
                small = r < PIXEL * pixel
                x0 = max(left, box[i, 0])
                count = np.uint64(min(right, box[i, 1]) + 1 - x0)
                from_middle, from_axis = np.float32(x0) - sx, np.float32(x0) - cx
                for y in range(max(top, box[i, 2]), min(bottom, box[i, 3]) + 1):
                    base = np.uint64((y - top) * TILE + x0 - left)
                    ay, dy = (np.float32(y) - sy) * pixel, (np.float32(y) - cy) * slope
                    side_y, ahead = ny * ay, ny * dy + nz
                    for h in range(count):  # as in fragment()
                        fh = np.float32(np.int32(h))
                        ax, dx = (fh + from_middle) * pixel, (fh + from_axis) * slope
                        toward = nx * dx + ahead
                        s = -(nx * ax + side_y) / toward
                        qx, qy = ax + s * dx, ay + s * dy
                        square = qx * qx + qy * qy + s * s
                        turned = toward + bend * (qx * dx + qy * dy + s)
                        missed = turned * turned < bend * bend * (dx * dx + dy * dy + _ONE - toward * toward) * square
                        us[h], zs[h] = _TWO if missed else square * inverse, ez + s
                    if mark & special:
                        for h in range(count):
                            fx, fy = np.float32(np.int32(h)) + np.float32(x0), np.float32(y)
                            u, _, qx, qy, qz = fragment(
                                fx, fy, sx, sy, pixel, ez, nx, ny, nz, inverse, bend, slope, cx, cy
                            )
                            us[h] = shaped(u, qx, qy, qz, i, flags, own, leaf, clips, planes, motions)
                    elif small:
                        for h in range(count):
                            if not us[h] < _ONE:
                                us[h] = in_pixels(np.float32(np.int32(h)) + np.float32(x0), np.float32(y), sx, sy)
                                zs[h] = ez
                    if not blend:
                        for h in range(count):
                            if us[h] < _ONE and zs[h] < nearest[base + h]:
                                nearest[base + h], best[base + h], owner[base + h] = zs[h], i, mine
                        continue
                    for h in range(count):
                        at = base + h
                        over = zs[h] - nearest[at]
                        if not (us[h] < _ONE and over <= gate and owner[at] == mine):
                            continue
                        if mark & CREASE or (creased and flags[best[at]] & CREASE):
                            j = best[at]
                            if nx * record[j, 4] + ny * record[j, 5] + nz * record[j, 6] < ALIKE:
                                continue
                        weight = (_ONE - us[h]) * (_ONE - us[h]) + _LEAST
                        total[at, 0] += weight
                        total[at, 1] += weight * over
                        total[at, 2] += weight * nx
                        total[at, 3] += weight * ny
                        total[at, 4] += weight * nz
                        total[at, 5] += weight * np.float32(colors[i, 0])
                        total[at, 6] += weight * np.float32(colors[i, 1])
                        total[at, 7] += weight * np.float32(colors[i, 2])
                        if mark & EDGE:
                            state[y, x0 + np.int64(h)] = UNSURE
            if run == 0:
                farthest = -_INF
                for y in range(bottom - top + 1):
                    for x in range(right - left + 1):
                        farthest = max(farthest, nearest[y * TILE + x])
            elif run == 1:
                for at in range(TILE * TILE):
                    if best[at] >= 0:
                        creased = creased or flags[best[at]] & CREASE != 0
                        sides = 2 if owner[at] & 1 == 1 else sides
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                at = np.uint64((y - top) * TILE + x - left)
                i = best[at]
                if i < 0:
                    continue
                if total[at, 0] < THIN * (_ONE - abs(record[i, 9])):
                    state[y, x] = UNSURE
                if state[y, x] == UNSURE:
                    continue
                state[y, x] = SURE
                p, mean = y * width + x, _ONE / total[at, 0]
                depth[p], out_leaf[p], out_row[p] = nearest[at] + total[at, 1] * mean, leaf[i], row[i]
                nx, ny, nz = total[at, 2], total[at, 3], total[at, 4]
                length = math.sqrt(nx * nx + ny * ny + nz * nz)
                if not length > _ZERO:
                    nx, ny, nz, length = record[i, 4], record[i, 5], record[i, 6], _ONE
                if nz > _ZERO:
                    length = -length
                normal[p, 0], normal[p, 1], normal[p, 2] = nx / length, ny / length, nz / length
                for k in range(3):
                    color[p, k] = total[at, 5 + k] * mean


@inlined
def shaped(u, qx, qy, qz, i, flags, axes, leaf, clips, planes, motions):
    """Return the distance in an elliptical disk, and 2 where a clip plane takes the place away."""
    if flags[i] & ELLIPTIC:
        a = qx * axes[i, 0] + qy * axes[i, 1] + qz * axes[i, 2]
        b = qx * axes[i, 3] + qy * axes[i, 4] + qz * axes[i, 5]
        u = a * a + b * b if u < _TWO else u
    if flags[i] & CLIPPED and u < _ONE:
        m = leaf[i]
        x = motions[m, 0, 0] * qx + motions[m, 1, 0] * qy + motions[m, 2, 0] * qz
        y = motions[m, 0, 1] * qx + motions[m, 1, 1] * qy + motions[m, 2, 1] * qz
        z = motions[m, 0, 2] * qx + motions[m, 1, 2] * qy + motions[m, 2, 2] * qz
        for k in range(clips[i], clips[i + 1]):
            if planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z > planes[k, 3]:
                u = np.float32(2.0)
                break
    return u
