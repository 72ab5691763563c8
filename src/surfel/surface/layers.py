"""Layers: scans laid over each other that do not quite fit, told by points that lie above each other.

Where two scans are off by a part of a spacing, the area of a surface through all points grows by a tenth or more, and
neither fitted quadrics nor close pairs show it: it is nowhere where the scans are shifted along the surface, and pairs
that lie close are those that the shift does not part. So points are paired by their distance *along* the surface. On a
surface the step between two such points is less than that distance, but for the steepest edges; of layers it is more.
Walls and other sheets of an object lie above each other, too. Their distance varies, and goes beyond what is noise.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows
from surfel._vec import tangent_frame
from surfel.core.cast import Floats
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import over_quadric, quadric_residual, sample_rows
from surfel.surface.planes import plane_of_neighbours

ABOVE = 0.1
"""Points this near to each other along the surface, in spacings, lie above each other."""

NOISE_TO, SHEETS_FROM, SHEETS_TO = 0.4, 0.45, 1.5
"""Steps, in spacings, that are noise at the most, and that sheets are apart."""

SHARE = 0.2
"""So many of the pairs that lie above each other have a step of more than their distance, where there are layers."""

SHEETS = 0.3
"""With more pairs than this, for each of these, that lie as far apart as sheets, they are walls."""

LEAST = 12
"""Fewer of them tell nothing."""

IN_PART, AROUND = 0.5, 12
"""Where scans overlap in a part only, so large a share of this many pairs that lie nearest each other are of layers."""

_SAMPLE, _NEIGHBOURS = 20_000, 12


def layers_level(hood: Neighbourhoods, *, parts: bool = True) -> float:
    """Return the noise, in spacings, that layers laid over each other make; 0 where there are none.

    ``parts`` says whether those of a part of the cloud count: thin walls look like them.
    """
    if hood.near.shape[1] < _NEIGHBOURS:
        return 0.0
    chosen = sample_rows(hood.points, _SAMPLE)
    apart, step = np.empty(len(chosen)), np.empty(len(chosen))
    _write_steps(len(chosen), hood.points, chosen, hood.near, hood.spacing, apart, step)
    above = np.flatnonzero((apart < ABOVE) & (step < SHEETS_TO))
    step, off = step[above], step[above] > apart[above]
    level = _level_of(step, off)
    return level if level > 0.0 or not parts else _level_in_part(hood.points[chosen[above]], step, off)


def _level_of(step: Floats, off: NDArray[np.bool_]) -> float:
    """Return the noise that pairs of such steps make, some of them ``off`` by more than their distance."""
    noise = step < NOISE_TO
    layers = noise & off
    count = np.count_nonzero(layers)
    sheets = np.count_nonzero(off & (step > SHEETS_FROM))
    if count < max(LEAST, SHARE * np.count_nonzero(noise)) or sheets > SHEETS * count:
        return 0.0
    return math.sqrt(0.5 * float(np.square(step[layers]).sum()) / np.count_nonzero(noise))


def _level_in_part(places: Floats, step: Floats, off: NDArray[np.bool_]) -> float:
    """Return the same for those pairs most of whose nearest pairs are of layers as well."""
    from scipy.spatial import cKDTree

    if np.count_nonzero(off) < LEAST or len(off) < AROUND:
        return 0.0
    near = cKDTree(places).query(places, AROUND)[1]
    there = off[near].mean(axis=1) >= IN_PART
    return _level_of(step[there], off[there])


@rows
def _write_steps(first, last, points, chosen, near, spacing, apart, step):
    """Write the distance along the surface to the neighbour that is nearest so, and the step to it, in spacings."""
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
        own_u = own_v = own_off = 0.0
        least, off = math.inf, 0.0
        for a in range(-1, k):
            j = i if a < 0 else near[i, a]
            x, y, z = points[j, 0] - cx, points[j, 1] - cy, points[j, 2] - cz
            u = (x * e[0] + y * e[1] + z * e[2]) * scale
            v = (x * e[3] + y * e[4] + z * e[5]) * scale
            above = over_quadric(right, u, v, x * nx + y * ny + z * nz)
            if a < 0:
                own_u, own_v, own_off = u, v, above
                continue
            square = (u - own_u) * (u - own_u) + (v - own_v) * (v - own_v)
            if square < least:
                least, off = square, above - own_off
        apart[row] = math.sqrt(least) / (scale * spacing[i])
        step[row] = abs(off) / spacing[i]
