"""The best box about a given axis: one side of it lies along an edge of the convex hull of the points' projection.

Freeman and Shapira, *Determining the minimum-area encasing rectangle for an arbitrary closed curve*, CACM 18(7), 1975,
for the area of a rectangle; here for the surface of a box whose height is given.
"""

from __future__ import annotations

import math

import numpy as np

from surfel._numba import inlined, kernel
from surfel._vec import cross, dot, norm, tangent_frame


@kernel
def turn_about_each(points, starts, surfaces, turned):
    """Write, for each axis, the best surface of a box about it and that box's axes."""
    flat, hull = np.empty((len(points), 2)), np.empty((len(points) + 1, 2))
    for s in range(len(starts)):
        wx, wy, wz = starts[s, 0], starts[s, 1], starts[s, 2]
        ux, uy, uz, vx, vy, vz = tangent_frame(wx, wy, wz)
        low, high = np.inf, -np.inf
        for i in range(len(points)):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            flat[i, 0], flat[i, 1] = dot(x, y, z, ux, uy, uz), dot(x, y, z, vx, vy, vz)
            place = dot(x, y, z, wx, wy, wz)
            low, high = min(low, place), max(high, place)
        surfaces[s], c, d = _best_rectangle(hull, _hull(flat, hull), high - low)
        ax, ay, az = c * ux + d * vx, c * uy + d * vy, c * uz + d * vz
        length = norm(ax, ay, az)
        ax, ay, az = ax / length, ay / length, az / length
        turned[s, 0, 0], turned[s, 0, 1], turned[s, 0, 2] = ax, ay, az
        turned[s, 1, 0], turned[s, 1, 1], turned[s, 1, 2] = cross(wx, wy, wz, ax, ay, az)
        turned[s, 2, 0], turned[s, 2, 1], turned[s, 2, 2] = wx, wy, wz


@inlined
def _hull(flat, hull):
    """Write the convex hull of points of the plane, counter-clockwise (Andrew's chains); return its size."""
    order = np.argsort(flat[:, 0])
    size = 0
    for chain in range(2):
        least = size + 1
        for k in range(len(order)):
            i = order[k] if chain == 0 else order[len(order) - 1 - k]
            while size > least and _left(hull, size, flat[i, 0], flat[i, 1]) <= 0.0:
                size -= 1
            hull[size, 0], hull[size, 1] = flat[i, 0], flat[i, 1]
            size += 1
        size -= 1
    return size


@inlined
def _left(hull, size, x, y):
    """Return how far (x, y) lies to the left of the hull's last edge."""
    ax, ay, bx, by = hull[size - 2, 0], hull[size - 2, 1], hull[size - 1, 0], hull[size - 1, 1]
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax)


@inlined
def _best_rectangle(hull, size, height):
    """Return the least surface of a box of this height around the hull, and the direction of its base."""
    least, c, d = np.inf, 1.0, 0.0
    for k in range(max(size, 1)):
        j = k + 1 if k + 1 < size else 0
        ex, ey = hull[j, 0] - hull[k, 0], hull[j, 1] - hull[k, 1]
        length = math.sqrt(ex * ex + ey * ey)
        if length == 0.0:
            ex, ey, length = 1.0, 0.0, 1.0
        ex, ey = ex / length, ey / length
        low, high, below, above = np.inf, -np.inf, np.inf, -np.inf
        for i in range(max(size, 1)):
            along = hull[i, 0] * ex + hull[i, 1] * ey
            across = hull[i, 1] * ex - hull[i, 0] * ey
            low, high, below, above = min(low, along), max(high, along), min(below, across), max(above, across)
        a, b = high - low, above - below
        surface = 2.0 * (a * b + (a + b) * height)
        if surface < least:
            least, c, d = surface, ex, ey
    return least, c, d
