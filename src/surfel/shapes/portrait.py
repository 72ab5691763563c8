"""Portrait: a small picture of a cloud as dots, for notebooks; made in milliseconds, without a kernel."""

from __future__ import annotations

import math
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats

if TYPE_CHECKING:
    from surfel.shapes.cloud_columns import CloudColumns

_SIZE = (360, 270)
_FROM = np.array([0.55, -0.72, 0.42])
"""Where it is looked at from: in front, to the right and above, as :func:`surfel.render` does."""

_MOST = 60_000  # points that are drawn
_SHARE = 2.5  # of the picture that the dots, all together, would cover
_LARGEST = 6  # pixels
_SAND = np.array([214.0, 196.0, 168.0])
_MARGIN = 1.08


def portrait(cloud: CloudColumns) -> bytes:
    """Return a picture of a cloud as PNG, seen along parallel lines."""
    from PIL import Image

    stream = BytesIO()
    Image.fromarray(_dots(cloud)).save(stream, format="PNG")
    return stream.getvalue()


def _dots(cloud: CloudColumns) -> NDArray[np.uint8]:
    """Return the pixels: dots from the farthest to the nearest, the nearer the brighter."""
    width, height = _SIZE
    pixels = np.full((height, width, 3), 255, np.uint8)
    rows = np.arange(0, len(cloud), len(cloud) // _MOST + 1)
    if not len(rows):
        return pixels
    seen = _turned(cloud.points[rows] - cloud.bounds.mean(axis=0))
    low, high = seen.min(axis=0), seen.max(axis=0)
    span = np.maximum(high - low, 1e-9 * float((high - low).max()))
    scale = min(width / span[0], height / span[1]) / _MARGIN if span[2] > 0.0 else 0.0
    x = (seen[:, 0] - 0.5 * (low[0] + high[0])) * scale + 0.5 * width
    y = (seen[:, 1] - 0.5 * (low[1] + high[1])) * scale + 0.5 * height
    side = int(np.clip(round(math.sqrt(_SHARE * width * height / len(rows))), 1, _LARGEST))
    order = np.argsort(-seen[:, 2], kind="stable")
    color = (_colors(cloud, rows) * _light(cloud, rows, seen)[:, None]).astype(np.uint8)[order]
    for off_y in range(side):
        for off_x in range(side):
            column = np.clip(x - 0.5 * side + off_x, 0, width - 1).astype(np.int64)[order]
            line = np.clip(y - 0.5 * side + off_y, 0, height - 1).astype(np.int64)[order]
            pixels[line, column] = color  # of several dots on a pixel the last one stays
    return pixels


def _turned(vectors: Floats) -> Floats:
    """Return vectors as right, down and away from the viewer."""
    ahead = -_FROM / np.linalg.norm(_FROM)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.asarray(vectors @ np.stack([right, np.cross(ahead, right), ahead]).T)


def _light(cloud: CloudColumns, rows: NDArray[np.int64], seen: Floats) -> Floats:
    """Return how bright the dots are: by their normals where these are known, else by their depth."""
    if cloud.normals is not None:
        facing = np.nan_to_num(np.abs(_turned(cloud.normals[rows])[:, 2]))
        return np.asarray(0.45 + 0.55 * np.minimum(facing, 1.0))
    depth = seen[:, 2] - seen[:, 2].min()
    return np.asarray(1.0 - 0.55 * depth / (depth.max() or 1.0))


def _colors(cloud: CloudColumns, rows: NDArray[np.int64]) -> Floats:
    given = cloud.colors
    if given is None:
        return np.broadcast_to(_SAND, (len(rows), 3))
    rgb = np.nan_to_num(np.asarray(given[rows, :3], np.float64))
    full = 1.0 if given.dtype.kind == "f" else max(255.0, float(rgb.max(initial=0.0)))
    return np.asarray(np.clip(255.0 * rgb / full, 0.0, 255.0))
