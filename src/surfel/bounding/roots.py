"""The zeros of a polynomial of degree six in Bernstein form: none missed, none twice, tangential ones included.

The interval is cut until the polynomial is monotone on each part. A part's zero, if it has one, is then bracketed, and
Halley's method with a bisection as its safeguard ends wherever it starts. Where the polynomial comes within a
tolerance of zero without passing it, as at a double zero that rounding has lifted, the place counts as one zero.

Everything here is called by kernels alone.
"""

from __future__ import annotations

import math

from surfel._numba import inlined, inner
from surfel.bounding.along import times_plus

DEEPEST = 14
"""After so many halvings a part is taken as monotone: it is 1/16,384 of the interval."""

STACK = DEEPEST + 2
"""Rows of scratch that :func:`zeros` needs, each of :data:`WIDTH` numbers."""

WIDTH = 10
"""Seven coefficients, the ends of the part, and how deep it lies."""

ENOUGH = 1.0 / 64.0
"""A value of so much of the tolerance ends the search for a zero."""

SURE = 5e-6
"""A step of Halley's method so short leaves a value of its cube times the third derivative: less than rounding."""

NEAR = 1e-6
"""A step towards a turn so short leaves about its square to go: nothing that the value there shows."""

ALL_ABOVE, ALL_BELOW = 127, 127 << 8
"""The signs of seven coefficients, as :func:`surfel.bounding.along.restrict` tells them, where none is zero."""


@inlined
def change_once(signs):
    """Tell whether seven coefficients, none of them within the tolerance of zero, change sign just once.

    Then the polynomial has one zero (Descartes), and so have all that are off by less than the tolerance.
    """
    above, below = signs & ALL_ABOVE, signs >> 8
    changes = (above ^ (above >> 1)) & 63
    return (above + below == ALL_ABOVE) & (changes & (changes - 1) == 0)


@inner
def zero_between(c0, c1, c2, c3, c4, c5, c6, a, s, b, rising, enough):
    """Return the zero of the polynomial between a and b, at which its values have different signs, begun at s.

    ``rising`` says that the value at b is the larger one. A value below ``enough`` is rounding, and ends the search.
    Steps are Halley's: each leaves the cube of the error.
    """
    d0, d1, d2, d3, d4, d5 = c1 - c0, c2 - c1, c3 - c2, c4 - c3, c5 - c4, c6 - c5
    e0, e1, e2, e3, e4 = d1 - d0, 4.0 * (d2 - d1), 6.0 * (d3 - d2), 4.0 * (d4 - d3), d5 - d4
    d1, d2, d3, d4 = 5.0 * d1, 10.0 * d2, 10.0 * d3, 5.0 * d4
    c1, c2, c3, c4, c5 = 6.0 * c1, 15.0 * c2, 20.0 * c3, 15.0 * c4, 6.0 * c5
    step = b - a
    for _ in range(80):
        q = 1.0 - s
        s2 = s * s
        s3, s4 = s2 * s, s2 * s2
        s5, s6 = s4 * s, s4 * s2
        g = times_plus(times_plus(times_plus(c0, q, c1 * s), q, c2 * s2), q, c3 * s3)
        g = times_plus(times_plus(times_plus(g, q, c4 * s4), q, c5 * s5), q, c6 * s6)
        if abs(g) <= enough:
            return s
        if (g > 0.0) == rising:
            b = s
        else:
            a = s
        slope = times_plus(times_plus(times_plus(d0, q, d1 * s), q, d2 * s2), q, d3 * s3)
        slope = 6.0 * times_plus(times_plus(slope, q, d4 * s4), q, d5 * s5)
        bend = times_plus(times_plus(e0, q, e1 * s), q, e2 * s2)
        bend = 15.0 * times_plus(times_plus(bend, q, e3 * s3), q, e4 * s4)
        below = slope * slope - g * bend
        new = s - g * slope / below if below != 0.0 else math.inf
        if not a <= new <= b or 2.0 * abs(new - s) > step:
            new = 0.5 * (a + b)
        elif abs(new - s) * (abs(slope) + abs(bend)) <= SURE * abs(slope):
            return new
        step = abs(new - s)
        s = new
        if step <= 2e-16:
            return s
    return s


@inner
def turn_between(c0, c1, c2, c3, c4, c5, c6, a, s, b, rising, tolerance):
    """Return where the derivative has its zero between a and b, begun at s, or a place beyond the axis on the way.

    ``rising`` says whether the polynomial rises towards its turn. Returned is the value there, too. It errs by the
    square of the distance from the turn, and that by the square of the last step.
    """
    d0, d1, d2, d3, d4, d5 = c1 - c0, c2 - c1, c3 - c2, c4 - c3, c5 - c4, c6 - c5
    e0, e1, e2, e3, e4 = d1 - d0, 4.0 * (d2 - d1), 6.0 * (d3 - d2), 4.0 * (d4 - d3), d5 - d4
    d1, d2, d3, d4 = 5.0 * d1, 10.0 * d2, 10.0 * d3, 5.0 * d4
    c1, c2, c3, c4, c5 = 6.0 * c1, 15.0 * c2, 20.0 * c3, 15.0 * c4, 6.0 * c5
    step, last, g = b - a, False, 0.0
    for _ in range(80):
        q = 1.0 - s
        s2 = s * s
        s3, s4 = s2 * s, s2 * s2
        s5, s6 = s4 * s, s4 * s2
        g = times_plus(times_plus(times_plus(c0, q, c1 * s), q, c2 * s2), q, c3 * s3)
        g = times_plus(times_plus(times_plus(g, q, c4 * s4), q, c5 * s5), q, c6 * s6)
        if last or ((g > tolerance) if rising else (g < -tolerance)):
            break
        slope = times_plus(times_plus(times_plus(d0, q, d1 * s), q, d2 * s2), q, d3 * s3)
        slope = times_plus(times_plus(slope, q, d4 * s4), q, d5 * s5)
        if slope == 0.0:
            break
        if (slope > 0.0) == rising:
            a = s
        else:
            b = s
        bend = times_plus(times_plus(e0, q, e1 * s), q, e2 * s2)
        bend = 5.0 * times_plus(times_plus(bend, q, e3 * s3), q, e4 * s4)
        new = s - slope / bend if bend != 0.0 else math.inf
        if not a <= new <= b or 2.0 * abs(new - s) > step:
            new = 0.5 * (a + b)
        step = abs(new - s)
        s = new
        last = step <= NEAR
    return s, g


