"""Values and gradients of a polynomial in three variables, at many points at a time."""

from __future__ import annotations

import numpy as np

from surfel._numba import inner, rows, threads_for
from surfel.core.cast import Floats
from surfel.shapes.primitives.polynomial_form import Form

_AT_ONCE = 256


def values_at(form: Form, points: Floats) -> Floats:
    """Return the values of the polynomial (up to its positive scale) at points of its own frame, shape (n,)."""
    values = np.empty(len(points))
    with threads_for(len(points)):
        _values_each(len(points), form, np.array((points - form.frame[:3]) / form.frame[3]), values)
    return values


@rows
def _values_each(first, last, form, places, values):
    most = max(form.degrees[0], form.degrees[1], form.degrees[2])
    points, powers = np.empty((3, _AT_ONCE)), np.empty((3, most + 1, _AT_ONCE))
    group, found = np.empty(_AT_ONCE), np.empty(_AT_ONCE)
    for start in range(first, last, _AT_ONCE):
        count = min(_AT_ONCE, last - start)
        for v in range(count):
            for axis in range(3):
                points[axis, v] = places[start + v, axis]
        fill_powers(form, points, count, powers)
        evaluate(form, 0, powers, count, group, found)
        for v in range(count):
            values[start + v] = found[v]


@inner
def fill_powers(form, points, count, powers):
    """Write the powers of the coordinates of points[:, :count] into ``powers``, shape (3, most + 1, width)."""
    for axis in range(3):
        base = points[axis]
        table = powers[axis]
        for v in range(count):
            table[0, v] = 1.0
        for e in range(1, form.degrees[axis] + 1):
            lower, upper = table[e - 1], table[e]
            for v in range(count):
                upper[v] = lower[v] * base[v]


@inner
def evaluate(form, part, powers, count, group, out):
    """Write q (part 0) or one of its derivatives (1, 2, 3) at the points behind ``powers`` into ``out``.

    The loops over points are the inner ones, so that the compiler makes vectors of them; a point's value does not
    depend on the points beside it, not in a bit.
    """
    for v in range(count):
        out[v] = 0.0
    for g in range(form.parts[part], form.parts[part + 1]):
        first, last = form.starts[g], form.starts[g + 1]
        c = form.coefficients[first]
        z = powers[2, form.z[first]]
        for v in range(count):
            group[v] = c * z[v]
        for term in range(first + 1, last):
            c = form.coefficients[term]
            z = powers[2, form.z[term]]
            for v in range(count):
                group[v] += c * z[v]
        x, y = powers[0, form.x[g]], powers[1, form.y[g]]
        for v in range(count):
            out[v] += group[v] * (x[v] * y[v])


@inner
def magnitude(form, x, y, z):
    """Return the sum of the sizes of q's terms at a point: what the rounding of q is relative to."""
    x, y, z = abs(x), abs(y), abs(z)
    total = 0.0
    for g in range(form.parts[0], form.parts[1]):
        group = 0.0
        for term in range(form.starts[g], form.starts[g + 1]):
            group += abs(form.coefficients[term]) * z ** form.z[term]
        total += group * x ** form.x[g] * y ** form.y[g]
    return total
