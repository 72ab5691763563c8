"""Sheets: hits of a line on a cloud's overlapping fans, merged to one event for each passage through the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats
from surfel.core.crossings import Crossings
from surfel.core.lines import Lines
from surfel.index.bvh import Hits

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
    """

    share: Floats
    gap: Floats

    def merged(self) -> Crossings:
        """Return one event a sheet: where the shares add up to a whole number of sheets, so many events."""
        total = len(self)
        counts = np.zeros(total, np.int64)
        t, cosine, weight = np.empty(len(self.t)), np.empty(len(self.t)), np.empty(len(self.t))
        with threads_for(4 * total):
            _merge_all(
                total, self.offsets, self.t, self.cosine, self.weight, self.share, self.gap, counts, t, cosine, weight
            )
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
    t, cosine, gap = np.empty(k), np.empty(k), np.empty(k)
    line = np.repeat(np.arange(len(lines)), np.diff(hits.offsets))
    with threads_for(k):
        _bend(
            k, lines.directions, line, hits.t, hits.triangle, hits.bary, vertices, normals, spacing, triangles,
            t, cosine, gap,
        )  # fmt: skip
    share = votes[hits.triangle] / 3.0
    weight = weights[hits.triangle]
    falls = np.flatnonzero(np.diff(t) < 0.0) + 1
    if not np.isin(falls, hits.offsets).all():  # bending has changed the order of some hits
        order = np.lexsort((t, line))
        t, cosine, weight, share, gap = t[order], cosine[order], weight[order], share[order], gap[order]
    return CloudCrossings(hits.offsets, t, cosine, weight, np.zeros(k, np.int32), share, gap)


@rows
def _bend(first, last, directions, line, flat_t, triangle, bary, vertices, normals, spacing, triangles, t, cosine, gap):
    """Move each hit from the flat triangle to the surface through its corners that bends with their normals.

    Over corners a, b, c with weights w the height is ``sum over pairs w_i w_j (p_j - p_i) . (n_j - n_i) / 2``, exact
    on a sphere and on a cylinder to the second order.
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
        h = (spacing[a] + spacing[b] + spacing[c]) / 3.0
        gap[k] = min(GAP * h / max(abs(along), 0.1), 2.0 * h)
        t[k] = flat_t[k]
        if min(abs(side_a), abs(side_b), abs(side_c)) > 0.85 and abs(along) > 1e-3:
            sa = 1.0 if side_a > 0.0 else -1.0
            sb = 1.0 if side_b > 0.0 else -1.0
            sc = 1.0 if side_c > 0.0 else -1.0
            wb, wc = bary[k, 0], bary[k, 1]
            wa = 1.0 - wb - wc
            ab = (
                ux * (sb * normals[b, 0] - sa * normals[a, 0])
                + uy * (sb * normals[b, 1] - sa * normals[a, 1])
                + uz * (sb * normals[b, 2] - sa * normals[a, 2])
            )
            ac = (
                vx * (sc * normals[c, 0] - sa * normals[a, 0])
                + vy * (sc * normals[c, 1] - sa * normals[a, 1])
                + vz * (sc * normals[c, 2] - sa * normals[a, 2])
            )
            bc = (
                (vx - ux) * (sc * normals[c, 0] - sb * normals[b, 0])
                + (vy - uy) * (sc * normals[c, 1] - sb * normals[b, 1])
                + (vz - uz) * (sc * normals[c, 2] - sb * normals[b, 2])
            )
            height = 0.5 * (wa * wb * ab + wa * wc * ac + wb * wc * bc)
            t[k] += max(-h, min(h, height / along))


@rows
def _merge_all(first, last, offsets, t, cosine, weight, share, gap, counts, out_t, out_cosine, out_weight):
    """Walk along each line; gather hits that may be one sheet; give as many events as their shares add up to."""
    for line in range(first, last):
        at = offsets[line]
        i = offsets[line]
        while i < offsets[line + 1]:
            j = i + 1
            total = share[i]
            while (
                j < offsets[line + 1]
                and t[j] - t[j - 1] <= min(gap[j], gap[j - 1])
                and not (share[j] > 0.99 and share[j - 1] > 0.99)
            ):
                total += share[j]
                j += 1
            sheets = int(np.floor(total + 0.5))
            if sheets > 0:
                # event e takes the hits whose middle lies in its unit of the shares, and their mean place
                passed = 0.0
                q = i
                for e in range(sheets):
                    bound = total * (e + 1) / sheets
                    mass = place = slope = area = 0.0
                    while q < j and (e == sheets - 1 or mass == 0.0 or passed + 0.5 * share[q] <= bound):
                        mass += share[q]
                        place += share[q] * t[q]
                        slope += share[q] * cosine[q]
                        area += weight[q]
                        passed += share[q]
                        q += 1
                    if mass > 0.0:
                        out_t[at], out_cosine[at], out_weight[at] = place / mass, slope / mass, area
                        at += 1
            i = j
        counts[line] = at - offsets[line]
