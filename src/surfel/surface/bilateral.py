"""Bilateral filtering of points: noise along the normals goes, edges stay.

Jones, Durand and Desbrun, *Non-iterative, feature-preserving mesh smoothing*, SIGGRAPH 2003, and Jones, Durand and
Zwicker, *Normal improvement for point rendering*, IEEE CG&A 24, 2004, which Liu et al. (2006, section 5.2) name. Every
neighbour predicts a point's place by the point's projection onto the neighbour's tangent plane; predictions count by
how near the neighbour is (f), and by how little they move the point (g)::

    p' = sum_j f(|p - p_j|) g(h_j) (p - h_j n_j) / sum_j f g,     h_j = (p - p_j) . n_j

The tangent planes are mollified first, by f of half the width. Only n n^T occurs: the signs of normals do not matter.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats
from surfel.index.neighbours import PointIndex

NEIGHBOURS = 40
WIDTH = 2.0
"""Standard deviation of f, in mean distances to the nearest neighbour."""

INFLUENCE = 2.0
"""Standard deviation of g, in those of the heights of the neighbours."""


class Filtered(NamedTuple):
    """Points and unit normals after filtering, in the order of the input, and how far each point was moved."""

    points: Floats
    normals: Floats
    moved: Floats


def bilateral(points: Floats, normals: Floats, passes: int = 1) -> Filtered:
    """Filter points and their normals.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        At least two.
    normals : Floats, shape (n, 3)
        Unit normals, of either sign.
    passes : int
        How often; the widths are taken from the points before each pass.

    Returns
    -------
    Filtered
        Normals keep the signs of the given ones.
    """
    place, side = points, normals
    for _ in range(passes):
        place, side = _once(place, side)
    return Filtered(place, side, np.sqrt(np.square(place - points).sum(axis=1)))


def _once(points: Floats, normals: Floats) -> tuple[Floats, Floats]:
    index = PointIndex(points)
    n = len(points)
    squared, near = index.knn(min(NEIGHBOURS, n - 1))
    local, given = np.array(index.points), normals[index.order]
    width = WIDTH * float(np.sqrt(squared[:, 0]).mean())
    if not width > 0.0:
        return points, normals
    smooth, heights = np.empty_like(given), np.empty(n)
    with threads_for(8 * n):
        _mollify(n, local, given, squared, near, 0.5 * width, smooth, heights)
        influence = INFLUENCE * math.sqrt(float(np.median(heights)))
        moved, turned = np.empty_like(local), np.empty_like(given)
        _filter(n, local, smooth, squared, near, width, max(influence, 1e-9 * width), moved, turned)
    back = _inverse(index.order)
    return np.asarray(moved[back] + index.origin), np.asarray(turned[back])


def _inverse(order: NDArray[np.int32]) -> NDArray[np.int64]:
    back = np.empty(len(order), np.int64)
    back[order] = np.arange(len(order))
    return back


@rows
def _mollify(first, last, points, normals, squared, near, width, smooth, heights):
    """Write the mean normal of each neighbourhood, and the mean squared height of the neighbours over its plane."""
    scale = -0.5 / (width * width)
    for i in range(first, last):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        sx, sy, sz = nx, ny, nz
        for k in range(near.shape[1]):
            j = near[i, k]
            f = math.exp(scale * squared[i, k])
            if nx * normals[j, 0] + ny * normals[j, 1] + nz * normals[j, 2] < 0.0:
                f = -f
            sx += f * normals[j, 0]
            sy += f * normals[j, 1]
            sz += f * normals[j, 2]
        length = math.sqrt(sx * sx + sy * sy + sz * sz)
        if length > 0.0:
            sx, sy, sz = sx / length, sy / length, sz / length
        smooth[i, 0], smooth[i, 1], smooth[i, 2] = sx, sy, sz
        total, square = 0.0, 0.0
        for k in range(near.shape[1]):
            j = near[i, k]
            f = math.exp(scale * squared[i, k])
            h = (points[i, 0] - points[j, 0]) * sx + (points[i, 1] - points[j, 1]) * sy
            h += (points[i, 2] - points[j, 2]) * sz
            total += f
            square += f * h * h
        heights[i] = square / total if total > 0.0 else 0.0


@rows
def _filter(first, last, points, normals, squared, near, width, influence, moved, turned):
    """Write the mean of the predictions for each point, and that of the normals with the same weights."""
    far, high = -0.5 / (width * width), -0.5 / (influence * influence)
    for i in range(first, last):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        total, px, py, pz = 1.0, 0.0, 0.0, 0.0
        sx, sy, sz = nx, ny, nz
        for k in range(near.shape[1]):
            j = near[i, k]
            ax, ay, az = normals[j, 0], normals[j, 1], normals[j, 2]
            h = (
                (points[i, 0] - points[j, 0]) * ax
                + (points[i, 1] - points[j, 1]) * ay
                + (points[i, 2] - points[j, 2]) * az
            )
            weight = math.exp(far * squared[i, k] + high * h * h)
            total += weight
            px -= weight * h * ax
            py -= weight * h * ay
            pz -= weight * h * az
            if nx * ax + ny * ay + nz * az < 0.0:
                weight = -weight
            sx += weight * ax
            sy += weight * ay
            sz += weight * az
        moved[i, 0] = points[i, 0] + px / total
        moved[i, 1] = points[i, 1] + py / total
        moved[i, 2] = points[i, 2] + pz / total
        length = math.sqrt(sx * sx + sy * sy + sz * sz)
        if length > 0.0:
            turned[i, 0], turned[i, 1], turned[i, 2] = sx / length, sy / length, sz / length
        else:
            turned[i, 0], turned[i, 1], turned[i, 2] = nx, ny, nz
