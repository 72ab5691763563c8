"""Shading: soft light from the camera, corners that light reaches less, and lines round what stands in front."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, rows, threads_for
from surfel.rendering.eights import LANES, load, pick, ramp, root, some, store
from surfel.rendering.fragments import Fragments
from surfel.rendering.memory import room
from surfel.rendering.placing import View

KEY = np.array([-0.42, -0.55, -0.72]) / math.sqrt(0.42**2 + 0.55**2 + 0.72**2)
"""Where the key light comes from, in the camera's frame: over the viewer's left shoulder."""

_KEY_X, _KEY_Y, _KEY_Z = (np.float32(k) for k in KEY)
_HALFWAY = (KEY + [0.0, 0.0, -1.0]) / np.linalg.norm(KEY + [0.0, 0.0, -1.0])
_HALF_X, _HALF_Y, _HALF_Z = (np.float32(k) for k in _HALFWAY)

_AMBIENT, _HEAD, _KEY, _SKY = np.float32(0.18), np.float32(0.34), np.float32(0.46), np.float32(0.12)
_SHEEN = np.float32(0.06)
_REACH = 0.035  # of the picture's height: how far corners are looked for
_SAMPLES = 12
_OCCLUSION, _OUTLINE, _DARKEST = np.float32(1.9), np.float32(0.55), np.float32(0.15)
_RISE, _STEP = np.float32(0.1), np.float32(0.15)  # what is not dark yet: of slopes, and of steps over the reach
_ZERO, _QUARTER, _HALF, _ONE, _FOUR, _INF = (np.float32(v) for v in (0.0, 0.25, 0.5, 1.0, 4.0, np.inf))
_GAMMA = 2.2


class Developed(NamedTuple):
    """A picture, and how much of the light reaches each of its pixels."""

    pixels: NDArray[np.uint8]  # (h, w, 3)
    light: NDArray[np.float32]  # (h, w): 0 to 1


def developed(seen: Fragments, view: View, background: NDArray[np.uint8]) -> Developed:
    """Return what every line of sight sees, in the light.

    Ambient occlusion from the depths alone (after Filion and McNaughton, *Effects and Techniques*, 2008): of places
    round each pixel, those that rise over its tangent plane and are not far take light away. Just behind what stands in
    front it is darker, as in eye-dome lighting (Boucheny, 2009).

    Parameters
    ----------
    seen : Fragments
        Of every pixel, row after row.
    view : View
        The picture.
    background : NDArray[np.uint8], shape (3,)
        Red, green and blue.
    """
    shape = (view.height, view.width)
    found = Developed(room((*shape, 3), np.uint8), room(shape, np.float32))
    grid = (seen.depth.reshape(shape), seen.normal.reshape(*shape, 3), seen.color.reshape(*shape, 3))
    radius = max(3.0, _REACH * view.height)
    rim = int(radius) + 1
    wide = room((view.height + 2 * rim, view.width + 2 * rim + LANES), np.float32)
    wide[:rim] = wide[-rim:] = wide[:, :rim] = wide[:, rim + view.width :] = np.inf
    wide[rim : rim + view.height, rim : rim + view.width] = grid[0]
    with threads_for(30 * len(seen)):
        _develop(
            view.height, *grid, view, _pattern(radius), np.float32(radius), np.tile(background, view.width), _LINEAR,
            _BYTES, wide, np.int64(rim), *found,
        )  # fmt: skip
    return found


def mean_of_places(
    seen: Fragments,
    places: int,
    pixels: NDArray[np.int64],
    background: NDArray[np.uint8],
    picture: Developed,
) -> None:
    """Write the mean of several places into pixels of a picture.

    Parameters
    ----------
    seen : Fragments
        ``places`` rows for each of the pixels.
    places : int
        How many that are.
    pixels : NDArray[np.int64], shape (p,)
        Which pixels.
    background : NDArray[np.uint8], shape (3,)
        Red, green and blue.
    picture : Developed
        Its pixels are written to; the light at their centres is taken for all places.
    """
    with threads_for(30 * len(pixels)):
        _average(
            len(pixels), pixels, np.int64(places), seen.depth, seen.normal, seen.color, background, _LINEAR, _BYTES,
            picture.light.reshape(-1), picture.pixels.reshape(-1, 3),
        )  # fmt: skip


_LINEAR = ((np.arange(256) / 255.0) ** _GAMMA).astype(np.float32)
_BYTES = np.rint(255.0 * np.linspace(0.0, 1.0, 4096) ** (1.0 / _GAMMA)).astype(np.uint8)


def _pattern(radius: float) -> NDArray[np.int64]:
    """Return offsets: the four neighbours, and a spiral, in whole pixels, so that nothing has to be interpolated."""
    k = np.arange(_SAMPLES) + 0.5
    reach, angle = radius * np.sqrt(k / _SAMPLES), k * math.pi * (3.0 - math.sqrt(5.0))
    spiral = np.rint(np.column_stack([reach * np.cos(angle), reach * np.sin(angle)])).astype(np.int64)
    return np.concatenate([[[1, 0], [-1, 0], [0, 1], [0, -1]], spiral])


@inlined
def _strength(nx, ny, nz):
    """Return how bright a surface is by its normal in the camera's frame, and the sheen on it; or eight surfaces."""
    diffuse, ahead = nx * _KEY_X + ny * _KEY_Y + nz * _KEY_Z, -nz
    sheen = nx * _HALF_X + ny * _HALF_Y + nz * _HALF_Z
    diffuse, ahead = pick(diffuse > _ZERO, diffuse, _ZERO), pick(ahead > _ZERO, ahead, _ZERO)
    sheen = pick(sheen > _ZERO, sheen, _ZERO)
    for _ in range(5):
        sheen = sheen * sheen
    bright = _HEAD * ahead + _KEY * diffuse + _SKY * (_HALF - _HALF * ny) + _AMBIENT
    return bright, _SHEEN * sheen


