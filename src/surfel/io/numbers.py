"""Decimal numbers in bytes to doubles, correctly rounded, as kernels.

D. Lemire, "Number parsing at a gigabyte per second", Software: Practice and Experience 51 (2021), algorithm 1: the
decimal significand w (at most 19 digits) times a 128-bit approximation of 5^q gives the nearest double, or is known to
be undecided. The few undecided tokens (and nan, inf, subnormal or wrong ones) are marked ``HARD`` for Python's float.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel

INTEGER, REAL, HARD = 0, 1, 2
_LEAST, _MOST = -342, 308
_U = np.uint64
_LOW32, _32, _ALL = _U(0xFFFFFFFF), _U(32), _U(0xFFFFFFFFFFFFFFFF)
_ONE, _THREE, _NINE, _52, _63 = _U(1), _U(3), _U(9), _U(52), _U(63)
_TEN = _U(10)
_LAST = _U(10**18)  # below it, one digit more keeps the significand below 10^19
_NINE_ONES = _U(0x1FF)
_HIDDEN, _FULL, _FRACTION = _U(1 << 52), _U(1 << 53), _U((1 << 52) - 1)
_SIGN = _U(1 << 63)


def _powers_of_five() -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """Return the 128 leading bits of 5^q for all q of a double, rounded down (up for q < 0), in two words."""
    high, low = [], []
    for q in range(_LEAST, _MOST + 1):
        if q >= 0:
            value = 5**q
            bits = value.bit_length()
            value = value << (128 - bits) if bits <= 128 else value >> (bits - 128)
        else:
            power = 5**-q
            bits = (power - 1).bit_length()
            value = (1 << (bits + 127 if q >= -27 else 2 * bits + 128)) // power + 1
            value >>= max(0, value.bit_length() - 128)
        high.append(value >> 64)
        low.append(value & 0xFFFFFFFFFFFFFFFF)
    return np.array(high, np.uint64), np.array(low, np.uint64)


_HIGH, _LOW = _powers_of_five()


@kernel
def _high_product(a, b):
    """Return the upper 64 bits of the product of two 64-bit words."""
    a0, a1, b0, b1 = a & _LOW32, a >> _32, b & _LOW32, b >> _32
    middle = a1 * b0 + ((a0 * b0) >> _32)
    other = a0 * b1 + (middle & _LOW32)
    return a1 * b1 + (middle >> _32) + (other >> _32)


@kernel
def _nearest(w, q):
    """Return the bits of the double nearest to w 10^q, and whether they are certain."""
    if w == _U(0):
        return _U(0), True
    if q < _LEAST or q > _MOST:
        return _U(0), False
    shift = 0
    for bit in range(6):
        step = 32 >> bit
        if w < (_ONE << _U(64 - step)):
            w <<= _U(step)
            shift += step
    index = q - _LEAST
    high = _high_product(w, _HIGH[index])
    low = w * _HIGH[index]
    if (high & _NINE_ONES) == _NINE_ONES:  # the bits that decide the rounding need the lower word as well
        carry = _high_product(w, _LOW[index])
        low += carry
        if carry > low:
            high += _ONE
    if low == _ALL and (q < -27 or q > 55):
        return _U(0), False
    upper = high >> _63
    drop = upper + _NINE
    mantissa = high >> drop
    power = ((217706 * q) >> 16) + 63 + np.int64(upper) - shift + 1023  # 217706 / 65536 = log2(10), exact in this range
    if power <= 0 or power >= 2046:
        return _U(0), False
    if low <= _ONE and -4 <= q <= 23 and (mantissa & _THREE) == _ONE and (mantissa << drop) == high:
        mantissa &= ~_ONE  # exactly half way: to even
    mantissa += mantissa & _ONE
    mantissa >>= _ONE
    if mantissa >= _FULL:
        mantissa = _HIDDEN
        power += 1
    return (mantissa & _FRACTION) | (_U(power) << _52), True


@kernel
def _long_significand(data, start, stop):
    """Read many digits: the first 19 that count, the power of ten behind them, and if one left out is not 0."""
    w = _U(0)
    q = 0
    cut = False
    whole = True
    for p in range(start, stop):
        d = np.int64(data[p]) - 48
        if d == -2:
            whole = False
        elif w < _LAST:
            w = w * _TEN + _U(d)
            q -= 0 if whole else 1
        else:
            cut = cut or d != 0
            q += 1 if whole else 0
    return w, q, cut


@kernel
def scan_number(data, start, stop, counted):
    """Read one number; return its bits, its whole value, its kind and the position after its last character.

    Where only whole numbers are counted, their bits are not made.
    """
    p = start
    negative = data[p] == 45
    if negative or data[p] == 43:
        p += 1
    first = p
    w = _U(0)
    while p < stop:
        d = np.int64(data[p]) - 48
        if d < 0 or d > 9:
            break
        w = w * _TEN + _U(d)
        p += 1
    digits = p - first
    q = 0
    kind = INTEGER
    if p < stop and data[p] == 46:
        kind = REAL
        p += 1
        point = p
        while p < stop:
            d = np.int64(data[p]) - 48
            if d < 0 or d > 9:
                break
            w = w * _TEN + _U(d)
            p += 1
        q = point - p
        digits -= q
    if digits == 0:
        return _U(0), 0, HARD, p
    cut = False
    if digits > 18:
        w, q, cut = _long_significand(data, first, p)
        kind = REAL
    if p < stop and (data[p] | 32) == 101:
        kind = REAL
        p += 1
        minus = False
        if p < stop and (data[p] == 45 or data[p] == 43):
            minus = data[p] == 45
            p += 1
        figures = p
        e = 0
        while p < stop and 48 <= data[p] <= 57:
            if e < 100000:
                e = e * 10 + np.int64(data[p]) - 48
            p += 1
        if p == figures:
            return _U(0), 0, HARD, p
        q += -e if minus else e
    if counted and kind == INTEGER:
        return _U(0), -np.int64(w) if negative else np.int64(w), kind, p
    bits, certain = _nearest(w, q)
    if cut and certain:  # digits beyond the 19th: certain only if the next significand rounds to the same double
        above, certain = _nearest(w + _ONE, q)
        certain = certain and above == bits
    if not certain:
        return _U(0), 0, HARD, p
    if negative:
        bits |= _SIGN
    return bits, 0, kind, p
