"""Local cells: the tangent Voronoi cell of each point, unfolded over sharp edges.

The neighbours of a point are laid into its tangent plane without shortening the way to them: over a smooth surface by
scaling the tangent offset to the full distance, over a sharp edge by unfolding the neighbour's plane about the line in
which the two planes meet. The cell is clipped by the bisectors of the neighbours laid out so. Normals are used without
their sign, so that flipping them changes nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel, rows, threads_for
from surfel._vec import tangent_frame
from surfel.core.cast import Floats
from surfel.surface.border import is_covered
from surfel.surface.unfold import in_plane, over_edge

REACH_RANDOM, REACH_REGULAR = 2.5, 2.1
"""Largest circumradius, in spacings, of a triangle that still belongs to the surface, where points lie at random and
where they lie in good order: a gap that is common among random points is a hole among regular ones."""

JUMP, SPARSER = 1.8, 2
"""How many times farther apart the points beyond a jump of density lie, as where one more scan begins; and how many
such neighbours tell it from a stray."""

SHIFT = 0.02
"""How far, in spacings, an open point is moved inward when it is asked whether the others cover its place."""

UNCOVERED = 1
"""The bit of ``uncovered`` that tells that they do not."""

FACET = 4
"""The bit of ``uncovered`` that tells that a point and its nearest neighbour lie exactly in both planes."""

STEPS = 6.0
"""How many standard deviations of the noise a neighbour may lie off both planes together, on top of what bends allow:
close pairs, whom noise sets one above the other, are no sheets of their own."""

_CORNERS = 44  # of a cell, at the most
_ROOM = 2 * (_CORNERS + 1)  # for a cell while it is clipped: whatever rounding does, each corner gives one or two
_CHUNK = 64


def reach_of(order: float) -> float:
    """Return the largest circumradius for points of a given regularity (0.5 random, 0.8 blue noise, 1 a grid)."""
    return float(np.interp(order, [0.6, 0.75], [REACH_RANDOM, REACH_REGULAR]))


class Cells(NamedTuple):
    """What is known of each point's cell; all arrays have one row for each point.

    ``area``: the part of the cell in triangles within reach. ``closed``: 1 where the cell is bounded by neighbours all
    round. ``uncovered``: the bit UNCOVERED is set where an open point's place would not be covered without it; and
    FACET. ``rough``: mean square roughness over the star. ``curved``: relative correction for anisotropic curvature.
    ``secure``: 1 where farther neighbours cannot change the cell. ``star``: the neighbours round the cell in order,
    padded with -1, without columns where not asked for; bit c of ``joined`` is set where the point, neighbour c and the
    next one make a triangle of the surface.
    """

    area: Floats
    closed: NDArray[np.uint8]
    uncovered: NDArray[np.uint8]
    rough: Floats
    curved: Floats
    secure: NDArray[np.uint8]
    star: NDArray[np.int32]
    joined: NDArray[np.int32]

    @classmethod
    def empty(cls, n: int, star: int = 0) -> Cells:
        """Return room for n cells, and for stars of up to ``star`` triangles."""
        flags = np.zeros((3, n), np.uint8)
        values = np.zeros((3, n))
        return cls(
            values[0],
            flags[0],
            flags[1],
            values[1],
            values[2],
            flags[2],
            np.full((n, star), -1, np.int32),
            np.zeros(n, np.int32),
        )


def clip_cells(
    cells: Cells,
    points: Floats,
    normals: Floats,
    near: NDArray[np.int32],
    spacing: Floats,
    chosen: NDArray[np.int32],
    neighbours: NDArray[np.int32],
    reach: float,
    proof: int,
    *,
    final: bool,
    twist: float = 2.0,
    through: int = 0,
    noise: float = 0.0,
) -> None:
    """Clip the cells of the chosen points and write them into ``cells``.

    Parameters
    ----------
    cells : Cells
        Written at ``chosen``.
    points, normals : Floats, shape (n, 3)
        Coordinates and unit normals of either sign.
    near : NDArray[np.int32], shape (n, l)
        Nearest neighbours of every point; the first eight tell whether it lies on a flat piece.
    spacing : Floats, shape (n,)
        Local spacing.
    chosen : NDArray[np.int32], shape (m,)
        Which points.
    neighbours : NDArray[np.int32], shape (m, k)
        Their nearest neighbours, ascending by distance.
    reach : float
        Largest circumradius of a triangle of the surface, in spacings.
    proof : int
        How many points beyond an edge show that the surface goes on there: 1, or 2 where normals are less certain.
    twist : float
        How far, in its distance, a neighbour with like normals may lie off the arc of a circle that both describe.
    through : int
        So many points beyond an edge show that the plane of a neighbour goes on there; 0 where it is not asked.
    final : bool
        Settle what these neighbours can tell, though farther ones might change an insecure cell.
    """
    chunks = (len(chosen) + _CHUNK - 1) // _CHUNK
    flat = np.full(len(points), 2, np.uint8)
    with threads_for(16 * len(chosen)):
        _clip_all(
            chunks,
            points,
            normals,
            near,
            spacing,
            chosen,
            neighbours,
            reach,
            proof,
            final,
            twist,
            through,
            noise,
            flat,
            *cells,
        )


@rows
def _clip_all(
    begin, end, points, normals, near, spacing, chosen, neighbours, reach, proof, final, twist, through, noise, flat,
    area, closed, uncovered, rough, curved, secure, star, joined,
):  # fmt: skip
    m, k = neighbours.shape
    u, v, who = np.empty(k), np.empty(k), np.empty(k, np.int32)
    wi, wj = np.empty(k), np.empty(k)  # heights over the two planes, wj past a smooth bend; NaN over an edge
    ax, ay, az = np.empty(k), np.empty(k), np.empty(k)
    px, py, beyond, edge = np.empty(2 * _ROOM), np.empty(2 * _ROOM), np.empty(2 * _ROOM), np.empty(2 * _ROOM, np.int32)
    for row in range(begin * _CHUNK, min(m, end * _CHUNK)):
        i = chosen[row]
        h = spacing[i]
        slack, spread = STEPS * noise * h, 2.0 * (noise * h) ** 2
        ox, oy, oz = points[i, 0], points[i, 1], points[i, 2]
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        ex, ey, ez, fx, fy, fz = tangent_frame(nx, ny, nz)
        wide = h  # beside a jump of density triangles are as large as the points of the sparser side make them
        if final:
            sparser = 0
            for a in range(k):
                there = spacing[neighbours[row, a]]
                sparser += 1 if there > JUMP * h else 0
                wide = max(wide, there)
            wide = wide if sparser >= SPARSER else h
        half = 1.5 * reach * wide
        base, corners = 0, 4
        px[0], py[0], px[1], py[1] = -half, -half, half, -half
        px[2], py[2], px[3], py[3] = half, half, -half, half
        edge[0] = edge[1] = edge[2] = edge[3] = -1
        reach2 = 2.0 * half * half
        accepted = 0
        plane = -1  # how many neighbours share the plane of i, not known until an edge is met
        square = 0.0
        settled = False
        for a in range(k):
            j = neighbours[row, a]
            dx, dy, dz = points[j, 0] - ox, points[j, 1] - oy, points[j, 2] - oz
            square = dx * dx + dy * dy + dz * dz
            if square > 4.0 * reach2:
                settled = True
                break
            if square <= 0.0:
                continue
            bx, by, bz = normals[j, 0], normals[j, 1], normals[j, 2]
            own = dx * nx + dy * ny + dz * nz
            other = dx * bx + dy * by + dz * bz
            cosine = nx * bx + ny * by + nz * bz
            steep = max(0.0, abs(own) + abs(other) - slack)
            if steep * steep > 0.36 * square:
                limit = 0.6 + 1.2 * math.sqrt(max(0.0, 1.0 - cosine * cosine))
                if steep * steep > limit * limit * square:
                    continue
            if twist < 1.0 and abs(cosine) >= 0.8:
                # Across a fold that is off by less than the sine of its angle; by more where two sheets run together.
                off = max(0.0, abs(own + other if cosine > 0.0 else own - other) - slack)
                if off * off > max(twist * twist, 1.02 * (1.0 - cosine * cosine)) * square:
                    continue
            verdict = 1
            if abs(cosine) < 0.8:
                if plane < 0:
                    plane = in_plane(points, normals, neighbours, row, i, h, ax, ay, az)
                verdict, dx, dy, dz = over_edge(
                    points, normals, near, flat, i, j, h, ax, ay, az, np.int64(plane), proof, through
                )
                if verdict == 0:
                    continue
                if verdict == 1:
                    dx, dy, dz = points[j, 0] - ox, points[j, 1] - oy, points[j, 2] - oz
            uu = dx * ex + dy * ey + dz * ez
            vv = dx * fx + dy * fy + dz * fz
            flat2 = uu * uu + vv * vv
            if verdict == 1:
                if flat2 < 0.0025 * square:
                    continue
                way2 = max(flat2, square - spread)
                scale = math.sqrt(way2 / flat2)
                uu, vv, flat2 = uu * scale, vv * scale, way2
                wi[accepted], wj[accepted] = own, other if cosine >= 0.0 else -other
            else:
                wi[accepted] = wj[accepted] = math.nan
            u[accepted], v[accepted], who[accepted] = uu, vv, j
            accepted += 1
            q = 0.5 * flat2
            if flat2 > 4.0 * reach2:
                continue
            # Clip the convex polygon by the half-plane p . (u, v) <= q. Everything is written and then kept or not:
            # a branch for each corner would be foretold wrongly half of the time.
            crossed, end = 0, base + corners
            for c in range(base, end):
                here = np.uint64(c)
                beyond[here] = px[here] * uu + py[here] * vv - q
                crossed |= 1 if beyond[here] > 0.0 else 0
            if crossed == 0:
                continue
            target = _ROOM - base
            count = target
            px[end], py[end], beyond[end] = px[base], py[base], beyond[base]
            for c in range(base, end):
                here, following, free = np.uint64(c), np.uint64(c + 1), np.uint64(count)
                x, y, s, t, label = px[here], py[here], beyond[here], beyond[following], edge[here]
                px[free], py[free], edge[free] = x, y, label
                count += 1 if s <= 0.0 else 0
                free = np.uint64(count)
                f = s / (s - t)
                px[free], py[free] = x + f * (px[following] - x), y + f * (py[following] - y)
                edge[free] = accepted - 1 if s <= 0.0 else label
                count += 1 if (s <= 0.0) != (t <= 0.0) else 0
            count -= target
            if 3 <= count <= _CORNERS:  # else it is no cell of a surface, and is left as it is
                base, corners = target, count
                reach2 = 0.0
                for c in range(base, base + corners):
                    to_corner2 = px[c] * px[c] + py[c] * py[c]
                    if to_corner2 > reach2:
                        reach2 = to_corner2
        secure[i] = 1 if settled or square > 4.0 * reach2 else 0
        if accepted < 3:
            area[i] = rough[i] = curved[i] = 0.0
            closed[i] = joined[i] = 0
            uncovered[i] = UNCOVERED
            continue
        own2 = cap2 = (reach * h) * (reach * h)
        is_closed = reach2 <= own2 or wide > h
        total = 0.0
        sum_rough = sum_t = sum_t2 = 0.0
        sides = held = tilts = bits = 0
        for c in range(base, base + corners):
            first = edge[c]
            if first < 0:
                is_closed = False
                continue
            sides += 1
            d = c + 1 if c + 1 < base + corners else base
            if wide > h:
                beside = max(spacing[who[first]], spacing[who[edge[d]]] if edge[d] >= 0 else h)
                cap2 = (reach * reach) * (beside * beside if beside > JUMP * h else h * h)
                is_closed = is_closed and px[d] * px[d] + py[d] * py[d] <= cap2
            within = min(px[c] * px[c] + py[c] * py[c], px[d] * px[d] + py[d] * py[d]) <= cap2
            if within:  # sides farther off depend on how the square that was clipped happens to be turned
                held += 1
            if within and not math.isnan(wi[first]):
                inverse2 = 1.0 / (u[first] * u[first] + v[first] * v[first])
                slope = (wi[first] + wj[first]) * (wi[first] + wj[first]) * inverse2
                sum_rough += 0.5 * slope / (1.0 + 10.0 * slope)
                tilt = wj[first] - wi[first]
                sum_t += tilt * math.sqrt(inverse2)
                sum_t2 += tilt * tilt * inverse2
                tilts += 1
            second = edge[d]
            inside = False
            near_corner = second >= 0 and px[d] * px[d] + py[d] * py[d] <= cap2
            if near_corner and u[first] * v[second] - v[first] * u[second] > 1e-9 * h * h:
                inside = True
                total += 0.25 * (u[first] * py[d] - v[first] * px[d] + px[d] * v[second] - py[d] * u[second])
            if sides <= star.shape[1]:
                star[i, sides - 1] = who[first]
                if inside:
                    bits |= 1 << (sides - 1)
        if sides > star.shape[1] > 0:  # the last neighbour kept is not followed by the first
            bits &= (1 << (star.shape[1] - 1)) - 1
        for c in range(sides, star.shape[1]):
            star[i, c] = -1
        joined[i] = bits
        area[i] = total
        closed[i] = 1 if is_closed else 0
        mean_rough = sum_rough / max(held, 1)
        rough[i] = mean_rough
        curved[i] = 0.0
        if tilts >= 4:
            mean = sum_t / tilts
            curved[i] = 0.215 * min(max(0.0, sum_t2 / tilts - mean * mean - 2.0 * mean_rough), 0.1)
        flags = FACET if abs(wi[0]) + abs(wj[0]) <= 1e-6 * h else 0
        if not is_closed and (final or secure[i] == 1):
            flags |= _uncovered(u, v, np.int64(accepted), h, own2)
        uncovered[i] = flags


@kernel
def _uncovered(u, v, accepted, h, cap2):
    """Return UNCOVERED if the others do not cover the place of an open point, moved inward a little; else 0."""
    su = sv = 0.0
    for a in range(min(accepted, 12)):
        su += u[a]
        sv += v[a]
    shift = SHIFT * h / (math.sqrt(su * su + sv * sv) + 1e-30 * h)
    return 0 if is_covered(u, v, accepted, su * shift, sv * shift, cap2) else UNCOVERED