@rows
def _develop(
    first, last, depth, normal, color, view, pattern, radius, ground, linear, encoded, wide, rim, pixels, light
):
    """Develop some rows, eight pixels at once."""
    width = depth.shape[1]
    slope, middle, size, cx, cy = view.slope, view.depth, view.size, view.cx, view.cy
    stride = wide.shape[1]
    around, most, one = wide.reshape(-1), np.float32(len(encoded) - 1), _ONE
    lanes, none, eight = np.zeros(8 * LANES, np.float32), np.uint64(0), np.uint64(LANES)
    for y in range(first, last):
        bytes_of = pixels[y].reshape(-1)
        for x in range(np.uint64(width)):
            light[y, x] = one
        for k in range(np.uint64(3 * width)):
            bytes_of[k] = ground[k]
        for begin in range(0, width, LANES):
            z = load(around, np.uint64((y + rim) * stride + begin + rim))
            if not some(z < _INF):
                continue
            number = min(LANES, width - begin)
            for lane in range(np.uint64(number)):
                x = np.uint64(begin) + lane
                for k in range(np.uint64(3)):
                    lanes[k * eight + lane] = normal[y, x, k]
                    lanes[(k + np.uint64(3)) * eight + lane] = linear[color[y, x, k]]
            nx, ny, nz = load(lanes, none), load(lanes, eight), load(lanes, eight + eight)
            lit = _reached(around, stride, rim, begin, y, z, nx, ny, nz, slope, middle, size, cx, cy, pattern, radius)
            bright, sheen = _strength(nx, ny, nz)
            for k in range(np.uint64(3), np.uint64(6)):
                value = lit * (load(lanes, k * eight) * bright + sheen)
                value = pick(value > _ZERO, value, _ZERO)  # what is no number fails comparisons
                store(lanes, k * eight, pick(value < _ONE, value, _ONE) * most)
            store(lanes, np.uint64(6) * eight, lit)
            for lane in range(np.uint64(number)):
                x = np.uint64(begin) + lane
                if depth[y, x] < _INF:
                    light[y, x] = lanes[np.uint64(6) * eight + lane]
                    for k in range(np.uint64(3)):
                        pixels[y, x, k] = encoded[np.int32(lanes[(k + np.uint64(3)) * eight + lane])]


@inlined
def _reached(around, stride, rim, x, y, z, nx, ny, nz, slope, middle, size, cx, cy, pattern, radius):
    """Return how much of the light reaches eight pixels, 0 to 1."""
    pixel = (z + middle) * slope if slope > _ZERO else z * _ZERO + size
    reach = pixel * radius
    dark = front = pixel * _ZERO
    over_square = _ONE / (reach * reach)
    for k in range(len(pattern)):
        h, v = pattern[k, 0], pattern[k, 1]
        # where the other places lie, seen from these; what is not finite fails the comparisons
        rise = load(around, np.uint64((y + v + rim) * stride + x + h + rim)) - z
        there = (ramp() + (np.float32(x + h) - cx)) * slope
        ox = pixel * np.float32(h) + there * rise
        oy = pixel * np.float32(v) + rise * ((np.float32(y + v) - cy) * slope)
        over = nx * ox + ny * oy + nz * rise
        if not some(over > _ZERO):
            continue
        if k < 4:
            step = over / reach - _STEP
            front = front + pick((step > _ZERO) & (step < _INF), step, _ZERO)
        else:
            square = ox * ox + oy * oy + rise * rise
            fade, angle = square * over_square, over / root(square) - _RISE
            dark = dark + pick((angle > _ZERO) & (fade < _FOUR), angle * (_ONE - fade * _QUARTER), _ZERO)
    light = _ONE - dark * (_OCCLUSION / np.float32(len(pattern) - 4))
    light = pick(light < _DARKEST, _DARKEST, light)
    return light * (_ONE - pick(front < _ONE, front, _ONE) * _OUTLINE)


@rows
def _average(first, last, rows, places, depth, normal, color, background, linear, encoded, light, pixels):
    most, total = np.float32(len(encoded) - 1), np.empty(3, np.float32)
    for r in range(first, last):
        total[:] = _ZERO
        for s in range(r * places, (r + 1) * places):
            if not depth[s] < _INF:
                for k in range(3):
                    total[k] += linear[background[k]]
                continue
            reached = light[rows[r]]
            bright, sheen = _strength(normal[s, 0], normal[s, 1], normal[s, 2])
            for k in range(3):
                total[k] += reached * (linear[color[s, k]] * bright + sheen)
        for k in range(3):
            value = total[k] / np.float32(places)
            value = value if value > _ZERO else _ZERO  # what is no number fails comparisons
            pixels[rows[r], k] = encoded[np.int32((value if value < _ONE else _ONE) * most)]
