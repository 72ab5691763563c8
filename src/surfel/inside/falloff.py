"""Falloff: the weight of a neighbour by its distance, by multiplications alone, so that whole vectors do it."""

from __future__ import annotations

from surfel._numba import inlined


@inlined
def falloff(x):
    """Return exp(-x) within 1e-9 of itself, for x from 0 to 3: the sixteenth power of a short series."""
    y = x * 0.0625
    e = 1.0 / 120.0 - y * (1.0 / 720.0 - y * (1.0 / 5040.0))
    e = 1.0 - y * (1.0 - y * (0.5 - y * (1.0 / 6.0 - y * (1.0 / 24.0 - y * e))))
    e *= e
    e *= e
    e *= e
    return e * e
