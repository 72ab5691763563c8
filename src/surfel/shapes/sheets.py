"""Sheets: hits of a line on a cloud's overlapping fans, merged to one event for each passage through the surface."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, rows, threads_for
from surfel.core.cast import Floats
from surfel.core.crossings import Crossings
from surfel.core.lines import Lines
from surfel.index.bvh import Hits

ALIKE = 0.7
"""Least cosine between the planes of two hits on one sheet: at an edge a line passes two sheets close together."""

FACING = 0.2
"""Least cosine between a triangle and the normals at its corners for it to be bent: beyond it spans two sheets."""

FARTHEST = 4.0
"""Spacings that a hit is moved along its line at most. Where lines graze, far moves make up for those that miss."""

GAP = 0.5
"""Hits nearer than this share of the spacing, along the line's normal distance, may be one sheet."""


@dataclass(frozen=True, eq=False)
class CloudCrossings(Crossings):
    """Crossings of a cloud, with what is needed to merge them.

    Parameters
    ----------
    share : Floats, shape (k,)
        Share of a sheet that each hit stands for: votes over three.
    gap : Floats, shape (k,)
        How far along the line the next hit of the same sheet may lie.
    normal : Floats, shape (k, 3)
        Unit normal at each hit, of either sign.
    """

    share: Floats
    gap: Floats
    normal: Floats

    def merged(self) -> Crossings:
        """Return one event a sheet: where the shares add up to a whole number of sheets, so many events."""
        total, longest = len(self), int(self.counts.max(initial=0))
        counts = np.zeros(total, np.int64)
        t, cosine, weight = np.empty(len(self.t)), np.empty(len(self.t)), np.empty(len(self.t))
        with threads_for(4 * total):
            _merge_all(
                total, longest, self.offsets, self.t, self.cosine, self.weight, self.share, self.gap, self.normal,
                counts, t, cosine, weight,
            )  # fmt: skip
        offsets = np.concatenate([[0], np.cumsum(counts)])
        starts = self.offsets[:-1]
        keep = np.repeat(starts - offsets[:-1], counts) + np.arange(offsets[-1])
        return Crossings(offsets, t[keep], cosine[keep], weight[keep], np.zeros(len(keep), np.int32))


def crossings_of(
    lines: Lines,
    hits: Hits,
    vertices: Floats,
    normals: Floats,
    spacing: Floats,
    triangles: NDArray[np.int32],
    weights: Floats,
    votes: NDArray[np.int8],
) -> CloudCrossings:
    """Turn hits on flat fans into crossings of the curved surface that their corners' normals describe.

    Parameters
    ----------
    lines : Lines
        The lines.
    hits : Hits
        With barycentric coordinates.
    vertices, normals : Floats, shape (v, 3)
        Corners of the fans and the cloud's normals there; their signs tell in from out.
    spacing : Floats, shape (v,)
        Local spacing.
    triangles, weights, votes : arrays of f rows
        The fans.
    """
    k = len(hits.t)
    t, cosine, gap, normal = np.empty(k), np.empty(k), np.empty(k), np.empty((k, 3))
    line = np.repeat(np.arange(len(lines)), np.diff(hits.offsets))
    with threads_for(k):
        _bend(
            k, lines.directions, line, hits.t, hits.triangle, hits.bary, vertices, normals, spacing, triangles,
            t, cosine, gap, normal,
        )  # fmt: skip
    share = votes[hits.triangle] / 3.0
    weight = weights[hits.triangle]
    falls = np.flatnonzero(np.diff(t) < 0.0) + 1
    if not np.isin(falls, hits.offsets).all():  # bending has changed the order of some hits
        order = np.lexsort((t, line))
        t, cosine, weight, share, gap = t[order], cosine[order], weight[order], share[order], gap[order]
        normal = normal[order]
    return CloudCrossings(hits.offsets, t, cosine, weight, np.zeros(k, np.int32), share, gap, normal)


