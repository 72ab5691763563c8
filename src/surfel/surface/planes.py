"""Planes through small neighbourhoods: the scalar kernels that normals, noise and projection share."""

from __future__ import annotations

import math

from surfel._numba import inner, kernel


@kernel
def smallest_eigenpair(xx, xy, xz, yy, yz, zz):
    """Return the smallest eigenvalue of a symmetric 3 x 3 matrix and its unit eigenvector, in closed form.

    The eigenvalue is the trigonometric root of the characteristic polynomial; the eigenvector is the longest cross
    product of two rows of the shifted matrix. Where two eigenvalues agree, any vector of their plane is returned.
    """
    mean = (xx + yy + zz) / 3.0
    ax, ay, az = xx - mean, yy - mean, zz - mean
    spread = math.sqrt((ax * ax + ay * ay + az * az + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0)
    if spread <= 1e-15 * abs(mean) or spread == 0.0:
        return mean, 0.0, 0.0, 1.0
    det = ax * (ay * az - yz * yz) - xy * (xy * az - yz * xz) + xz * (xy * yz - ay * xz)
    r = min(1.0, max(-1.0, 0.5 * det / (spread * spread * spread)))
    low = mean + 2.0 * spread * math.cos(math.acos(r) / 3.0 + 2.0943951023931953)
    ax, ay, az = xx - low, yy - low, zz - low
    ux, uy, uz = xy * yz - xz * ay, xz * xy - ax * yz, ax * ay - xy * xy
    vx, vy, vz = xy * az - xz * yz, xz * xz - ax * az, ax * yz - xy * xz
    wx, wy, wz = ay * az - yz * yz, yz * xz - xy * az, xy * yz - ay * xz
    u2, v2, w2 = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
    if v2 > u2:
        ux, uy, uz, u2 = vx, vy, vz, v2
    if w2 > u2:
        ux, uy, uz, u2 = wx, wy, wz, w2
    if u2 < 1e-24 * spread * spread * spread * spread:
        return _across_the_line(xx, xy, xz, yy, yz, zz, low)
    s = 1.0 / math.sqrt(u2)
    return max(low, 0.0), ux * s, uy * s, uz * s


@inner
def _across_the_line(xx, xy, xz, yy, yz, zz, low):
    """Two small eigenvalues agree (points on a line): return a unit vector across the line."""
    dx, dy, dz = xx - low, xy, xz
    if abs(yy - low) > abs(dx):
        dx, dy, dz = xy, yy - low, yz
    if abs(zz - low) > max(abs(dx), abs(dy)):
        dx, dy, dz = xz, yz, zz - low
    if abs(dx) <= abs(dy) and abs(dx) <= abs(dz):
        ux, uy, uz = 0.0, dz, -dy
    elif abs(dy) <= abs(dz):
        ux, uy, uz = -dz, 0.0, dx
    else:
        ux, uy, uz = dy, -dx, 0.0
    s = 1.0 / math.sqrt(ux * ux + uy * uy + uz * uz + 1e-300)
    return max(low, 0.0), ux * s, uy * s, uz * s


@kernel
def plane_of_neighbours(points, i, neighbours, row, k):
    """Fit a plane to point i and the first k of its neighbours.

    Returns the normal, the root mean square distance off the plane, and the centroid.
    """
    px, py, pz = points[i, 0], points[i, 1], points[i, 2]
    sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
    for a in range(k):
        j = neighbours[row, a]
        x, y, z = points[j, 0] - px, points[j, 1] - py, points[j, 2] - pz
        sx += x
        sy += y
        sz += z
        xx += x * x
        xy += x * y
        xz += x * z
        yy += y * y
        yz += y * z
        zz += z * z
    m = 1.0 / (k + 1)
    low, nx, ny, nz = smallest_eigenpair(
        xx - sx * sx * m, xy - sx * sy * m, xz - sx * sz * m, yy - sy * sy * m, yz - sy * sz * m, zz - sz * sz * m
    )
    return nx, ny, nz, math.sqrt(max(low, 0.0) * m), px + sx * m, py + sy * m, pz + sz * m


@kernel
def solve_spd(matrix, right):
    """Solve a symmetric positive definite system in place by Cholesky; the solution replaces ``right``."""
    size = len(right)
    for i in range(size):
        for j in range(i + 1):
            s = matrix[i, j]
            for q in range(j):
                s -= matrix[i, q] * matrix[j, q]
            if i == j:
                matrix[i, i] = math.sqrt(max(s, 1e-300))
            else:
                matrix[i, j] = s / matrix[j, j]
    for i in range(size):
        s = right[i]
        for q in range(i):
            s -= matrix[i, q] * right[q]
        right[i] = s / matrix[i, i]
    for i in range(size - 1, -1, -1):
        s = right[i]
        for q in range(i + 1, size):
            s -= matrix[q, i] * right[q]
        right[i] = s / matrix[i, i]
