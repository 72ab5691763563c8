"""Roots on chords taken to where the polynomial itself is zero, by Newton's method; for kernels alone."""

from __future__ import annotations

import math

from surfel._numba import inlined, inner
from surfel.shapes.primitives.polynomial_values import evaluate, fill_powers

_PASSES = 4
_SETTLED = 1e-10  # a step after which the gradient need not be found again
_FARTHEST = 1e-3  # step, as a share of the chord
_LEAST = 1e-16  # cosine: what rounding leaves of a line that touches


@inner
def polish(form, chords, map_to, block, scratch):
    """Polish the roots on the first chords of a block, many together, and find the cosines with the gradient."""
    b, k = 0, 0
    while b < chords:
        count = 0
        while b < chords and count < len(scratch.listed):
            if k < block.number[b]:
                scratch.listed[count, 0], scratch.listed[count, 1] = b, k
                count += 1
                k += 1
            else:
                b, k = b + 1, 0
        _polish_listed(form, count, block, scratch)
        for v in range(count):
            chord, root = scratch.listed[v, 0], scratch.listed[v, 1]
            cosine = _cosine(map_to, scratch.slopes[:, v], block.along[chord], block.lengths[chord])
            rising = block.negative[chord, 0] == (root % 2 == 0)
            block.cosines[chord, root] = cosine if rising else -cosine


@inner
def _polish_listed(form, count, block, scratch):
    for _ in range(_PASSES):
        for v in range(count):
            b = scratch.listed[v, 0]
            u = block.roots[b, scratch.listed[v, 1]]
            for axis in range(3):
                scratch.points[axis, v] = block.ends[b, axis] + u * block.along[b, axis]
        fill_powers(form, scratch.points, count, scratch.powers)
        evaluate(form, 0, scratch.powers, count, scratch.group, scratch.values)
        for axis in range(3):
            evaluate(form, axis + 1, scratch.powers, count, scratch.group, scratch.slopes[axis])
        longest = 0.0
        for v in range(count):
            b, k = scratch.listed[v, 0], scratch.listed[v, 1]
            step = _newton_step(
                scratch.values[v], scratch.slopes[:, v], block.along[b], block.roots[b], k, block.number[b]
            )
            longest = max(longest, step)
        if longest <= _SETTLED:
            return


@inlined
def _newton_step(value, gradient, along, roots, k, number):
    """Move a root by a step of Newton's method, never far towards the next ones, and return how far."""
    slope = gradient[0] * along[0] + gradient[1] * along[1] + gradient[2] * along[2]
    if slope == 0.0:
        return 0.0
    limit = _FARTHEST
    if k > 0:
        limit = min(limit, 0.25 * (roots[k] - roots[k - 1]))
    if k + 1 < number:
        limit = min(limit, 0.25 * (roots[k + 1] - roots[k]))
    step = min(max(-value / slope, -limit), limit)
    roots[k] += step
    return abs(step)


@inlined
def _cosine(map_to, gradient, along, length):
    """Return the size of the cosine of a world line with the world normal A^T g; ``along`` is A d times ``length``."""
    nx = map_to[0, 0] * gradient[0] + map_to[1, 0] * gradient[1] + map_to[2, 0] * gradient[2]
    ny = map_to[0, 1] * gradient[0] + map_to[1, 1] * gradient[1] + map_to[2, 1] * gradient[2]
    nz = map_to[0, 2] * gradient[0] + map_to[1, 2] * gradient[1] + map_to[2, 2] * gradient[2]
    norm = math.sqrt(nx * nx + ny * ny + nz * nz) * length
    slope = abs(gradient[0] * along[0] + gradient[1] * along[1] + gradient[2] * along[2])
    if norm == 0.0:
        return 1.0  # at a singular point there is no normal
    return min(max(slope / norm, _LEAST), 1.0)
