"""Placing: where each surfel falls in a picture, and which of them fall in each of its tiles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel, rows, threads_for
from surfel.rendering.camera import Camera
from surfel.rendering.disks import Disks

TILE = 32
PIXEL = np.float32(0.5)  # pixels: smaller disks are drawn as circles of this radius

_CHUNKS = 32  # runs of surfels that are placed and counted apart; a fixed number, so that their order never changes
_BLOCK = 512
_ZERO, _ONE, _INF = np.float32(0.0), np.float32(1.0), np.float32(np.inf)


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
    """Which tiles splats fall in."""

    box: NDArray[np.int16]  # (n, 4): first and last column, first and last row
    label: NDArray[np.int32]  # (n,): twice the leaf, plus one where seen from its back; -1 where not seen
    starts: NDArray[np.int64]  # (2 tiles + 1,): of each tile those that face the camera, then the others
    entries: NDArray[np.int32]

    @property
    def fullest(self) -> int:
        """How many splats fall in a tile at most."""
        return int(np.diff(self.starts[::2]).max(initial=0))


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
    """Sort surfels into the tiles of a picture.

    Parameters
    ----------
    disks : Disks
        The surfels.
    motions : NDArray[np.float32], shape (leaves, 3, 4)
        From the frame of each cloud to the camera's, depth relative to the scene's middle.
    view : View
        The picture.
    """
    n = len(disks.radii)
    across, down = -(-view.width // TILE), -(-view.height // TILE)
    box, label = np.empty((n, 4), np.int16), np.empty(n, np.int32)
    counts = np.zeros((_CHUNKS, 2 * across * down), np.int32)
    starts = np.empty(2 * across * down + 1, np.int64)
    with threads_for(4 * n):
        _place(_CHUNKS, disks, motions, view, np.int64(across), box, label, counts)
        _starts_of(counts, starts)
        entries = np.empty(int(starts[-1]), np.int32)
        _enter(_CHUNKS, box, label, np.int64(across), counts, entries)
    return Placed(box, label, starts, entries)


@rows
def _place(first, last, disks, motions, view, across, box, label, counts):
    """Bound the surfels of some chunks in the picture, and count how many fall in each tile."""
    points, normals, radii, leaf = disks.points, disks.normals, disks.radii, disks.leaf
    slope, middle, near, size, cx, cy = view.slope, view.depth, view.near, view.size, view.cx, view.cy
    right, bottom = np.float32(view.width - 1), np.float32(view.height - 1)
    n = len(radii)
    edges = np.empty((5, _BLOCK), np.float32)
    for chunk in range(first, last):
        begin, end = n * chunk // _CHUNKS, n * (chunk + 1) // _CHUNKS
        while begin < end:
            m = leaf[begin]
            stop = min(begin + _BLOCK, end)
            while leaf[stop - 1] != m:
                stop -= 1
            a00, a01, a02, a03 = motions[m, 0, 0], motions[m, 0, 1], motions[m, 0, 2], motions[m, 0, 3]
            a10, a11, a12, a13 = motions[m, 1, 0], motions[m, 1, 1], motions[m, 1, 2], motions[m, 1, 3]
            a20, a21, a22, a23 = motions[m, 2, 0], motions[m, 2, 1], motions[m, 2, 2], motions[m, 2, 3]
            for h in range(np.uint64(stop - begin)):  # without branches: the compiler takes several at once
                i = np.uint64(begin) + h
                x, y, z = points[0, i], points[1, i], points[2, i]
                a, b, c, r = normals[0, i], normals[1, i], normals[2, i], radii[i]
                ex, ey = a00 * x + a01 * y + a02 * z + a03, a10 * x + a11 * y + a12 * z + a13
                ez = a20 * x + a21 * y + a22 * z + a23
                nx, ny, nz = a00 * a + a01 * b + a02 * c, a10 * a + a11 * b + a12 * c, a20 * a + a21 * b + a22 * c
                depth = middle + ez
                pixel = depth * slope if slope > _ZERO else size
                tx, ty = ex / pixel * slope, ey / pixel * slope  # 0 in parallel pictures
                sx, sy = cx + ex / pixel, cy + ey / pixel
                flat = _ONE - nz * nz
                nearest = pixel - r * math.sqrt(flat if flat > _ZERO else _ZERO) * slope
                one, two = nx - tx * nz, ny - ty * nz
                wide, high = _ONE + tx * tx - one * one, _ONE + ty * ty - two * two
                half_x = r * math.sqrt(wide if wide > _ZERO else _ZERO) / nearest
                half_y = r * math.sqrt(high if high > _ZERO else _ZERO) / nearest
                least = PIXEL if r < PIXEL * pixel else _ZERO
                half_x, half_y = half_x if half_x > least else least, half_y if half_y > least else least
                low_x, low_y, high_x, high_y = sx - half_x, sy - half_y, sx + half_x, sy + half_y
                seen = (ez > near) & (nearest > _ZERO) & (low_x <= high_x) & (low_y <= high_y)
                edges[0, h] = math.ceil(low_x if low_x > _ZERO else _ZERO) if seen else _INF
                edges[1, h] = math.floor(high_x if high_x < right else right)
                edges[2, h] = math.ceil(low_y if low_y > _ZERO else _ZERO)
                edges[3, h] = math.floor(high_y if high_y < bottom else bottom)
                edges[4, h] = nx * tx + ny * ty + nz
            for h in range(stop - begin):
                i = begin + h
                if not (edges[0, h] <= edges[1, h] and edges[2, h] <= edges[3, h]):
                    label[i] = -1
                    continue
                x0, x1, y0, y1 = int(edges[0, h]), int(edges[1, h]), int(edges[2, h]), int(edges[3, h])
                box[i, 0], box[i, 1], box[i, 2], box[i, 3] = x0, x1, y0, y1
                back = 1 if edges[4, h] > _ZERO else 0
                label[i] = 2 * m + back
                for v in range(y0 // TILE, y1 // TILE + 1):
                    for u in range(x0 // TILE, x1 // TILE + 1):
                        counts[chunk, 2 * (v * across + u) + back] += 1
            begin = stop


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
        for i in range(n * chunk // _CHUNKS, n * (chunk + 1) // _CHUNKS):
            if label[i] < 0:
                continue
            back = label[i] & 1
            for v in range(box[i, 2] // TILE, box[i, 3] // TILE + 1):
                for u in range(box[i, 0] // TILE, box[i, 1] // TILE + 1):
                    bin = 2 * (v * across + u) + back
                    entries[places[chunk, bin]] = i
                    places[chunk, bin] += 1
