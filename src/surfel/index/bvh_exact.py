"""Which triangles a line hits, decided so that neighbours never disagree.

The corners are sheared along the line into a plane in which the line is the origin (Woop, Benthin and Wald,
*Watertight ray/triangle intersection*, JCGT 2(1), 2013). The sheared corner depends on the corner's coordinates and
the line alone, so that triangles which share a corner share its image, bit for bit. In that plane the sign of each
edge function is found exactly, and where it is zero the origin is moved by (e, e^2) with e infinitely small
(Edelsbrunner and Muecke, *Simulation of simplicity*, ACM TOG 9(1), 1990). All signs are thus those of one mesh and
one point in general position: a closed surface is crossed an even number of times, always.
"""

from __future__ import annotations

from surfel._numba import inlined

_FAR = 8.0  # in sizes of the mesh
_FLUSH = 1e-120  # smaller offsets count as none, so that no product of two underflows
_FILTER = 4.5e-16  # (3 + 16 u) u, u = 2^-53, and some more: Shewchuk's bound for a 2 x 2 determinant
_SPLIT = 134217729.0  # 2^27 + 1


@inlined
def line_frame(origin, direction, scale, middle, size):
    """Return the axes, the shear and the scaled origin of a line, and how far the origin was moved along the main axis.

    The third axis is the direction's largest component. An origin far off the mesh is first moved near it.
    """
    dx, dy, dz = direction
    if abs(dz) >= abs(dx) and abs(dz) >= abs(dy):
        kx, ky, kz = 0, 1, 2
    elif abs(dx) >= abs(dy):
        kx, ky, kz = 1, 2, 0
    else:
        kx, ky, kz = 2, 0, 1
    main = direction[kz]
    sx, sy = direction[kx] / main, direction[ky] / main
    ox, oy, oz = origin[kx] * scale, origin[ky] * scale, origin[kz] * scale
    moved = middle[kz] - oz
    if max(abs(ox - middle[kx]), abs(oy - middle[ky]), abs(moved)) > _FAR * size:
        ox += sx * moved
        oy += sy * moved
        oz = middle[kz]
    else:
        moved = 0.0
    return (kx, ky, kz), (sx, sy), (ox, oy, oz), moved


@inlined
def cross_triangle(vertices, a, b, c, axes, shear, origin):
    """Return whether the line hits, where along the main axis from the origin, and the weights of corners b and c."""
    ax, ay, az = _sheared(vertices, a, axes, shear, origin)
    bx, by, bz = _sheared(vertices, b, axes, shear, origin)
    gx, gy, gz = _sheared(vertices, c, axes, shear, origin)
    of_c, side_c = _edge(ax, ay, bx, by)
    of_a, side_a = _edge(bx, by, gx, gy)
    of_b, side_b = _edge(gx, gy, ax, ay)
    if side_a == 0 or side_a != side_b or side_a != side_c:
        return False, 0.0, 0.0, 0.0
    share = 1.0 / (of_a + of_b + of_c)
    return True, (of_a * az + of_b * bz + of_c * gz) * share, of_b * share, of_c * share


@inlined
def _sheared(vertices, v, axes, shear, origin):
    kx, ky, kz = axes
    z = vertices[v, kz] - origin[2]
    x = (vertices[v, kx] - origin[0]) - shear[0] * z
    y = (vertices[v, ky] - origin[1]) - shear[1] * z
    return x if abs(x) > _FLUSH else 0.0, y if abs(y) > _FLUSH else 0.0, z


@inlined
def _edge(ax, ay, bx, by):
    """Return ax by - bx ay, and on which side of the edge the moved origin lies: -1, 1, or 0 where a = b."""
    p, q = ax * by, bx * ay
    value = p - q
    if abs(value) <= _FILTER * (abs(p) + abs(q)):
        value = _difference(value, _product_error(ax, by, p), _product_error(bx, ay, q))
        if value == 0.0:
            # the edge function of a - (e, e^2) and b - (e, e^2) is e (ay - by) + e^2 (bx - ax)
            first = ay - by
            if first == 0.0:
                first = bx - ax
            return 0.0, (first > 0.0) - (first < 0.0)
    return value, 1 if value > 0.0 else -1


@inlined
def _difference(value, p, q):
    """Return value + (p - q) with the right sign, where value is far above p and q or zero."""
    high = p - q
    part = high - p
    low = (p - (high - part)) - (q + part)
    total = value + high
    part = total - value
    rest = (value - (total - part)) + (high - part)
    return total + (rest + low) if total != 0.0 else low


@inlined
def _product_error(a, b, product):
    """Return a b - fl(a b), exactly (Dekker 1971)."""
    split = _SPLIT * a
    a_high = split - (split - a)
    a_low = a - a_high
    split = _SPLIT * b
    b_high = split - (split - b)
    b_low = b - b_high
    return a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)
