"""Steps between close pairs: noise that is far below the relief of the surface, or that given normals deny.

Two points that lie much nearer to each other than the spacing see the same surface, whatever its relief: the step
between their heights over a quadric is noise. Random points have such pairs, one in fifty within 0.15 spacings; and it
is these pairs whose noise makes the area of random points grow.

Where normals are given, a neighbour on the surface lies off both tangent planes to opposite sides, on any arc of a
circle by the same. What is left over is noise; and where nothing is, there is none, though two sheets that lie closer
than their points look like it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows
from surfel._vec import tangent_frame
from surfel.core.cast import Floats
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import SAMPLE, over_quadric, quadric_residual, sample_rows
from surfel.surface.planes import plane_of_neighbours
from surfel.surface.twist import off_arc

CLOSE, FAR = 0.15, 0.3
"""Distances, in spacings, of pairs that are close, and of those that take over where noise drives close ones apart."""

LEAST_PAIRS = 60
"""Fewer pairs tell nothing."""

TAKE_OVER = 0.03
"""Level above which close pairs are those that noise happens not to part: the farther ones tell it better."""

UP_TO = 0.1
"""Above this level both kinds are parted; then quadrics tell the noise."""

DENIED_BELOW = 0.05
"""Level that given normals show below which they are believed: wrong ones, and those of noisy points, show more."""

_MOST = 3000  # pairs that are looked at
_NEIGHBOURS = 12
_MEDIAN_STEP = 0.67449 * math.sqrt(2.0)  # of the difference of two normal numbers of deviation 1


def step_level(hood: Neighbourhoods) -> float:
    """Return the noise, in spacings, that the steps of close pairs show; 0 where there are too few such pairs."""
    apart = np.sqrt(hood.squared[:, 0]) / np.where(hood.spacing > 0.0, hood.spacing, math.inf)
    if hood.near.shape[1] < _NEIGHBOURS:
        return 0.0
    close = _median_step(hood, apart, 0.0, CLOSE)
    return close if close < TAKE_OVER else min(max(close, _median_step(hood, apart, CLOSE, FAR)), UP_TO)


def given_level(hood: Neighbourhoods, normals: Floats) -> float:
    """Return the noise, in spacings, that unit normals (zero where unknown) leave to the points; infinite if unknown.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the points.
    normals : Floats, shape (n, 3)
        In the order of ``hood``, of either sign.
    """
    chosen = sample_rows(hood.points, SAMPLE)
    off = np.empty(len(chosen))
    _write_offsets(len(chosen), hood.points, normals, chosen, hood.near, hood.spacing, off)
    off = off[off >= 0.0]
    return float(np.median(off)) / _MEDIAN_STEP if 2 * len(off) > len(chosen) else math.inf


def _median_step(hood: Neighbourhoods, apart: Floats, low: float, high: float) -> float:
    chosen = np.flatnonzero((apart >= low) & (apart < high))
    if len(chosen) < LEAST_PAIRS:
        return 0.0
    if len(chosen) > _MOST:
        chosen = chosen[np.argpartition(apart[chosen], _MOST)[:_MOST]]
    step = _steps_of(hood, np.sort(chosen).astype(np.int32))
    return float(np.median(step)) / _MEDIAN_STEP


def _steps_of(hood: Neighbourhoods, chosen: NDArray[np.int32]) -> Floats:
    """Return the step from each chosen point to its nearest neighbour, over a quadric through both, in spacings."""
    out = np.empty(len(chosen))
    _write_steps(len(chosen), hood.points, chosen, hood.near, hood.spacing, out)
    return out


@rows
def _write_steps(first, last, points, chosen, near, spacing, step):
    f, matrix, right = np.empty(6), np.empty((6, 6)), np.empty(6)
    k = np.int64(_NEIGHBOURS)
    for row in range(first, last):
        i = chosen[row]
        quadric_residual(points, i, near, i, k, f, matrix, right)  # leaves its coefficients in ``right``
        nx, ny, nz, _, cx, cy, cz = plane_of_neighbours(points, i, near, i, k)
        e = tangent_frame(nx, ny, nz)
        far = near[i, k - 1]
        dx, dy, dz = points[far, 0] - points[i, 0], points[far, 1] - points[i, 1], points[far, 2] - points[i, 2]
        scale = 1.0 / (math.sqrt(dx * dx + dy * dy + dz * dz) + 1e-300)
        off = 0.0
        for end in range(2):
            j = i if end == 0 else near[i, 0]
            x, y, z = points[j, 0] - cx, points[j, 1] - cy, points[j, 2] - cz
            u = (x * e[0] + y * e[1] + z * e[2]) * scale
            v = (x * e[3] + y * e[4] + z * e[5]) * scale
            off = over_quadric(right, u, v, x * nx + y * ny + z * nz) - off
        step[row] = abs(off) / spacing[i]


@rows
def _write_offsets(first, last, points, normals, chosen, near, spacing, off):
    """Write how far the nearest neighbour of the same sheet lies off what both normals say; -1 where there is none."""
    for row in range(first, last):
        i = chosen[row]
        off[row] = -1.0
        for a in range(near.shape[1]):
            cosine, gap, steep, square = off_arc(points, normals, i, near[i, a])
            if abs(cosine) < 0.8 or steep * steep > 0.36 * square:
                continue
            off[row] = 0.5 * abs(gap) / spacing[i]
            break
