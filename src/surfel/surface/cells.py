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

REACH_RANDOM, REACH_REGULAR = 2.5, 2.1
"""Largest circumradius, in spacings, of a triangle that still belongs to the surface, where points lie at random and
where they lie in good order: a gap that is common among random points is a hole among regular ones."""

SHIFT_NEAR, SHIFT_FAR = 0.02, 0.12
"""How far, in spacings, an open point is moved inward when it is asked whether the others cover its place."""

_EDGES = 40  # most edges of a cell while it is clipped
_CHUNK = 128


def reach_of(order: float) -> float:
    """Return the largest circumradius for points of a given regularity (0.5 random, 0.8 blue noise, 1 a grid)."""
    return float(np.interp(order, [0.6, 0.75], [REACH_RANDOM, REACH_REGULAR]))


class Cells(NamedTuple):
    """What is known of each point's cell; all arrays have one row for each point.

    ``area``: the part of the cell in triangles within reach. ``closed``: 1 where the cell is bounded by neighbours all
    round. ``uncovered``: bit 0 (near shift) and bit 1 (far shift) are set where an open point's place would not be
    covered without it. ``rough``: mean square roughness over the star. ``curved``: relative correction for anisotropic
    curvature. ``secure``: 1 where farther neighbours cannot change the cell. ``star``: the neighbours round the cell in
    order, padded with -1, without columns where not asked for; bit c of ``joined`` is set where the point, neighbour c
    and the next one make a triangle of the surface.
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
    flat: NDArray[np.uint8],
    spacing: Floats,
    chosen: NDArray[np.int32],
    neighbours: NDArray[np.int32],
    reach: float,
    proof: int,
    *,
    final: bool,
) -> None:
    """Clip the cells of the chosen points and write them into ``cells``.

    Parameters
    ----------
    cells : Cells
        Written at ``chosen``.
    points, normals : Floats, shape (n, 3)
        Coordinates and unit normals of either sign.
    flat : NDArray[np.uint8], shape (n,)
        1 where the surface round the point is flat: only there an edge is unfolded.
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
    final : bool
        Settle what these neighbours can tell, though farther ones might change an insecure cell.
    """
    with threads_for(len(chosen)):
        chunks = (len(chosen) + _CHUNK - 1) // _CHUNK
        _clip_all(chunks, points, normals, flat, spacing, chosen, neighbours, reach, proof, final, *cells)


def flat_points(points: Floats, normals: Floats, neighbours: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Return 1 where at least 3 of the 8 nearest neighbours share the point's plane."""
    flags = np.zeros(len(points), np.uint8)
    with threads_for(len(points)):
        _flat(len(points), points, normals, neighbours, min(8, neighbours.shape[1]), flags)
    return flags


@rows
def _flat(first, last, points, normals, neighbours, k, flags):
    for i in range(first, last):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        count = 0
        for a in range(k):
            j = neighbours[i, a]
            x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            w = abs(x * nx + y * ny + z * nz)
            c = abs(nx * normals[j, 0] + ny * normals[j, 1] + nz * normals[j, 2])
            if c > 0.97 and w * w <= 0.0225 * (x * x + y * y + z * z):
                count += 1
        flags[i] = 1 if count >= 3 else 0


@kernel
def far_side(points, normals, neighbours, row, k, i, h, gx, gy, gz, cx, cy, cz, line, where, proof):
    """Tell on which side of an edge the plane of point i ends: 1 or -1 along g, or 0 if it goes on beyond the edge.

    The edge runs along c at the distance ``line`` along g; asked is at ``where`` along c. Where planes merely cross,
    as in two squares through each other, points of the plane lie on both sides of the line: at least ``proof`` on each.
    """
    before = 1 if line > 0.2 * h else 0
    after = 1 if line < -0.2 * h else 0
    for a in range(k):
        j = neighbours[row, a]
        cosine = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
        if abs(cosine) < 0.97:
            continue
        dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        if abs(dx * normals[i, 0] + dy * normals[i, 1] + dz * normals[i, 2]) > 0.15 * h:
            continue
        beyond = dx * gx + dy * gy + dz * gz - line
        if abs(dx * cx + dy * cy + dz * cz - where) < 1.5 * h and abs(beyond) < 1.5 * h:
            if beyond > 0.2 * h:
                after += 1
            elif beyond < -0.2 * h:
                before += 1
    if before >= proof and after >= proof:
        return 0
    if abs(line) > 0.05 * h or before == after:  # never by the sign of g alone, which is that of a normal
        return 1 if line > 0.0 else -1
    return 1 if before > after else -1


