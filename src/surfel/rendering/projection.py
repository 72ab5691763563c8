"""Projection: a disk as the camera sees it, and where a line of sight cuts its plane."""

from __future__ import annotations

import math

import numpy as np

from surfel._numba import inlined
from surfel.rendering.disks import CLIPPED, ELLIPTIC
from surfel.rendering.eights import pick
from surfel.rendering.placing import PIXEL

_PIXELS = np.float32(1.0) / (PIXEL * PIXEL)
_ZERO, _HALF, _ONE, _TWO, _THREE = (np.float32(v) for v in (0.0, 0.5, 1.0, 2.0, 3.0))


@inlined
def depth_of(i, m, points, motions):
    """Return the depth of a surfel's centre."""
    return (
        motions[m, 2, 0] * points[0, i]
        + motions[m, 2, 1] * points[1, i]
        + motions[m, 2, 2] * points[2, i]
        + (motions[m, 2, 3])
    )


@inlined
def turned(m, a, b, c, motions):
    """Return a direction of a cloud's own frame in the camera's."""
    return (
        motions[m, 0, 0] * a + motions[m, 0, 1] * b + motions[m, 0, 2] * c,
        motions[m, 1, 0] * a + motions[m, 1, 1] * b + motions[m, 1, 2] * c,
        motions[m, 2, 0] * a + motions[m, 2, 1] * b + motions[m, 2, 2] * c,
    )


@inlined
def normal_of(i, m, normals, motions):
    """Return the normal of a surfel in the camera's frame."""
    return turned(m, normals[0, i], normals[1, i], normals[2, i], motions)


@inlined
def projected(i, m, ez, nx, ny, nz, points, motions, slope, middle, size, cx, cy):
    """Return where a surfel falls in the picture, the size of a pixel there, and how squarely it is seen."""
    x, y, z = points[0, i], points[1, i], points[2, i]
    ex = motions[m, 0, 0] * x + motions[m, 0, 1] * y + motions[m, 0, 2] * z + motions[m, 0, 3]
    ey = motions[m, 1, 0] * x + motions[m, 1, 1] * y + motions[m, 1, 2] * z + motions[m, 1, 3]
    pixel = (middle + ez) * slope if slope > _ZERO else size
    over = _ONE / pixel
    ax, ay = ex * over, ey * over
    tx, ty = ax * slope, ay * slope
    cosine = abs(nx * tx + ny * ty + nz) / math.sqrt(_ONE + tx * tx + ty * ty)
    return cx + ax, cy + ay, pixel, cosine


@inlined
def fragment(x, y, sx, sy, pixel, ez, nx, ny, nz, inverse, bend, slope, cx, cy):
    """Cut the line of sight through a place of the picture, or those through eight, with the plane of a disk.

    Returns the square of the distance from the disk's centre over that of its radius, the depth, and where the plane
    is cut, seen from the centre (for ellipses and clips). Depths are taken from the centre's own, so that no digits
    are lost in far cameras. Near a silhouette the line may cut the plane and miss the surface, which bends away: the
    height n . p = -bend |p|^2 / 2 over the line is a quadratic, and where it has no zero the distance is 2.
    """
    ax, ay = (x - sx) * pixel, (y - sy) * pixel
    dx, dy = (x - cx) * slope, (y - cy) * slope
    toward = nx * dx + ny * dy + nz
    s = -(nx * ax + ny * ay) / toward
    qx, qy = ax + s * dx, ay + s * dy
    square = qx * qx + qy * qy + s * s
    u = square * inverse
    if bend > _ZERO:
        along, length = qx * dx + qy * dy + s, dx * dx + dy * dy + _ONE
        turned = toward + bend * along
        missed = turned * turned < bend * bend * (length - toward * toward) * square
        t = -(_HALF * bend) * square / turned
        u = pick(missed, _TWO, (square + t * (along + along + t * length)) * inverse)
    return u, ez + s, qx, qy, s


@inlined
def felt(bend, r, cosine, pixel, slope):
    """Return the bend of a disk; 0 where it is seen so squarely that no line misses the surface under it."""
    return bend if cosine < _THREE * bend * r + _TWO * r * slope / pixel else _ZERO


@inlined
def in_pixels(x, y, sx, sy):
    """Return the square of the distance from a splat's middle, over that of the least circle that it covers."""
    return ((x - sx) * (x - sx) + (y - sy) * (y - sy)) * _PIXELS


@inlined
def shaped(u, qx, qy, qz, i, flags, axes, leaf, clips, planes, motions):
    """Return the distance in an elliptical disk, and 2 where a clip plane takes the place away."""
    m = leaf[i]
    x = motions[m, 0, 0] * qx + motions[m, 1, 0] * qy + motions[m, 2, 0] * qz
    y = motions[m, 0, 1] * qx + motions[m, 1, 1] * qy + motions[m, 2, 1] * qz
    z = motions[m, 0, 2] * qx + motions[m, 1, 2] * qy + motions[m, 2, 2] * qz
    if flags[i] & ELLIPTIC:
        ax, ay, az, bx, by, bz = axes[i, 0], axes[i, 1], axes[i, 2], axes[i, 3], axes[i, 4], axes[i, 5]
        a = (x * ax + y * ay + z * az) * (_ONE / (ax * ax + ay * ay + az * az))
        b = (x * bx + y * by + z * bz) * (_ONE / (bx * bx + by * by + bz * bz))
        u = pick(u < _TWO, a * a + b * b, u)
    if flags[i] & CLIPPED:
        for k in range(clips[i], clips[i + 1]):
            over = planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z - planes[k, 3]
            u = pick(over > _ZERO, _TWO, u)
    return u


@inlined
def height_over(i, x, y, z, cuts, points, leaf, motions):
    """Return how far a place, told in the camera's frame, lies over the plane of a cut; positive where it is kept."""
    m, a, b, c = leaf[i], points[0, i], points[1, i], points[2, i]
    height = cuts[i, 3]
    for k, place in enumerate((x, y, z)):
        away = place - (motions[m, k, 0] * a + motions[m, k, 1] * b + motions[m, k, 2] * c + motions[m, k, 3])
        height += away * (motions[m, k, 0] * cuts[i, 0] + motions[m, k, 1] * cuts[i, 1] + motions[m, k, 2] * cuts[i, 2])
    return height