@rows
def _bend(
    first, last, directions, line, flat_t, triangle, bary, vertices, normals, spacing, triangles, t, cosine, gap, normal
):
    """Move each hit from the flat triangle to the surface through its corners that bends with their normals.

    Over corners a, b, c with weights w the height is the sum of ``w_i w_j rise_ij`` over pairs: exact in the middle of
    arcs, and everywhere to the second order. Over an edge of the solid, which triangles cut off, it gives back most of
    what is missing.
    """
    for k in range(first, last):
        f, which = triangle[k], line[k]
        a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        dx, dy, dz = directions[which, 0], directions[which, 1], directions[which, 2]
        ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
        vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        if length > 0.0:
            nx, ny, nz = nx / length, ny / length, nz / length
        side_a = nx * normals[a, 0] + ny * normals[a, 1] + nz * normals[a, 2]
        side_b = nx * normals[b, 0] + ny * normals[b, 1] + nz * normals[b, 2]
        side_c = nx * normals[c, 0] + ny * normals[c, 1] + nz * normals[c, 2]
        if side_a + side_b + side_c < 0.0:
            nx, ny, nz = -nx, -ny, -nz
            side_a, side_b, side_c = -side_a, -side_b, -side_c
        along = dx * nx + dy * ny + dz * nz
        cosine[k] = along
        normal[k, 0], normal[k, 1], normal[k, 2] = nx, ny, nz
        h = (spacing[a] + spacing[b] + spacing[c]) / 3.0
        gap[k] = min(GAP * h / max(abs(along), 0.1), 2.0 * h)
        t[k] = flat_t[k]
        if min(abs(side_a), abs(side_b), abs(side_c)) > FACING and abs(along) > 1e-3:
            wb, wc = bary[k, 0], bary[k, 1]
            wa = 1.0 - wb - wc
            sa, sb, sc = math.copysign(1.0, side_a), math.copysign(1.0, side_b), math.copysign(1.0, side_c)
            ax, ay, az = sa * normals[a, 0], sa * normals[a, 1], sa * normals[a, 2]
            bx, by, bz = sb * normals[b, 0], sb * normals[b, 1], sb * normals[b, 2]
            cx, cy, cz = sc * normals[c, 0], sc * normals[c, 1], sc * normals[c, 2]
            ab = rise(ux, uy, uz, ax, ay, az, bx, by, bz)
            ac = rise(vx, vy, vz, ax, ay, az, cx, cy, cz)
            bc = rise(vx - ux, vy - uy, vz - uz, bx, by, bz, cx, cy, cz)
            height = wa * wb * ab + wa * wc * ac + wb * wc * bc
            t[k] += max(-FARTHEST * h, min(FARTHEST * h, height / along))


@inlined
def rise(x, y, z, ax, ay, az, bx, by, bz):
    """Return four times how far an arc between two ends stands above its chord, from the chord and the unit normals.

    An arc of the radius r that turns by 2 u rises by ``r (1 - cos u)``; its chord, times the difference of its
    normals, is ``4 r sin(u)^2``.
    """
    half = math.sqrt(max(0.0, 0.5 * (1.0 + ax * bx + ay * by + az * bz)))
    return (x * (bx - ax) + y * (by - ay) + z * (bz - az)) / (1.0 + half)


@inner
def _one_sheet(a, b, cosine, normal):
    """Tell whether hits a and b of a line may lie on one sheet: their planes are alike, and passed the same way."""
    c = normal[a, 0] * normal[b, 0] + normal[a, 1] * normal[b, 1] + normal[a, 2] * normal[b, 2]
    return abs(c) > ALIKE and c * cosine[a] * cosine[b] > 0.0


@rows
def _merge_all(
    first, last, longest, offsets, t, cosine, weight, share, gap, normal, counts, out_t, out_cosine, out_weight
):
    """Walk along each line; gather hits that may be one sheet; give as many events as their shares add up to."""
    taken = np.zeros(longest, np.bool_)
    for line in range(first, last):
        begin, end = offsets[line], offsets[line + 1]
        taken[: end - begin] = False
        at = begin
        for i in range(begin, end):
            if taken[i - begin]:
                continue
            # the hits of one sheet, each within the gap of the one before; a whole one takes no other
            total, mass, place, slope, area = share[i], share[i], share[i] * t[i], share[i] * cosine[i], weight[i]
            back = i
            for j in range(i + 1, end):
                if (total > 0.99 and share[j] > 0.99) or t[j] - t[back] > min(gap[j], gap[back]):
                    break
                if taken[j - begin] or not _one_sheet(back, j, cosine, normal):
                    continue
                taken[j - begin] = True
                total += share[j]
                if total > 1.5:  # the next of several sheets that lie close together
                    out_t[at], out_cosine[at], out_weight[at] = place / mass, slope / mass, area
                    at += 1
                    total, mass, place, slope, area = total - 1.0, 0.0, 0.0, 0.0, 0.0
                mass += share[j]
                place += share[j] * t[j]
                slope += share[j] * cosine[j]
                area += weight[j]
                back = j
            if total >= 0.5:
                out_t[at], out_cosine[at], out_weight[at] = place / mass, slope / mass, area
                at += 1
        counts[line] = at - begin
        for i in range(begin + 1, at):  # sheets that overlap along the line may have come out of order
            j = i
            while j > begin and out_t[j] < out_t[j - 1]:
                out_t[j], out_t[j - 1] = out_t[j - 1], out_t[j]
                out_cosine[j], out_cosine[j - 1] = out_cosine[j - 1], out_cosine[j]
                out_weight[j], out_weight[j - 1] = out_weight[j - 1], out_weight[j]
                j -= 1
