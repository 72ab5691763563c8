"""The zeros of a polynomial of degree six in Bernstein form: none missed, none twice, tangential ones included.

The interval is cut until the polynomial is monotone on each part. A part's zero, if it has one, is then bracketed, and
Newton's method with a bisection as its safeguard ends wherever it starts. Where the polynomial comes within a
tolerance of zero without passing it, as at a double zero that rounding has lifted, the place counts as one zero.

Everything here is called by kernels alone.
"""

from __future__ import annotations

from surfel._numba import inlined, inner

DEEPEST = 14
"""After so many halvings a part is taken as monotone: it is 1/16,384 of the interval."""

STACK = DEEPEST + 2
"""Rows of scratch that :func:`zeros` needs, each of :data:`WIDTH` numbers."""

WIDTH = 10
"""Seven coefficients, the ends of the part, and how deep it lies."""

ENOUGH = 1.0 / 64.0
"""A value of so much of the tolerance ends the search for a zero."""

SURE = 1e-9
"""A step of Newton's method so short leaves a value of its square times the bend: less than rounding."""


@inlined
def value_at(c, s):
    """Return the polynomial with Bernstein coefficients c[0:7] at s, by Horner's scheme."""
    q = 1.0 - s
    p = c[0] * q + 6.0 * c[1] * s
    r = s * s
    p = p * q + 15.0 * c[2] * r
    r *= s
    p = p * q + 20.0 * c[3] * r
    r *= s
    p = p * q + 15.0 * c[4] * r
    r *= s
    p = p * q + 6.0 * c[5] * r
    return p * q + c[6] * r * s


@inlined
def slope_at(c, s):
    """Return its first derivative at s."""
    q = 1.0 - s
    p = (c[1] - c[0]) * q + 5.0 * (c[2] - c[1]) * s
    r = s * s
    p = p * q + 10.0 * (c[3] - c[2]) * r
    r *= s
    p = p * q + 10.0 * (c[4] - c[3]) * r
    r *= s
    p = p * q + 5.0 * (c[5] - c[4]) * r
    return 6.0 * (p * q + (c[6] - c[5]) * r * s)


@inlined
def bend_at(c, s):
    """Return its second derivative at s."""
    q = 1.0 - s
    p = (c[0] - 2.0 * c[1] + c[2]) * q + 4.0 * (c[1] - 2.0 * c[2] + c[3]) * s
    r = s * s
    p = p * q + 6.0 * (c[2] - 2.0 * c[3] + c[4]) * r
    r *= s
    p = p * q + 4.0 * (c[3] - 2.0 * c[4] + c[5]) * r
    return 30.0 * (p * q + (c[4] - 2.0 * c[5] + c[6]) * r * s)


@inner
def zero_between(c, a, b, at_a, at_b, enough):
    """Return the zero of the polynomial between a and b, at which its values have different signs.

    A value below ``enough`` is rounding, and ends the search.
    """
    rising = at_b >= 0.0
    s = a + (b - a) * (at_a / (at_a - at_b))
    step = b - a
    for _ in range(80):
        g = value_at(c, s)
        if abs(g) <= enough:
            return s
        if (g > 0.0) == rising:
            b = s
        else:
            a = s
        slope = slope_at(c, s)
        new = s - g / slope if slope != 0.0 else a
        if not a <= new <= b or 2.0 * abs(new - s) > step:
            new = 0.5 * (a + b)
        elif abs(new - s) <= SURE:
            return new
        step = abs(new - s)
        s = new
        if step <= 2e-16:
            return s
    return s


@inner
def turn_between(c, a, b, rising, tolerance):
    """Return where the derivative has its zero between a and b, or a place beyond the axis on the way there.

    ``rising`` says whether the polynomial rises towards its turn. The place is known well enough when its value is:
    that errs by the square of the distance.
    """
    s = 0.5 * (a + b)
    step = b - a
    for _ in range(80):
        g = value_at(c, s)
        if (g > tolerance) if rising else (g < -tolerance):
            return s
        slope = slope_at(c, s)
        if slope == 0.0:
            return s
        if (slope > 0.0) == rising:
            a = s
        else:
            b = s
        bend = bend_at(c, s)
        new = s - slope / bend if bend != 0.0 else a
        if not a <= new <= b or 2.0 * abs(new - s) > step:
            new = 0.5 * (a + b)
        step = abs(new - s)
        s = new
        if step <= 1e-10:
            return s
    return s


@inlined
def put_zero(out, found, s):
    """Append a zero, if there is room for it, and return how many there are."""
    if found < len(out):
        out[found] = s
    return found + 1


@inner
def monotone_zero(c, a, b, at_a, at_b, tolerance, touching, out, found):
    """Append the zero of a part with at most one, and return how many there are and whether the part ends at one.

    ``touching`` says that the part begins at a zero that was counted already.
    """
    if abs(at_a) <= tolerance:
        if not touching:
            found = put_zero(out, found, a)
        return found, abs(at_b) <= tolerance
    if (at_a < 0.0) != (at_b < 0.0):
        found = put_zero(out, found, zero_between(c, a, b, at_a, at_b, ENOUGH * tolerance))
    elif abs(at_b) <= tolerance:
        found = put_zero(out, found, b)
    return found, abs(at_b) <= tolerance


@inner
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


@inner
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


@inner
def zeros(c, tolerance, touching, parts, out):
    """Write the zeros of a polynomial on [0, 1] into ``out``, ascending.

    ``c`` holds seven Bernstein coefficients, ``touching`` says that a zero at 0 was counted before, ``parts`` is
    scratch. Returns how many zeros there are (which may be more than fit) and whether the polynomial ends at one.
    """
    found = 0
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
        elif changes == 0 or parts[row, 9] >= DEEPEST or (changes == 1 and has_one(at_a, at_b, rises, tolerance)):
            found, touching = monotone_zero(c, a, b, at_a, at_b, tolerance, touching, out, found)
        elif changes == 1:
            turn = turn_between(c, a, b, rises, tolerance)
            at_turn = value_at(c, turn)
            found, touching = monotone_zero(c, a, turn, at_a, at_turn, tolerance, touching, out, found)
            found, touching = monotone_zero(c, turn, b, at_turn, at_b, tolerance, touching, out, found)
        else:
            halve(parts, row)
            row += 2
        row -= 1
    return found, touching


@inlined
def has_one(at_a, at_b, rises, tolerance):
    """Tell whether a part that turns once has at most one zero by its ends: of two signs, or away from the turn."""
    if abs(at_a) <= tolerance or abs(at_b) <= tolerance:
        return False
    return (at_a < 0.0) != (at_b < 0.0) or (at_a > 0.0) == rises
