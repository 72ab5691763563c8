"""Kernels of E57: the checksums of pages, and numbers packed bit by bit.

CRC-32C (Castagnoli), four bytes a step: M. E. Kounavis and F. L. Berry, "A systematic approach to building high
performance software-based CRC generators", ISCC 2005.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, rows, threads_for
from surfel.io.source import Bytes

_POLYNOMIAL = 0x82F63B78  # reflected
_ALL, _BYTE, _EIGHT = np.uint32(0xFFFFFFFF), np.uint32(0xFF), np.uint32(8)
_ONE, _THREE, _SEVEN, _64 = np.uint64(1), np.uint64(3), np.uint64(7), np.uint64(64)


def checksums(pages: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Return the CRC-32C of each row of bytes (their number a multiple of 4)."""
    out = np.empty(len(pages), np.uint32)
    with threads_for(pages.size // 16):
        _checksums(len(pages), np.ascontiguousarray(pages), _tables(), out)
    return out


def unpacked(data: Bytes, bit: int, count: int, bits: int) -> NDArray[np.uint64]:
    """Return ``count`` numbers of ``bits`` bits each (1 to 64), from the given bit on, the lowest bit first."""
    out = np.empty(count, np.uint64)
    with threads_for(count):
        _unpack(count, data, np.uint64(bit), np.uint64(bits), out)
    return out


@cache
def _tables() -> NDArray[np.uint32]:
    """Return, for each of four places, what a byte there does to the checksum."""
    table = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        table = np.where(table & 1, (table >> 1) ^ np.uint32(_POLYNOMIAL), table >> 1).astype(np.uint32)
    tables = [table]
    for _ in range(3):
        tables.append((tables[-1] >> 8) ^ table[tables[-1] & 0xFF])
    return np.stack(tables)


@rows
def _checksums(first, last, pages, tables, out):
    for page in range(first, last):
        out[page] = _checksum(pages[page], tables)


@inner
def _checksum(data, tables):
    crc = _ALL
    for p in range(0, len(data), 4):
        crc ^= (
            np.uint32(data[p]) | np.uint32(data[p + 1]) << np.uint32(8)
            | np.uint32(data[p + 2]) << np.uint32(16) | np.uint32(data[p + 3]) << np.uint32(24)
        )  # fmt: skip
        crc = (
            tables[3, crc & _BYTE] ^ tables[2, (crc >> _EIGHT) & _BYTE]
            ^ tables[1, (crc >> np.uint32(16)) & _BYTE] ^ tables[0, crc >> np.uint32(24)]
        )  # fmt: skip
    return crc ^ _ALL


@rows
def _unpack(first, last, data, bit, bits, out):
    for i in range(first, last):
        place = bit + np.uint64(i) * bits
        p = place >> _THREE
        got = np.uint64(8) - (place & _SEVEN)
        value = np.uint64(data[p]) >> (place & _SEVEN)
        while got < bits:
            p += _ONE
            value |= np.uint64(data[p]) << got
            got += np.uint64(8)
        if bits < _64:
            value &= (_ONE << bits) - _ONE
        out[i] = value
