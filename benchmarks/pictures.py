"""Simple pictures of solids: parallel rays, the first hit of each, shaded by how it faces the eye."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from surfel.core.lines import Lines
from surfel.shapes.base import Shape

_COLORS = np.array(
    [
        [0.42, 0.56, 0.78], [0.86, 0.56, 0.34], [0.45, 0.68, 0.47],
        [0.77, 0.44, 0.49], [0.62, 0.52, 0.74], [0.72, 0.66, 0.40],
    ]
)  # fmt: skip
_ROOM = 1.06
_DARKEST = 0.25


def picture(shape: Shape, eye: tuple[float, float, float], size: int = 360, samples: int = 3) -> NDArray[np.uint8]:
    """Return an orthographic picture, shape (size, size, 3), seen from the direction ``eye``; each leaf has a color.

    Parameters
    ----------
    shape : Shape
        Any bounded shape.
    eye : three floats
        Where the eye lies from the middle of the shape; z is up.
    size : int
        Pixels along each side.
    samples : int
        Rays along each side of a pixel.
    """
    back = np.asarray(eye, float) / np.linalg.norm(eye)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    frame = np.stack([right, np.cross(back, right), back])
    corners = np.array(list(product(*np.asarray(shape.bounds).T))) @ frame.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = 0.5 * _ROOM * float((high - low)[:2].max())
    step = ((np.arange(size * samples) + 0.5) / (size * samples) * 2.0 - 1.0) * half
    across, up = np.meshgrid(0.5 * (low[0] + high[0]) + step, 0.5 * (low[1] + high[1]) - step)
    local = np.stack([across.ravel(), up.ravel(), np.full(across.size, 2.0 * high[2] - low[2])], axis=1)
    lines = Lines.of(local @ frame, np.tile(-back, (len(local), 1)), 1.0)
    image = _shaded(shape, lines).reshape(size, samples, size, samples, 3).mean(axis=(1, 3))
    return np.asarray(np.clip(255.0 * image + 0.5, 0, 255), np.uint8)


def _shaded(shape: Shape, lines: Lines) -> NDArray[np.float64]:
    """Return a color for each line: that of the leaf it hits first, darker the more it is turned away; else white."""
    hits = shape.cross(lines)
    colors = np.ones((len(lines), 3))
    hit = np.flatnonzero(hits.counts > 0)
    first = hits.offsets[hit]
    facing = _DARKEST + (1.0 - _DARKEST) * np.abs(hits.cosine[first])
    colors[hit] = _COLORS[hits.leaf[first] % len(_COLORS)] * facing[:, None]
    return colors