@inlined
def put_zero(out, found, s):
    """Append a zero, if there is room for it, and return how many there are."""
    if found < len(out):
        out[found] = s
    return found + 1


@inlined
def describe(parts, row):
    """Return the least and the largest coefficient of a part, how often it may turn, and whether it rises first.

    The derivative has at most as many zeros inside as its coefficients change sign.
    """
    low = high = before = parts[row, 0]
    changes, sign, rises = 0, 0.0, False
    for k in range(1, 7):
        here = parts[row, k]
        low, high = min(low, here), max(high, here)
        d = here - before
        if d != 0.0:
            if sign == 0.0:
                rises = d > 0.0
            elif d * sign < 0.0:
                changes += 1
            sign = d
        before = here
    return low, high, changes, rises


@inlined
def halve(parts, row):
    """Cut the part in a row of the stack at its middle, the left half on top (de Casteljau in place)."""
    left, right = row + 1, row
    middle = 0.5 * (parts[row, 7] + parts[row, 8])
    for k in range(7):
        parts[left, k] = parts[right, 0]
        for j in range(6 - k):
            parts[right, j] = 0.5 * (parts[right, j] + parts[right, j + 1])
    parts[left, 7], parts[left, 8] = parts[row, 7], middle
    parts[right, 7] = middle
    parts[left, 9] = parts[right, 9] = parts[row, 9] + 1.0


@inlined
def zeros(c, tolerance, touching, parts, out):
    """Write the zeros of a polynomial on [0, 1] into ``out``, ascending.

    ``c`` holds seven Bernstein coefficients, ``touching`` says that a zero at 0 was counted before, ``parts`` is
    scratch. Returns how many zeros there are (which may be more than fit) and whether the polynomial ends at one.
    """
    found = 0
    c0, c1, c2, c3, c4, c5, c6 = c[0], c[1], c[2], c[3], c[4], c[5], c[6]
    for k in range(7):
        parts[0, k] = c[k]
    parts[0, 7], parts[0, 8], parts[0, 9] = 0.0, 1.0, 0.0
    row = 0
    while row >= 0:
        low, high, changes, rises = describe(parts, row)
        a, b, at_a, at_b = parts[row, 7], parts[row, 8], parts[row, 0], parts[row, 6]
        if low > tolerance or high < -tolerance:
            touching = False
        elif low >= -tolerance and high <= tolerance:  # the line runs along the surface
            if not touching:
                found = put_zero(out, found, a)
            touching = True
        elif changes > 1 and parts[row, 9] < DEEPEST:
            halve(parts, row)
            row += 2
        else:
            turn, at_turn, turns = b, at_b, False
            if changes == 1 and parts[row, 9] < DEEPEST and not has_one(at_a, at_b, rises, tolerance):
                first, last = parts[row, 1] - at_a, at_b - parts[row, 5]
                s = a + (b - a) * (first / (first - last) if first * last < 0.0 else 0.5)
                turn, at_turn = turn_between(c0, c1, c2, c3, c4, c5, c6, a, s, b, rises, tolerance)
                turns = True
            while True:  # the part before the turn, then the one after it
                if abs(at_a) <= tolerance:
                    if not touching:
                        found = put_zero(out, found, a)
                elif (at_a < 0.0) != (at_turn < 0.0):
                    share = at_a / (at_a - at_turn)
                    if turns:  # at its turn the polynomial is nearly a parabola
                        share = 1.0 - math.sqrt(1.0 - share) if turn < b else math.sqrt(share)
                    s = a + (turn - a) * share
                    rising = at_turn >= 0.0
                    s = zero_between(c0, c1, c2, c3, c4, c5, c6, a, s, turn, rising, ENOUGH * tolerance)
                    found = put_zero(out, found, s)
                elif abs(at_turn) <= tolerance:
                    found = put_zero(out, found, turn)
                touching = abs(at_turn) <= tolerance
                if turn >= b:
                    break
                a, at_a, turn, at_turn = turn, at_turn, b, at_b
        row -= 1
    return found, touching


@inlined
def has_one(at_a, at_b, rises, tolerance):
    """Tell whether a part that turns once has at most one zero by its ends: of two signs, or away from the turn."""
    if abs(at_a) <= tolerance or abs(at_b) <= tolerance:
        return False
    return (at_a < 0.0) != (at_b < 0.0) or (at_a > 0.0) == rises
