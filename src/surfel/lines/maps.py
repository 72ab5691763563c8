"""The maps from a point of the four-dimensional unit cube to a line; :mod:`surfel.lines.models` says why they hold."""

from __future__ import annotations

import math

from surfel._numba import inlined, rows
from surfel._vec import dot, norm, tangent_frame
from surfel.lines.circle import circle


@rows
def fill_tangents(first, last, points, centre, radius, origins, directions):
    """Write a tangent of a concentric sphere for each point."""
    for i in range(first, last):
        foot, along = _tangent(points[i, 0], points[i, 1], points[i, 2], points[i, 3])
        _write(i, foot, along, centre, radius, origins, directions)


@rows
def fill_chords(first, last, points, centre, radius, origins, directions):
    """Write a chord of the sphere for each point."""
    for i in range(first, last):
        foot, along = _chord(points[i, 0], points[i, 1], points[i, 2], points[i, 3])
        _write(i, foot, along, centre, radius, origins, directions)


@rows
def fill_offsets(first, last, points, centre, radius, origins, directions):
    """Write a line of uniform direction and offset for each point."""
    for i in range(first, last):
        foot, along = _offset(points[i, 0], points[i, 1], points[i, 2], points[i, 3])
        _write(i, foot, along, centre, radius, origins, directions)


@rows
def fill_box(first, last, points, centre, axes, half, origins, directions):
    """Write a line through a box for each point."""
    for i in range(first, last):
        foot, along = _entry(points[i, 0], points[i, 1], points[i, 2], points[i, 3], half[0], half[1], half[2])
        for k in range(3):
            origins[i, k] = centre[k] + dot(foot[0], foot[1], foot[2], axes[0, k], axes[1, k], axes[2, k])
            directions[i, k] = dot(along[0], along[1], along[2], axes[0, k], axes[1, k], axes[2, k])


@inlined
def _write(i, foot, along, centre, radius, origins, directions):
    """Store a line that was made for the unit ball."""
    for k in range(3):
        origins[i, k] = centre[k] + radius * foot[k]
        directions[i, k] = along[k]


@inlined
def _tangent(x0, x1, x2, x3):
    """Return the foot r w and the direction cos(psi) e_theta + sin(psi) e_phi of a tangent (Li et al., 3.2)."""
    r = math.sqrt(x0)
    ct = 1.0 - 2.0 * x1
    st = 2.0 * math.sqrt(x1 * (1.0 - x1))
    cp, sp = circle(x2)
    cs, ss = circle(0.5 * x3)
    foot = (r * st * cp, r * st * sp, r * ct)
    return foot, (cs * ct * cp - ss * sp, cs * ct * sp + ss * cp, -cs * st)


@inlined
def _on_sphere(x0, x1):
    """Return the point of the unit sphere of height u = 1 - 2 x0 and longitude 2 pi x1 (Liu et al., equation (5))."""
    s = 2.0 * math.sqrt(x0 * (1.0 - x0))
    c, d = circle(x1)
    return s * c, s * d, 1.0 - 2.0 * x0


@inlined
def _chord(x0, x1, x2, x3):
    """Return the middle and the direction of the chord between two points of the unit sphere (Li et al., 3.1)."""
    ax, ay, az = _on_sphere(x0, x1)
    bx, by, bz = _on_sphere(x2, x3)
    dx, dy, dz = bx - ax, by - ay, bz - az
    length = norm(dx, dy, dz)
    if length < 1e-9:  # below this rounding would choose the direction, and any tangent is as good
        dx, dy, dz, _ex, _ey, _ez = tangent_frame(ax, ay, az)
        length = norm(dx, dy, dz)
    foot = (0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz))
    return foot, (dx / length, dy / length, dz / length)


@inlined
def _in_disk(x0, x1):
    """Return the point of the unit disk of radius sqrt(x0) and longitude 2 pi x1."""
    c, d = circle(x1)
    return math.sqrt(x0) * c, math.sqrt(x0) * d


@inlined
def _offset(x0, x1, x2, x3):
    """Return an offset in the unit disk across a direction of the upper half sphere, where the frame is smooth."""
    s = math.sqrt(1.0 - x0 * x0)
    c, d = circle(x1)
    dx, dy, dz = s * c, s * d, x0
    ux, uy, uz, vx, vy, vz = tangent_frame(dx, dy, dz)
    a, b = _in_disk(x2, x3)
    return (a * ux + b * vx, a * uy + b * vy, a * uz + b * vz), (dx, dy, dz)


@inlined
def _entry(x0, x1, x2, x3, hx, hy, hz):
    """Return the point nearest to the centre and the direction of a line that enters a box, in the box's frame."""
    yz, zx, xy = hy * hz, hz * hx, hx * hy
    place = 2.0 * x0 * (yz + zx + xy)  # two faces of each kind
    a, b = _in_disk(x2, x3)
    c = math.sqrt(1.0 - x2)
    if place < 2.0 * yz or zx + xy == 0.0:
        side, u = _side(place, yz)
        px, py, pz = -side * hx, u * hy, (2.0 * x1 - 1.0) * hz
        dx, dy, dz = side * c, a, b
    elif place < 2.0 * (yz + zx) or xy == 0.0:
        side, u = _side(place - 2.0 * yz, zx)
        px, py, pz = (2.0 * x1 - 1.0) * hx, -side * hy, u * hz
        dx, dy, dz = b, side * c, a
    else:
        side, u = _side(place - 2.0 * (yz + zx), xy)
        px, py, pz = u * hx, (2.0 * x1 - 1.0) * hy, -side * hz
        dx, dy, dz = a, b, side * c
    back = dot(px, py, pz, dx, dy, dz)
    return (px - back * dx, py - back * dy, pz - back * dz), (dx, dy, dz)


@inlined
def _side(place, area):
    """Return which of two equal faces ``place`` lies in, as the sign of the way inward, and a coordinate in -1 .. 1."""
    share = place / area
    if share < 1.0:
        return 1.0, 2.0 * share - 1.0
    return -1.0, min(2.0 * share - 3.0, 1.0)
