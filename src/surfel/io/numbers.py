"""Decimal numbers in bytes to doubles, correctly rounded, as kernels.

D. Lemire, "Number parsing at a gigabyte per second", Software: Practice and Experience 51 (2021), algorithm 1: the
decimal significand w (at most 19 digits) times a 128-bit approximation of 5^q gives the nearest double, or is known to
be undecided. The few undecided tokens (and nan, inf, subnormal or wrong ones) are marked ``HARD`` for Python's float.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner
from surfel.io.words import bits_of, byte_at, eight_bytes, high_product, leading_zeros

INTEGER, REAL, HARD = 0, 1, 2
_LEAST, _MOST = -342, 308
_U = np.uint64
_ALL = _U(0xFFFFFFFFFFFFFFFF)
_ONE, _THREE, _NINE, _52, _63 = _U(1), _U(3), _U(9), _U(52), _U(63)
_TEN = _U(10)
_LAST = _U(10**18)  # below it, one digit more keeps the significand below 10^19
_NINE_ONES = _U(0x1FF)
_HIDDEN, _FULL, _FRACTION = _U(1 << 52), _U(1 << 53), _U((1 << 52) - 1)
_SIGN = _U(1 << 63)
_ZEROS, _SIXES = _U(0x3030303030303030), _U(0x4646464646464646)
_TOPS, _PAIRS = _U(0x8080808080808080), _U(0x000000FF000000FF)
_FROM_HUNDREDS, _FROM_TENTHS = _U(0x000F424000000064), _U(0x0000271000000001)
_EIGHT, _16, _32 = _U(8), _U(16), _U(32)
_HUNDRED_MILLION = _U(100_000_000)


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
_TENS = np.array([10.0**q for q in range(23)])


@inner
def _nearest(w, q):
    """Return the bits of the double nearest to w 10^q, and whether they are certain."""
    if w == _U(0):
        return _U(0), True
    if w <= _FULL and -22 <= q <= 22:  # both are doubles, so that one rounding is all there is (Clinger 1990)
        return bits_of(np.float64(w) / _TENS[-q] if q < 0 else np.float64(w) * _TENS[q]), True
    if q < _LEAST or q > _MOST:
        return _U(0), False
    shift = leading_zeros(w)
    w <<= shift
    index = q - _LEAST
    high = high_product(w, _HIGH[index])
    low = w * _HIGH[index]
    if (high & _NINE_ONES) == _NINE_ONES:  # the bits that decide the rounding need the lower word as well
        carry = high_product(w, _LOW[index])
        low += carry
        if carry > low:
            high += _ONE
    if low == _ALL and (q < -27 or q > 55):
        return _U(0), False
    upper = high >> _63
    drop = upper + _NINE
    mantissa = high >> drop
    power = (
        ((217706 * q) >> 16) + 63 + np.int64(upper) - np.int64(shift) + 1023
    )  # 217706 / 65536 = log2(10), exact in this range
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


@inner
def _long_significand(text, start, stop):
    """Read many digits: the first 19 that count, the power of ten behind them, and if one left out is not 0."""
    w = _U(0)
    q = 0
    cut = False
    whole = True
    for p in range(start, stop):
        d = byte_at(text, p) - 48
        if d == -2:
            whole = False
        elif w < _LAST:
            w = w * _TEN + _U(d)
            q -= 0 if whole else 1
        else:
            cut = cut or d != 0
            q += 1 if whole else 0
    return w, q, cut


@inlined
def _eight_digits(word):
    """Return the number that eight characters spell, and whether all are digits (Lemire, section 5)."""
    digits = ((word + _SIXES) | (word - _ZEROS)) & _TOPS == _U(0)
    word -= _ZEROS
    word = word * _TEN + (word >> _EIGHT)
    word = ((word & _PAIRS) * _FROM_HUNDREDS + ((word >> _16) & _PAIRS) * _FROM_TENTHS) >> _32
    return word, digits


@inner
def scan_number(text, start, stop, counted):
    """Read one number of the text at an address; return its bits, its whole value, its kind and where it ends.

    Where only whole numbers are counted, their bits are not made.
    """
    p = start
    negative = byte_at(text, p) == 45
    if negative or byte_at(text, p) == 43:
        p += 1
    first = p
    w = _U(0)
    while p < stop:
        d = byte_at(text, p) - 48
        if d < 0 or d > 9:
            break
        w = w * _TEN + _U(d)
        p += 1
    digits = p - first
    q = 0
    kind = INTEGER
    if p < stop and byte_at(text, p) == 46:
        kind = REAL
        p += 1
        point = p
        while p + 8 <= stop:
            eight, digits_only = _eight_digits(eight_bytes(text, p))
            if not digits_only:
                break
            w = w * _HUNDRED_MILLION + eight
            p += 8
        while p < stop:
            d = byte_at(text, p) - 48
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
        kind = REAL
        zero = first
        while zero < p and (
            byte_at(text, zero) == 48 or byte_at(text, zero) == 46
        ):  # zeros in front take no room in a word
            zero += 1
            digits -= 1
        if digits > 18:
            w, q, cut = _long_significand(text, first, p)
    if p < stop and (byte_at(text, p) | 32) == 101:
        kind = REAL
        p += 1
        minus = False
        if p < stop and (byte_at(text, p) == 45 or byte_at(text, p) == 43):
            minus = byte_at(text, p) == 45
            p += 1
        figures = p
        e = 0
        while p < stop and 48 <= byte_at(text, p) <= 57:
            if e < 100000:
                e = e * 10 + byte_at(text, p) - 48
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
