"""The points of one scan in an E57 file: packets that each bring some bytes of every value's own stream.

Source: ASTM E2807-11, chapter 9.3 (compressed vector sections, data packets).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.io.e57_pages import Pages
from surfel.io.e57_tree import Number, Scan
from surfel.io.source import Bytes

_SECTION = 32
_WINDOW = 1 << 22
_INDEX, _DATA, _EMPTY = 0, 1, 2
_DAMAGED = "the points were damaged; fetch the file again"


def runs(pages: Pages, scan: Scan, size: int) -> Iterator[list[NDArray[Any]]]:
    """Yield the values of at most ``size`` points at a time, an array for each number of the scan (strings are None).

    Raises
    ------
    FileFormatError
        If the packets do not hold as many points as the scan announces.
    """
    streams = [_Stream(number) for number in scan.numbers]
    least = sum(number.bits for number in scan.numbers)
    if scan.count > 8 * pages.source.size // max(1, least):
        raise pages.source.error(
            f"{scan.name!r} announces {scan.count} points of {least} bits, the file has {pages.source.size} bytes",
            "description", _DAMAGED,
        )  # fmt: skip
    done = 0
    if scan.count:
        for packet in _packets(pages, scan):
            for stream, data in zip(streams, packet, strict=True):
                stream.add(data)
            while True:
                ready = min(min(stream.ready for stream in streams), scan.count - done)
                if ready == 0 or (ready < size and ready < scan.count - done):
                    break
                yield [stream.take(min(ready, size)) for stream in streams]
                done += min(ready, size)
            if done == scan.count:
                return
    if done < scan.count:
        ready = min(stream.ready for stream in streams)
        raise pages.source.error(
            f"{scan.name!r} announces {scan.count} points, its packets hold {done + ready}", f"byte {scan.place}",
            _DAMAGED,
        )  # fmt: skip


class _Stream:
    """The bytes of one number that were not taken yet."""

    def __init__(self, number: Number) -> None:
        self._number = number
        self._parts: list[Bytes] = []
        self._bytes = 0
        self._bit = 0  # of the first byte, where the next value begins

    @property
    def ready(self) -> int:
        """How many values can be taken."""
        bits = self._number.bits
        if self._number.kind == "skipped" or bits == 0:
            return 1 << 62
        return (8 * self._bytes - self._bit) // bits

    def add(self, data: Bytes) -> None:
        if self._number.kind != "skipped" and self._number.bits:
            self._parts.append(data)
            self._bytes += len(data)

    def take(self, count: int) -> Any:
        """Return the next values."""
        from surfel.io.e57_bits import unpacked  # on first use, because it has kernels

        number = self._number
        if number.kind == "skipped":
            return None
        if number.bits == 0:
            return number.values(np.zeros(count, np.uint64))
        data = np.concatenate(self._parts)
        end = self._bit + count * number.bits
        if self._bit == 0 and number.bits in (32, 64):
            raw = data[: end // 8].copy().view(f"<u{number.bits // 8}").astype(np.uint64)
        else:
            raw = unpacked(data, self._bit, count, number.bits)
        self._parts = [data[end // 8 :]]
        self._bytes, self._bit = len(data) - end // 8, end % 8
        return number.values(raw)


def _packets(pages: Pages, scan: Scan) -> Iterator[list[Bytes]]:
    """Yield for each data packet the bytes that it brings to each stream."""
    source = pages.source
    begin = pages.from_physical(scan.place, f"the points of {scan.name!r}")
    raw = pages.read(begin, _SECTION, f"the points of {scan.name!r}").tobytes()
    kind, length, place, _ = struct.unpack("<B7x3Q", raw)
    end, at = begin + length, pages.from_physical(place, f"the packets of {scan.name!r}") if kind == 1 else 0
    if kind != 1 or length < _SECTION or end > pages.logical or not begin + _SECTION <= at <= end:
        raise source.error(f"the points of {scan.name!r} do not begin as they should", f"byte {scan.place}", _DAMAGED)
    window = np.empty(0, np.uint8)
    start = at  # of the window
    while at + 4 <= end:
        if at + 4 > start + len(window) or at + _packet_length(window, at - start) > start + len(window):
            start = at
            window = pages.read(at, min(_WINDOW, end - at), f"the points of {scan.name!r}")
        where = f"packet at byte {at // 1020 * 1024 + at % 1020}"
        size = _packet_length(window, at - start)
        if at + size > end or window[at - start] > _EMPTY:
            raise source.error(f"a packet of {scan.name!r} is none", where, _DAMAGED)
        packet = window[at - start : at - start + size]
        at += size
        if packet[0] != _DATA:
            continue
        number = int(packet[4]) | int(packet[5]) << 8 if size >= 6 else -1
        if number != len(scan.numbers) or size < 6 + 2 * number:
            raise source.error(
                f"a packet of {scan.name!r} has {number} streams instead of {len(scan.numbers)}", where, _DAMAGED
            )
        lengths = packet[6 : 6 + 2 * number].copy().view("<u2").astype(np.int64)
        places = 6 + 2 * number + np.concatenate([[0], np.cumsum(lengths)])
        if places[-1] > size:
            raise source.error(f"the streams of a packet of {scan.name!r} are longer than it", where, _DAMAGED)
        yield [packet[places[i] : places[i + 1]].copy() for i in range(number)]


def _packet_length(window: Bytes, at: int) -> int:
    return (int(window[at + 2]) | int(window[at + 3]) << 8) + 1
