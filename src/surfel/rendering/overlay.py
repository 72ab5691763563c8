"""Overlay: the curves along which operands meet, drawn over a picture where nothing hides them."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Booleans, Floats
from surfel.core.errors import InputError
from surfel.rendering.camera import Camera, Projected
from surfel.shapes.base import Shape
from surfel.shapes.tree import Tree

INK = (166, 30, 38)
"""Red, green and blue of the curves."""

_HALF = 0.8  # pixels: half of a curve's width
_AROUND = 2  # pixels that a line of this width can reach
_STEP = 0.5  # pixels between places at which a curve is looked at
_BEFORE = 2.0  # pixels, in depth: a curve lies on two surfaces, of which one may just hide it
_MOST = 1 << 16  # places on one piece: one that runs past the camera is as long as one likes

_traced: WeakKeyDictionary[Shape, list[Floats]] = WeakKeyDictionary()
_lock = threading.Lock()


def curves_of(given: Any) -> list[Floats]:
    """Return the curves of results of Boolean operations and of trees, which are combined for that, once.

    Raises
    ------
    InputError
        If there is neither, or a tree cannot be combined.
    """
    things = [given] if isinstance(given, Shape) or not isinstance(given, Iterable) else list(given)
    found = [_curves(thing) for thing in things]
    if all(curves is None for curves in found):
        raise InputError("curve=True draws where operands meet; give a tree, or what surfel.combine returned")
    return [line for curves in found if curves is not None for line in curves]


def _curves(thing: Any) -> list[Floats] | None:
    if isinstance(thing, Tree):
        from surfel.booleans.combine import combine

        with _lock:
            if thing not in _traced:
                _traced[thing] = combine(thing).curve
            return _traced[thing]
    curves: list[Floats] | None = getattr(thing, "curve", None)
    return curves


def draw_over(pixels: NDArray[np.uint8], depth: Floats, camera: Camera, curves: list[Floats]) -> None:
    """Draw polylines into a picture, with smooth edges, where what is seen does not hide them.

    Parameters
    ----------
    pixels : NDArray[np.uint8], shape (h, w, 3)
        Is written to.
    depth : Floats, shape (h, w)
        How far ahead of the camera what is seen lies; infinite where nothing is.
    camera : Camera
        Of the picture.
    curves : list of Floats, each of shape (m, 3)
        In the world.
    """
    height, width = depth.shape
    reach = np.pad(depth, 1, mode="edge")
    farthest = np.max([reach[v : v + height, u : u + width] for v in range(3) for u in range(3)], axis=0)
    ink = np.zeros((height, width))
    for line in curves:
        if len(line) > 1:
            _draw(line, farthest, camera, ink)
    ys, xs = np.nonzero(ink)
    share = ink[ys, xs, None]
    pixels[ys, xs] = np.rint(pixels[ys, xs] * (1.0 - share) + np.array(INK) * share).astype(np.uint8)


def _draw(line: Floats, farthest: Floats, camera: Camera, ink: Floats) -> None:
    """Add the share of each pixel that one polyline covers."""
    height, width = ink.shape
    start, end = _ends(camera.project(line, (width, height)), (width, height), camera.orthographic)
    if not len(start):
        return
    counts = np.ceil(np.hypot(*(end - start)[:, :2].T) / _STEP).clip(1, _MOST).astype(np.int64)
    piece = np.repeat(np.arange(len(start)), counts)
    share = (np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[piece]
    place = start[piece] + share[:, None] * (end - start)[piece]
    column, row = np.rint(place[:, 0]).astype(np.int64), np.rint(place[:, 1]).astype(np.int64)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    place, column, row = place[inside], column[inside], row[inside]
    ahead = place[:, 2] if camera.orthographic else 1.0 / place[:, 2]
    one = (camera.distance if camera.orthographic else ahead) / camera.focal(height)
    seen = ahead <= farthest[row, column] + _BEFORE * one
    _cover(place[seen], column[seen], row[seen], ink)


def _ends(seen: Projected, size: tuple[int, int], parallel: bool) -> tuple[Floats, Floats]:
    """Return both ends of the pieces that may be in the picture: column, row, and what is even along them.

    That is the depth in parallel pictures, and one over it in others.
    """
    with np.errstate(divide="ignore"):
        even = seen.depth if parallel else 1.0 / seen.depth
    ends = np.column_stack([seen.x, seen.y, even])
    start, end = ends[:-1], ends[1:]
    low, high = np.minimum(start, end)[:, :2], np.maximum(start, end)[:, :2]
    good: Booleans = np.isfinite(start + end).all(axis=1) & (high > -_AROUND).all(axis=1)
    good &= (low < np.array(size) + _AROUND).all(axis=1)
    return start[good], end[good]


def _cover(place: Floats, column: NDArray[np.int64], row: NDArray[np.int64], ink: Floats) -> None:
    """Mark pixels by how near a curve passes their centres."""
    height, width = ink.shape
    for v in range(-_AROUND, _AROUND + 1):
        for u in range(-_AROUND, _AROUND + 1):
            x, y = column + u, row + v
            away = np.hypot(place[:, 0] - x, place[:, 1] - y)
            share = np.clip(_HALF + 0.5 - away, 0.0, 1.0)
            good = (share > 0.0) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
            np.maximum.at(ink, (y[good], x[good]), share[good])