@kernel
def lay_out(points, normals, flat, neighbours, row, k, i, j, h, e, proof):
    """Lay neighbour j into the tangent plane of point i.

    ``e`` holds the tangent frame. Returns (accepted, u, v, roughness, tilt); tilt is -9 where j was unfolded over an
    edge.
    """
    dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    square = dx * dx + dy * dy + dz * dz
    if square <= 0.0:
        return False, 0.0, 0.0, 0.0, 0.0
    length = math.sqrt(square)
    ax, ay, az = normals[i, 0], normals[i, 1], normals[i, 2]
    bx, by, bz = normals[j, 0], normals[j, 1], normals[j, 2]
    wi = dx * ax + dy * ay + dz * az
    wj = dx * bx + dy * by + dz * bz
    cosine = ax * bx + ay * by + az * bz
    sign = 1.0 if cosine >= 0.0 else -1.0
    cosine = abs(cosine)
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    if abs(wi) + abs(wj) > (0.6 + 1.2 * sine) * length:
        return False, 0.0, 0.0, 0.0, 0.0
    if cosine < 0.8:
        # The planes meet in a line along c = a x b; g and f run across it in the plane of i and of j.
        cx, cy, cz = (ay * bz - az * by) / sine, (az * bx - ax * bz) / sine, (ax * by - ay * bx) / sine
        gx, gy, gz = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
        fx, fy, fz = cy * bz - cz * by, cz * bx - cx * bz, cx * by - cy * bx
        to_line = wj / (gx * bx + gy * by + gz * bz)
        from_line = -wi / (fx * ax + fy * ay + fz * az)
        along = dx * cx + dy * cy + dz * cz
        across = abs(to_line) + abs(from_line)
        where = along * abs(to_line) / across if across > 0.0 else along
        side = far_side(points, normals, neighbours, row, k, i, h, gx, gy, gz, cx, cy, cz, to_line, where, proof)
        if side == 0:
            return False, 0.0, 0.0, 0.0, 0.0
        if flat[i] == 1 and flat[j] == 1:
            turn = (gx * fx + gy * fy + gz * fz) * (-1.0 if to_line * from_line > 0.0 else 1.0)
            if turn < -0.5 or across * across + along * along > 4.4 * square:
                return False, 0.0, 0.0, 0.0, 0.0
            across *= side
            x, y, z = across * gx + along * cx, across * gy + along * cy, across * gz + along * cz
            return True, x * e[0] + y * e[1] + z * e[2], x * e[3] + y * e[4] + z * e[5], 0.0, -9.0
    u = dx * e[0] + dy * e[1] + dz * e[2]
    v = dx * e[3] + dy * e[4] + dz * e[5]
    t = math.sqrt(u * u + v * v)
    if t < 0.05 * length:
        return False, 0.0, 0.0, 0.0, 0.0
    scale = length / t
    slope = (wi + sign * wj) / length
    slope *= slope
    return True, u * scale, v * scale, 0.5 * slope / (1.0 + 10.0 * slope), (sign * wj - wi) / length


