"""Unfolding over sharp edges: where a neighbour lies when its plane is turned into the plane of the point.

Two tangent planes meet in a line. The shortest way from a point to a neighbour beyond the edge runs straight in the
unfolded planes; the chord through the air is shorter and would take area from both.
"""

from __future__ import annotations

import math

from surfel._numba import kernel


@kernel
def is_flat(points, normals, near, i):
    """Tell whether at least 3 of the 8 nearest neighbours of point i share its plane."""
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    count = 0
    for a in range(min(8, near.shape[1])):
        j = near[i, a]
        x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        w = x * nx + y * ny + z * nz
        c = abs(nx * normals[j, 0] + ny * normals[j, 1] + nz * normals[j, 2])
        if c > 0.97 and w * w <= 0.0225 * (x * x + y * y + z * z):
            count += 1
    return count >= 3


@kernel
def known_flat(points, normals, near, i, flat):
    """Return whether point i lies on a flat piece, looked up in ``flat`` (2 where not known yet) or found and kept.

    Threads may find the same point at once; they write the same.
    """
    if flat[i] == 2:
        flat[i] = 1 if is_flat(points, normals, near, i) else 0
    return flat[i] == 1


@kernel
def in_plane(points, normals, neighbours, row, i, h, x, y, z):
    """Write the offsets of those neighbours of point i that share its plane; return how many there are."""
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    count = 0
    for a in range(neighbours.shape[1]):
        j = neighbours[row, a]
        if abs(nx * normals[j, 0] + ny * normals[j, 1] + nz * normals[j, 2]) < 0.97:
            continue
        dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        if abs(dx * nx + dy * ny + dz * nz) > 0.15 * h:
            continue
        x[count], y[count], z[count] = dx, dy, dz
        count += 1
    return count


@kernel
def far_side(x, y, z, count, h, gx, gy, gz, cx, cy, cz, line, where, proof):
    """Tell on which side of an edge a plane ends: 1 or -1 along g, or 0 if it goes on beyond the edge.

    The edge runs along c at the distance ``line`` along g; asked is at ``where`` along c; x, y, z are the offsets of
    ``count`` points of the plane. Where planes merely cross, as in two squares through each other, points of the plane
    lie on both sides of the line: at least ``proof`` on each.
    """
    before = 1 if line > 0.2 * h else 0
    after = 1 if line < -0.2 * h else 0
    for a in range(count):
        beyond = x[a] * gx + y[a] * gy + z[a] * gz - line
        if abs(beyond) < 1.5 * h and abs(x[a] * cx + y[a] * cy + z[a] * cz - where) < 1.5 * h:
            if beyond > 0.2 * h:
                after += 1
            elif beyond < -0.2 * h:
                before += 1
    if before >= proof and after >= proof:
        return 0
    if abs(line) > 0.05 * h:
        return 1 if line > 0.0 else -1
    if before == after:  # never by the sign of g alone, which is that of a normal
        return 1 if line > 0.0 else -1
    return 1 if before > after else -1


@kernel
def goes_on(points, normals, near, j, h, fx, fy, fz, cx, cy, cz, line, where, proof):
    """Tell whether the plane of point j goes on beyond an edge, which runs along c at the distance ``line`` along f.

    Asked is at ``where`` along c; at least ``proof`` of the neighbours that share the plane lie on each side.
    """
    nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
    before = 1 if line > 0.2 * h else 0
    after = 1 if line < -0.2 * h else 0
    for a in range(near.shape[1]):
        m = near[j, a]
        if abs(nx * normals[m, 0] + ny * normals[m, 1] + nz * normals[m, 2]) < 0.97:
            continue
        dx, dy, dz = points[m, 0] - points[j, 0], points[m, 1] - points[j, 1], points[m, 2] - points[j, 2]
        if abs(dx * nx + dy * ny + dz * nz) > 0.15 * h:
            continue
        beyond = dx * fx + dy * fy + dz * fz - line
        if abs(beyond) < 1.5 * h and abs(dx * cx + dy * cy + dz * cz - where) < 1.5 * h:
            if beyond > 0.2 * h:
                after += 1
            elif beyond < -0.2 * h:
                before += 1
    return before >= proof and after >= proof


@kernel
def over_edge(points, normals, near, flat, i, j, h, px, py, pz, count, proof, through):
    """Unfold neighbour j of point i, whose normals differ, over the line in which their planes meet.

    px, py, pz hold the offsets of ``count`` neighbours that share the plane of i; ``proof`` of them tell that it
    goes on beyond the edge, and ``through`` that the plane of j does (0: that is not asked). Returns (verdict, x, y,
    z): 0 where j is no neighbour on the surface, 1 where it is but not over a flat edge (it is then laid out as on a
    smooth surface), 2 with the unfolded offset from i.
    """
    dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    ax, ay, az = normals[i, 0], normals[i, 1], normals[i, 2]
    bx, by, bz = normals[j, 0], normals[j, 1], normals[j, 2]
    square = dx * dx + dy * dy + dz * dz
    wi = dx * ax + dy * ay + dz * az
    wj = dx * bx + dy * by + dz * bz
    # The edge runs along c = a x b; g and f run across it in the plane of i and of j.
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    sine = 1.0 / math.sqrt(cx * cx + cy * cy + cz * cz)
    cx, cy, cz = cx * sine, cy * sine, cz * sine
    gx, gy, gz = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
    fx, fy, fz = cy * bz - cz * by, cz * bx - cx * bz, cx * by - cy * bx
    to_line = wj / (gx * bx + gy * by + gz * bz)
    from_line = -wi / (fx * ax + fy * ay + fz * az)
    along = dx * cx + dy * cy + dz * cz
    across = abs(to_line) + abs(from_line)
    where = along * abs(to_line) / across if across > 0.0 else along
    side = far_side(px, py, pz, count, h, gx, gy, gz, cx, cy, cz, to_line, where, proof)
    if side == 0:
        return 0, 0.0, 0.0, 0.0
    if through > 0 and goes_on(
        points, normals, near, j, h, fx, fy, fz, cx, cy, cz, from_line, where - along, through
    ):  # at an edge both planes end; where one goes on, planes cross, or one stands on the other
        return 0, 0.0, 0.0, 0.0
    if not (known_flat(points, normals, near, i, flat) and known_flat(points, normals, near, j, flat)):
        return 1, 0.0, 0.0, 0.0
    turn = (gx * fx + gy * fy + gz * fz) * (-1.0 if to_line * from_line > 0.0 else 1.0)
    if turn < -0.5 or across * across + along * along > 4.4 * square:
        return 0, 0.0, 0.0, 0.0
    across *= side
    return 2, across * gx + along * cx, across * gy + along * cy, across * gz + along * cz
