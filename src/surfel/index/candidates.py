"""Candidates: what both searches by groups share: radii that are learnt, coordinates in float32, and what these mean.

A group of places walks through the boxes with a radius learnt from the places before. What it meets is taken relative
to the group's middle in float64, scaled by the radius and rounded to float32, where comparing is cheap.
"""

from __future__ import annotations

import math

import numpy as np

from surfel._numba import inlined
from surfel.index.blocks import BLOCK

CHUNK = 1024
"""Places that learn their radius from each other; the same on any number of threads."""

GROUP = 16
"""Places that share a walk."""

ATTEMPTS, GROW, SHRINK = 12, 1.3, 0.6
"""How many radii are tried, and by what they change where one is too short or far too large."""

SIDE = 3.0
"""The box of a group is at most this many radii long: coordinates that matter stay below 2.5 radii."""

ROOM = 96
"""Blocks of candidates: more mean that the radius is far too large."""

COARSE = 2.0**-20
"""Squared distances below this, for radius 1, are left to the search one by one."""

ONE = np.int32(0x3F800000)
"""The bits of the float32 1."""

_ROUNDING = 2.5 * 2.0**-18


@inlined
def load(points, found, collected, mx, my, mz, scale, xs, ys, zs):
    """Write the candidates' coordinates, relative to the middle and in radii, in float32."""
    for k in range(collected):
        block = np.uint64(found[k]) * np.uint64(48)
        for lane in range(BLOCK):
            here = block + np.uint64(3 * lane)
            xs[k * BLOCK + lane] = np.float32((points[here] - mx) * scale)
            ys[k * BLOCK + lane] = np.float32((points[here + np.uint64(1)] - my) * scale)
            zs[k * BLOCK + lane] = np.float32((points[here + np.uint64(2)] - mz) * scale)


@inlined
def mask_for(slots):
    """Return the bits that the number of a slot needs, at least eight."""
    mask = 255
    while mask < slots - 1:
        mask = 2 * mask + 1
    return np.int32(mask)


@inlined
def may_be_as_near(square):
    """Return the largest square, for radius 1, of which rounding may hide that it is the smaller one.

    With coordinates below M = 2.5 radii a difference is off by 2 M 2^-25, so the square of a distance d by
    4 sqrt(3) M 2^-25 d and a few 2^-24 d^2, and a comparison of two by twice that: 2^-20.2 M d in all. The bound
    taken leaves a factor of 4.
    """
    return np.float32(square + _ROUNDING * math.sqrt(square))