@rows
def _clip_all(
    begin,
    end,
    points,
    normals,
    flat,
    spacing,
    chosen,
    neighbours,
    reach,
    proof,
    final,
    area,
    closed,
    uncovered,
    rough,
    curved,
    secure,
    star,
    joined,
):
    m, k = neighbours.shape
    for chunk in range(begin, end):
        u, v = np.empty(k), np.empty(k)
        roughness, tilt, who = np.empty(k), np.empty(k), np.empty(k, np.int32)
        px, py, edge = np.empty(_EDGES + 8), np.empty(_EDGES + 8), np.empty(_EDGES + 8, np.int32)
        qx, qy, other = np.empty(_EDGES + 8), np.empty(_EDGES + 8), np.empty(_EDGES + 8, np.int32)
        for row in range(chunk * _CHUNK, min(m, chunk * _CHUNK + _CHUNK)):
            i = chosen[row]
            h = spacing[i]
            e = tangent_frame(normals[i, 0], normals[i, 1], normals[i, 2])
            half = 1.5 * reach * h
            corners = 4
            px[0], py[0], px[1], py[1] = -half, -half, half, -half
            px[2], py[2], px[3], py[3] = half, half, -half, half
            edge[0] = edge[1] = edge[2] = edge[3] = -1
            reach2 = 2.0 * half * half
            accepted = 0
            last2 = 0.0
            settled = False
            for a in range(k):
                j = neighbours[row, a]
                x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
                last2 = x * x + y * y + z * z
                if last2 > 4.0 * reach2:
                    settled = True
                    break
                ok, uu, vv, rr, tt = lay_out(points, normals, flat, neighbours, row, k, i, j, h, e, proof)
                if not ok:
                    continue
                u[accepted], v[accepted], roughness[accepted], tilt[accepted], who[accepted] = uu, vv, rr, tt, j
                accepted += 1
                q = 0.5 * (uu * uu + vv * vv)
                if 2.0 * q > 4.0 * reach2:
                    continue
                count = _cut(px, py, edge, np.int64(corners), qx, qy, other, uu, vv, q, accepted - 1)
                if count >= 3:
                    corners = count
                    reach2 = 0.0
                    for c in range(count):
                        px[c], py[c], edge[c] = qx[c], qy[c], other[c]
                        reach2 = max(reach2, qx[c] * qx[c] + qy[c] * qy[c])
            secure[i] = 1 if settled or last2 > 4.0 * reach2 else 0
            if accepted < 3:
                area[i] = rough[i] = curved[i] = 0.0
                closed[i] = 0
                joined[i] = 0
                uncovered[i] = 3
                continue
            cap2 = (reach * h) * (reach * h)
            is_closed = reach2 <= cap2
            total = 0.0
            sum_rough = sum_t = sum_t2 = 0.0
            sides = held = tilts = bits = 0
            for c in range(corners):
                first = edge[c]
                if first < 0:
                    is_closed = False
                    continue
                sides += 1
                d = c + 1 if c + 1 < corners else 0
                second = edge[d]
                if min(px[c] * px[c] + py[c] * py[c], px[d] * px[d] + py[d] * py[d]) <= cap2:
                    # sides farther off depend on how the square that was clipped happens to be turned
                    sum_rough += roughness[first]
                    held += 1
                    if tilt[first] > -5.0:
                        sum_t += tilt[first]
                        sum_t2 += tilt[first] * tilt[first]
                        tilts += 1
                inside = False
                if second >= 0 and px[d] * px[d] + py[d] * py[d] <= cap2:
                    turn = u[first] * v[second] - v[first] * u[second]
                    if turn > 1e-9 * h * h:
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
            uncovered[i] = 0
            if not is_closed and (final or secure[i] == 1):
                uncovered[i] = _uncovered(u, v, np.int64(accepted), h, cap2)


@kernel
def _cut(px, py, edge, corners, qx, qy, other, u, v, q, label):
    """Clip a convex polygon by the half-plane p . (u, v) <= q; return the corners left, or 0 if nothing was cut."""
    deepest = -1.0
    for c in range(corners):
        deepest = max(deepest, px[c] * u + py[c] * v - q)
    if deepest <= 0.0:
        return 0
    count = 0
    for c in range(corners):
        d = c + 1 if c + 1 < corners else 0
        s = px[c] * u + py[c] * v - q
        t = px[d] * u + py[d] * v - q
        if s <= 0.0:
            qx[count], qy[count], other[count] = px[c], py[c], edge[c]
            count += 1
        if (s <= 0.0) != (t <= 0.0):
            f = s / (s - t)
            qx[count], qy[count] = px[c] + f * (px[d] - px[c]), py[c] + f * (py[d] - py[c])
            other[count] = label if s <= 0.0 else edge[c]
            count += 1
        if count > _EDGES:
            return 0
    return count


@kernel
def _uncovered(u, v, accepted, h, cap2):
    """Return bit 0 and bit 1: is the place of an open point, moved inward a little or more, covered by the others?"""
    su = sv = 0.0
    for a in range(min(accepted, 12)):
        su += u[a]
        sv += v[a]
    length = math.sqrt(su * su + sv * sv) + 1e-30 * h
    flags = 0
    if not is_covered(u, v, accepted, su / length * SHIFT_NEAR * h, sv / length * SHIFT_NEAR * h, cap2):
        flags |= 1
    if not is_covered(u, v, accepted, su / length * SHIFT_FAR * h, sv / length * SHIFT_FAR * h, cap2):
        flags |= 2
    return flags
