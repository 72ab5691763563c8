"""Cells of surfels near a cut: what part of the surface each stands for, as a polygon in its tangent plane."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, kernel, rows, threads_for
from surfel._vec import dot, norm, tangent_frame
from surfel.core.cast import Floats
from surfel.inside.operand import Operand

NEIGHBOURS = 20
CORNERS = 16
"""Most corners of a cell."""

_ALIKE = 0.5  # neighbours whose normals make a smaller cosine lie on another sheet
_WIDEST = 1.5  # half the side of the box that a cell is cut out of, in spacings
_BEYOND = 4.0 * (1.0 + 1e-9)  # squared distances to neighbours, over those of corners, from which on none cuts

EDGES = 2
"""Most sharp edges of its own surface that a cell ends at."""

_SHARP = 0.8  # neighbours whose normals make a smaller cosine lie beyond a sharp edge


class Cells(NamedTuple):
    """What part of the surface each of m surfels stands for, as a polygon in its tangent plane.

    Parameters
    ----------
    corners : Floats, shape (m, CORNERS, 2)
        In the frame of :func:`surfel._vec.tangent_frame`, counterclockwise.
    counts : NDArray[np.int64], shape (m,)
        How many there are.
    edges : Floats, shape (m, EDGES, 3)
        Lines ``a u + b v = d`` where the surface itself ends, in a sharp edge; d is infinite where there is none.
    """

    corners: Floats
    counts: NDArray[np.int64]
    edges: Floats


def cells_of(operand: Operand, chosen: NDArray[np.int64], boxes: Floats | None = None) -> Cells:
    """Return the tangent Voronoi cells of some surfels, which end at sharp edges.

    Neighbours are laid into the tangent plane without shortening the way to them, so that cells tile a bent surface.

    Parameters
    ----------
    operand : Operand
        The cloud.
    chosen : NDArray[np.int64], shape (m,)
        Sorted rows.
    boxes : Floats, shape (m, 2, 2), optional
        Half axes of boxes in the tangent planes, 1.5 times as large as which no cell becomes; by default squares of
        the local spacing.
    """
    m = len(chosen)
    found = Cells(np.zeros((m, CORNERS, 2)), np.zeros(m, np.int64), np.zeros((m, EDGES, 3)))
    k = min(NEIGHBOURS, len(operand) - 1)
    if not m:
        return found
    near = operand.index.knn(k, chosen)[1] if k > 0 else np.empty((m, 0), np.int32)
    if boxes is None:
        boxes = np.maximum(operand.spacings[chosen], 1e-300)[:, None, None] * np.eye(2)
    half = _WIDEST * boxes
    with threads_for(16 * m):
        _cut_out(m, operand.points, operand.normals, np.asarray(chosen, np.int64), near, half, *found)
    return found


def frames_of(normals: Floats) -> tuple[Floats, Floats]:
    """Return the two vectors that span the tangent planes, the same as the kernels take."""
    across, along = np.empty_like(normals), np.empty_like(normals)
    _frames(np.ascontiguousarray(normals), across, along)
    return across, along


@kernel
def _frames(normals, across, along):
    for i in range(len(normals)):
        e = tangent_frame(normals[i, 0], normals[i, 1], normals[i, 2])
        across[i, 0], across[i, 1], across[i, 2] = e[0], e[1], e[2]
        along[i, 0], along[i, 1], along[i, 2] = e[3], e[4], e[5]


@rows
def _cut_out(first, last, points, normals, chosen, near, half, corners, counts, edges):
    px, py = np.empty(CORNERS + 2), np.empty(CORNERS + 2)
    qx, qy = np.empty(CORNERS + 2), np.empty(CORNERS + 2)
    for row in range(first, last):
        i = chosen[row]
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        ex, ey, ez, fx, fy, fz = tangent_frame(nx, ny, nz)
        ax, ay, bx, by = half[row, 0, 0], half[row, 0, 1], half[row, 1, 0], half[row, 1, 1]
        if ax * by < ay * bx:
            bx, by = -bx, -by
        px[0], py[0], px[1], py[1] = -ax - bx, -ay - by, ax - bx, ay - by
        px[2], py[2], px[3], py[3] = ax + bx, ay + by, bx - ax, by - ay
        count = 4
        widest = _square_of_farthest(px, py, count)
        for a in range(near.shape[1]):
            j = near[row, a]
            if dot(nx, ny, nz, normals[j, 0], normals[j, 1], normals[j, 2]) < _ALIKE:
                continue
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            u, v = dot(dx, dy, dz, ex, ey, ez), dot(dx, dy, dz, fx, fy, fz)
            flat, square = u * u + v * v, dx * dx + dy * dy + dz * dz
            if square > _BEYOND * widest:
                break  # half the way to it, and to all after it, lies beyond the corners
            if flat <= 0.1 * square or flat <= 0.0:
                continue
            scale = math.sqrt(square / flat)
            cut = clip_polygon(px, py, np.int64(count), u * scale, v * scale, 0.5 * square, qx, qy)
            if cut < 3 or cut > CORNERS:
                continue
            for c in range(cut):
                px[c], py[c] = qx[c], qy[c]
            count = cut
            widest = _square_of_farthest(px, py, count)
        lead = -1
        for e in range(EDGES):
            lead = _edge(points, normals, near, np.int64(row), np.int64(i), lead, np.int64(e), edges)
            if edges[row, e, 2] == math.inf:
                continue
            a, b, d = edges[row, e, 0], edges[row, e, 1], edges[row, e, 2]
            cut = clip_polygon(px, py, np.int64(count), a, b, d, qx, qy)
            if cut < 3 or cut > CORNERS:
                edges[row, e, 2] = math.inf
                continue
            for c in range(cut):
                px[c], py[c] = qx[c], qy[c]
            count = cut
        for c in range(count):
            corners[row, c, 0], corners[row, c, 1] = px[c], py[c]
        counts[row] = count


@inlined
def _square_of_farthest(px, py, count):
    """Return the squared distance of the farthest corner of a polygon from the place that it is round."""
    widest = 0.0
    for c in range(count):
        widest = max(widest, px[c] * px[c] + py[c] * py[c])
    return widest


@inner
def _edge(points, normals, near, row, i, before, e, edges):
    """Find where the sheet beyond a sharp edge meets the tangent plane of surfel i; return its nearest surfel.

    ``before`` is that of the edge found before, -1 for the first one. The distance over the sheet is that of
    :mod:`surfel.inside.sheets`; what is kept of the plane is the side on which the surfel lies.
    """
    edges[row, e, 2] = math.inf
    if e > 0 and before < 0:
        return before
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    lead = -1
    sx = sy = sz = mx = my = mz = total = heights = width = 0.0
    for a in range(near.shape[1]):
        j = near[row, a]
        bx, by, bz = normals[j, 0], normals[j, 1], normals[j, 2]
        if dot(nx, ny, nz, bx, by, bz) >= _SHARP or (bx == 0.0 and by == 0.0 and bz == 0.0):
            continue
        if before >= 0 and dot(bx, by, bz, normals[before, 0], normals[before, 1], normals[before, 2]) >= _SHARP:
            continue
        dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        square = dx * dx + dy * dy + dz * dz
        if lead < 0:
            lead, width = j, 2.0 * square
        elif dot(bx, by, bz, normals[lead, 0], normals[lead, 1], normals[lead, 2]) < _SHARP:
            continue
        weight = math.exp(-square / width) if width > 0.0 else 1.0
        sx, sy, sz = sx + weight * bx, sy + weight * by, sz + weight * bz
        mx, my, mz = mx + weight * dx, my + weight * dy, mz + weight * dz
        heights -= weight * dot(bx, by, bz, dx, dy, dz)
        total += weight
    if total <= 0.0:
        return -1
    length = norm(sx, sy, sz)
    if length <= 0.0:
        return lead
    sx, sy, sz = sx / length, sy / length, sz / length
    height = 0.5 * (heights - dot(sx, sy, sz, mx, my, mz)) / total
    ex, ey, ez, fx, fy, fz = tangent_frame(nx, ny, nz)
    a, b = dot(sx, sy, sz, ex, ey, ez), dot(sx, sy, sz, fx, fy, fz)
    steep = math.sqrt(a * a + b * b)
    if steep < 0.3:  # back to back: another sheet, no edge
        return lead
    sign = 1.0 if height <= 0.0 else -1.0
    edges[row, e, 0], edges[row, e, 1], edges[row, e, 2] = sign * a / steep, sign * b / steep, abs(height) / steep
    return lead


@kernel
def clip_polygon(px, py, count, a, b, d, qx, qy):
    """Write the part of a convex polygon where ``a u + b v <= d``; return how many corners it has."""
    written = 0
    if count == 0:
        return 0
    x, y = px[count - 1], py[count - 1]
    s = a * x + b * y - d
    for c in range(count):
        u, v = px[c], py[c]
        t = a * u + b * v - d
        if (s <= 0.0) != (t <= 0.0):
            f = s / (s - t)
            qx[written], qy[written] = x + f * (u - x), y + f * (v - y)
            written += 1
        if t <= 0.0:
            qx[written], qy[written] = u, v
            written += 1
        x, y, s = u, v, t
    return written


@kernel
def area_and_middle(px, py, count):
    """Return the area of a polygon and its middle."""
    total = mx = my = 0.0
    for c in range(1, count - 1):
        ax, ay, bx, by = px[c] - px[0], py[c] - py[0], px[c + 1] - px[0], py[c + 1] - py[0]
        piece = 0.5 * (ax * by - ay * bx)
        total += piece
        mx += piece * (ax + bx) / 3.0
        my += piece * (ay + by) / 3.0
    if total <= 0.0:
        return 0.0, 0.0, 0.0
    return total, px[0] + mx / total, py[0] + my / total


def cell_areas(cells: Cells) -> Floats:
    """Return the area of each cell."""
    areas = np.empty(len(cells.counts))
    _areas(cells.corners, cells.counts, areas)
    return areas


@kernel
def _areas(corners, counts, areas):
    for i in range(len(counts)):
        areas[i] = area_and_middle(corners[i, :, 0], corners[i, :, 1], counts[i])[0]
