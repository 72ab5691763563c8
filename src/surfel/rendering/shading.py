"""Shading: soft light from the camera, corners that light reaches less, and lines round what stands in front."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, rows, threads_for
from surfel.rendering.fragments import Fragments
from surfel.rendering.raster import View

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
_ZERO, _HALF, _ONE, _FOUR, _INF = (np.float32(v) for v in (0.0, 0.5, 1.0, 4.0, np.inf))
_GAMMA = 2.2


def developed(seen: Fragments, view: View, background: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the pixels of a picture, shape (h, w, 3): what every line of sight sees, in the light.

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
    pixels = np.empty((view.height, view.width, 3), np.uint8)
    grid = (seen.depth.reshape(view.height, -1), seen.normal.reshape(view.height, -1, 3))
    color = seen.color.reshape(view.height, -1, 3)
    radius = max(3.0, _REACH * view.height)
    with threads_for(30 * len(seen)):
        _develop(
            view.height, *grid, color, view, _pattern(radius), np.float32(radius), background, _LINEAR, _BYTES, pixels
        )  # fmt: skip
    return pixels


def mean_of_places(
    seen: Fragments,
    places: int,
    centres: Fragments,
    view: View,
    pixels: NDArray[np.int64],
    background: NDArray[np.uint8],
    picture: NDArray[np.uint8],
) -> None:
    """Write the mean of several places into pixels of a picture.

    Parameters
    ----------
    seen : Fragments
        ``places`` rows for each of the pixels.
    places : int
        How many that are.
    centres : Fragments
        What every pixel of the picture sees at its centre: how much light reaches it is taken from there.
    view : View
        The picture.
    pixels : NDArray[np.int64], shape (p,)
        Which pixels.
    background : NDArray[np.uint8], shape (3,)
        Red, green and blue.
    picture : NDArray[np.uint8], shape (h, w, 3)
        Written to.
    """
    grid = (centres.depth.reshape(view.height, -1), centres.normal.reshape(view.height, -1, 3))
    radius = max(3.0, _REACH * view.height)
    with threads_for(30 * len(pixels)):
        _average(
            len(pixels), pixels, np.int64(places), seen.depth, seen.normal, seen.color, *grid, view, _pattern(radius),
            np.float32(radius), background, _LINEAR, _BYTES, picture.reshape(-1, 3),
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
    """Return how bright a surface is by its normal in the camera's frame, and the sheen on it."""
    diffuse = max(nx * _KEY_X + ny * _KEY_Y + nz * _KEY_Z, _ZERO)
    sheen = max(nx * _HALF_X + ny * _HALF_Y + nz * _HALF_Z, _ZERO)
    for _ in range(5):
        sheen *= sheen
    bright = _AMBIENT + _HEAD * max(-nz, _ZERO) + _KEY * diffuse + _SKY * (_HALF - _HALF * ny)
    return bright, _SHEEN * sheen


@inner
def _reached(depth, normal, x, y, view, pattern, radius):
    """Return how much of the light reaches a pixel, 0 to 1."""
    height, width = depth.shape
    slope, middle, size, cx, cy = view.slope, view.depth, view.size, view.cx, view.cy
    z = depth[y, x]
    pixel = (middle + z) * slope if slope > _ZERO else size
    nx, ny, nz = normal[y, x, 0], normal[y, x, 1], normal[y, x, 2]
    dark, front, reach = _ZERO, _ZERO, radius * pixel
    for k in range(len(pattern)):
        h, v = x + pattern[k, 0], y + pattern[k, 1]
        if h < 0 or v < 0 or h >= width or v >= height or not depth[v, h] < _INF:
            continue
        # where the other place lies, seen from this one
        rise = depth[v, h] - z
        ox = np.float32(pattern[k, 0]) * pixel + (np.float32(h) - cx) * slope * rise
        oy = np.float32(pattern[k, 1]) * pixel + (np.float32(v) - cy) * slope * rise
        over = nx * ox + ny * oy + nz * rise
        if k < 4:
            front += max(_ZERO, over / reach - _STEP)
            continue
        square = ox * ox + oy * oy + rise * rise
        fade = square / (reach * reach)
        if over > _ZERO and fade < _FOUR:
            dark += max(over / math.sqrt(square) - _RISE, _ZERO) * (_ONE - fade / _FOUR)
    light = max(_DARKEST, _ONE - _OCCLUSION * dark / np.float32(len(pattern) - 4))
    return light * (_ONE - _OUTLINE * min(front, _ONE))


@rows
def _develop(first, last, depth, normal, color, view, pattern, radius, background, linear, encoded, pixels):
    most = np.float32(len(encoded) - 1)
    for y in range(first, last):
        for x in range(depth.shape[1]):
            if not depth[y, x] < _INF:
                for k in range(3):
                    pixels[y, x, k] = background[k]
                continue
            light = _reached(depth, normal, x, y, view, pattern, radius)
            bright, sheen = _strength(normal[y, x, 0], normal[y, x, 1], normal[y, x, 2])
            for k in range(3):
                value = light * (linear[np.uint8(color[y, x, k] + _HALF)] * bright + sheen)
                pixels[y, x, k] = encoded[np.int32(min(value, _ONE) * most)]


@rows
def _average(
    first, last, rows, places, depth, normal, color, all_depth, all_normal, view, pattern, radius, background, linear,
    encoded, pixels,
):  # fmt: skip
    most, width = np.float32(len(encoded) - 1), all_depth.shape[1]
    total = np.empty(3, np.float32)
    for r in range(first, last):
        y, x = rows[r] // width, rows[r] % width
        light = _reached(all_depth, all_normal, x, y, view, pattern, radius) if all_depth[y, x] < _INF else _ONE
        total[:] = _ZERO
        for s in range(r * places, (r + 1) * places):
            bright, sheen = _strength(normal[s, 0], normal[s, 1], normal[s, 2])
            for k in range(3):
                if depth[s] < _INF:
                    total[k] += light * (linear[np.uint8(color[s, k] + _HALF)] * bright + sheen)
                else:
                    total[k] += linear[background[k]]
        for k in range(3):
            pixels[rows[r], k] = encoded[np.int32(min(total[k] / np.float32(places), _ONE) * most)]
