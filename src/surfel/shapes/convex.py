"""Lines through convex solids: slabs and at most one quadric, in a frame of their own."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner
from surfel.core.cast import Floats
from surfel.roots.quadratic import cross_quadric

QUADRIC = 6
"""The side of a hit on the quadric; 0 to 2 are the low ends of the slabs, 3 to 5 the high ones."""


class ConvexLeaves(NamedTuple):
    """Convex solids by rows; see ``Primitive._convex`` for the form."""

    inverse: Floats  # (n, 3, 4): from the world to the frame of the form
    form: Floats  # (n, 11)
    parts: NDArray[np.uint8]  # (n,): bits 0 to 2: which slabs there are; bit 3: whether there is a quadric
    leaf: NDArray[np.int32]  # (n,): the leaf of the tree


def convex_leaves(rows: list[tuple[Floats, Floats, int]]) -> ConvexLeaves:
    """Pack (inverse, form, leaf) of each convex solid."""
    inverse = np.array([row[0] for row in rows]).reshape(-1, 3, 4)
    form = np.array([row[1] for row in rows]).reshape(-1, 11)
    slabs = np.isfinite(form[:, :3]) | np.isfinite(form[:, 3:6])
    parts = slabs @ np.array([1, 2, 4]) + 8 * form[:, 6:].any(axis=1)
    return ConvexLeaves(inverse, form, parts.astype(np.uint8), np.array([row[2] for row in rows], np.int32))


@inlined
def to_local(inverse, k, x, y, z):
    """Map a point into the frame of solid k."""
    return (
        inverse[k, 0, 0] * x + inverse[k, 0, 1] * y + inverse[k, 0, 2] * z + inverse[k, 0, 3],
        inverse[k, 1, 0] * x + inverse[k, 1, 1] * y + inverse[k, 1, 2] * z + inverse[k, 1, 3],
        inverse[k, 2, 0] * x + inverse[k, 2, 1] * y + inverse[k, 2, 2] * z + inverse[k, 2, 3],
    )


@inlined
def to_local_direction(inverse, k, x, y, z):
    """Map a direction into the frame of solid k."""
    return (
        inverse[k, 0, 0] * x + inverse[k, 0, 1] * y + inverse[k, 0, 2] * z,
        inverse[k, 1, 0] * x + inverse[k, 1, 1] * y + inverse[k, 1, 2] * z,
        inverse[k, 2, 0] * x + inverse[k, 2, 1] * y + inverse[k, 2, 2] * z,
    )


@inlined
def _slab(o, d, low, high, axis, t0, t1, side0, side1):
    """Cut the piece [t0, t1] of a line by low <= o + t d <= high."""
    if d == 0.0:
        if o < low or o > high:
            t1 = -np.inf
        return t0, t1, side0, side1
    inverse = 1.0 / d
    a, b = (low - o) * inverse, (high - o) * inverse
    enter, leave = axis, axis + 3
    if d < 0.0:
        a, b, enter, leave = b, a, axis + 3, axis
    if a > t0:
        t0, side0 = a, enter
    if b < t1:
        t1, side1 = b, leave
    return t0, t1, side0, side1


@inner
def convex_piece(inverse, form, parts, k, ox, oy, oz, dx, dy, dz):
    """Return the piece of a line inside solid k: t and side where it enters, t and side where it leaves.

    It is empty unless the first t is less than the second.
    """
    which = parts[k]
    px, py, pz = to_local(inverse, k, ox, oy, oz)
    ux, uy, uz = to_local_direction(inverse, k, dx, dy, dz)
    t0, t1, side0, side1 = -np.inf, np.inf, QUADRIC, QUADRIC
    if which & 1:
        t0, t1, side0, side1 = _slab(px, ux, form[k, 0], form[k, 3], 0, t0, t1, side0, side1)
    if which & 2:
        t0, t1, side0, side1 = _slab(py, uy, form[k, 1], form[k, 4], 1, t0, t1, side0, side1)
    if which & 4:
        t0, t1, side0, side1 = _slab(pz, uz, form[k, 2], form[k, 5], 2, t0, t1, side0, side1)
    if not (which & 8) or not t0 < t1:
        return t0, t1, side0, side1
    a, b, c, d, e = form[k, 6], form[k, 7], form[k, 8], form[k, 9], form[k, 10]
    count, low, high, square = cross_quadric(a, b, c, d, e, px, py, pz, ux, uy, uz)
    if square > 0.0:
        if count < 2:
            return 0.0, -1.0, side0, side1
        if low > t0:
            t0, side0 = low, QUADRIC
        if high < t1:
            t1, side1 = high, QUADRIC
        return t0, t1, side0, side1
    if count == 0:  # the quadric holds all of the line, or where it is straight along it perhaps none
        free = a * px * px + b * py * py + (c * pz + d) * pz + e
        return (t0, t1, side0, side1) if square < 0.0 or free < 0.0 else (0.0, -1.0, side0, side1)
    if square == 0.0:
        if a * px * ux + b * py * uy + (c * pz + 0.5 * d) * uz > 0.0:
            high = np.inf
        else:
            low = -np.inf
    before, after = min(t1, low), max(t0, high)
    if before - t0 >= t1 - after:  # of the two ends outside the roots a convex solid has one
        return (t0, before, side0, QUADRIC) if low < t1 else (t0, t1, side0, side1)
    return (after, t1, QUADRIC, side1) if high > t0 else (t0, t1, side0, side1)


@inner
def convex_cosine(inverse, form, k, side, t, ox, oy, oz, dx, dy, dz):
    """Return direction . outward normal where a line hits a side of solid k."""
    if side < QUADRIC:
        axis = side % 3
        gx, gy, gz = inverse[k, axis, 0], inverse[k, axis, 1], inverse[k, axis, 2]
        slope = gx * dx + gy * dy + gz * dz
        if side < 3:
            slope = -slope
    else:
        px, py, pz = to_local(inverse, k, ox + t * dx, oy + t * dy, oz + t * dz)
        lx, ly, lz = 2.0 * form[k, 6] * px, 2.0 * form[k, 7] * py, 2.0 * form[k, 8] * pz + form[k, 9]
        gx = inverse[k, 0, 0] * lx + inverse[k, 1, 0] * ly + inverse[k, 2, 0] * lz
        gy = inverse[k, 0, 1] * lx + inverse[k, 1, 1] * ly + inverse[k, 2, 1] * lz
        gz = inverse[k, 0, 2] * lx + inverse[k, 1, 2] * ly + inverse[k, 2, 2] * lz
        slope = gx * dx + gy * dy + gz * dz
    length = math.sqrt(gx * gx + gy * gy + gz * gz)
    return slope / length if length > 0.0 else 0.0
