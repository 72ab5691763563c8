"""The header of a LAS file, checked against the file before a single point is read.

Source: ASPRS LAS Specification 1.4 - R15, tables 3 (header), 5 and 6 (variable-length records).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from surfel.core.cast import Floats
from surfel.io.las_crs import Record
from surfel.io.las_layout import Extra, extras_of, fields_of, length_of
from surfel.io.source import Source

OLD, WITH_WAVES, NEW = 227, 235, 375
LASZIP = ("laszip encoded", 22204)
COPC_INFO = ("copc", 1)
EXTRA_BYTES = ("LASF_Spec", 4)
_RECORD, _LONG_RECORD = 54, 60
_LONGEST_EVLR = 1 << 24  # longer ones are waveforms and hierarchies, which are read where they lie
_CUT = "the file was cut or changed; fetch it again"
_LIES = "the header was damaged; fetch the file again, or write it anew with a tool that counts the points"


@dataclass
class LasHeader:
    """What the header says, in world units where it speaks of coordinates."""

    version: int
    format: int
    packed: bool
    record: int
    count: int
    start: int
    end: int
    scale: tuple[float, float, float]
    offset: tuple[float, float, float]
    bounds: Floats | None
    returns: tuple[int, ...]
    fixed: dict[str, Any]
    records: list[Record] = field(default_factory=list)
    long_records: list[tuple[str, int, int, int]] = field(default_factory=list)  # user, number, first byte, length
    extras: list[Extra] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def data_of(self, key: tuple[str, int]) -> bytes | None:
        """Return the bytes of a variable-length record, None if there is none."""
        return next((r.data for r in self.records if (r.user, r.number) == key), None)


def read_header(source: Source) -> LasHeader:
    """Read header and records and compare them with the file.

    Raises
    ------
    FileFormatError
        If they do not fit each other or the file's size.
    """
    raw = source.head(NEW)
    if len(raw) < OLD or raw[:4] != b"LASF":
        raise source.error("it has no LAS header", f"byte {min(len(raw), 4)}", "name a LAS or LAZ file; it may be cut")
    header = _fixed_part(source, raw)
    _read_records(source, header, *struct.unpack_from("<HxxxxI", raw, 94))
    if header.version >= 4:
        _read_long_records(source, header, *struct.unpack_from("<QI", raw, 235))
    described = b"".join(r.data for r in header.records if (r.user, r.number) == EXTRA_BYTES)
    try:
        names = [f.name for f in fields_of(header.format)]
        header.extras, notes = extras_of(described, header.format, header.record, names)
    except ValueError as error:
        raise source.error(str(error), "record LASF_Spec 4", _LIES) from None
    header.notes += notes
    if not header.packed:
        _check_length(source, header)
    return header


def _fixed_part(source: Source, raw: bytes) -> LasHeader:
    major, minor = raw[24], raw[25]
    if major != 1 or minor > 4:
        raise source.error(f"it is LAS {major}.{minor}", "byte 24", "versions 1.0 to 1.4 are read")
    size, start = struct.unpack_from("<HI", raw, 94)
    least = NEW if minor == 4 else WITH_WAVES if minor == 3 else OLD
    if size < least or len(raw) < least or size > start:
        raise source.error(
            f"a header of {size} bytes and points from byte {start} do not fit LAS 1.{minor} (at least {least})",
            "byte 94", _LIES,
        )  # fmt: skip
    if start > source.size:
        raise source.error(
            f"its points begin at byte {start}, and the file has {source.size} bytes", f"byte {source.size}", _CUT
        )
    number, record = raw[104] & 0x3F, struct.unpack_from("<H", raw, 105)[0]
    if number > 10:
        raise source.error(f"its point format is {number}", "byte 104", "formats 0 to 10 are read")
    if record < length_of(number):
        raise source.error(
            f"its records have {record} bytes, point format {number} needs {length_of(number)}", "byte 105", _LIES
        )
    numbers = struct.unpack_from("<12d", raw, 131)
    scale, offset = numbers[0:3], numbers[3:6]
    if not np.isfinite(numbers[:6]).all() or 0.0 in scale:
        raise source.error(f"its scale {scale} or offset {offset} cannot be", "byte 131", _LIES)
    count, returns = _counts(source, raw, minor)
    header = LasHeader(
        minor, number, bool(raw[104] & 0xC0), record, count, start, source.size, scale, offset, None, returns,
        {"source_id": raw[4:6], "encoding": struct.unpack_from("<H", raw, 6)[0], "guid": raw[8:24],
         "system": raw[26:58], "software": raw[58:90], "created": raw[90:94]},
    )  # fmt: skip
    header.bounds = _bounds(source, header, np.array(numbers[6:]))
    return header


def _counts(source: Source, raw: bytes, minor: int) -> tuple[int, tuple[int, ...]]:
    """Return how many points there are, and how many of each return."""
    legacy = struct.unpack_from("<I", raw, 107)[0]
    returns: tuple[int, ...] = struct.unpack_from("<5I", raw, 111)
    if minor < 4:
        return legacy, returns
    count = struct.unpack_from("<Q", raw, 247)[0]
    if legacy not in (0, count) and count != 0:
        raise source.error(f"it counts {legacy} points and also {count}", "bytes 107 and 247", _LIES)
    return count or legacy, struct.unpack_from("<15Q", raw, 255) if count else returns


def _bounds(source: Source, header: LasHeader, extremes: Floats) -> Floats | None:
    """Return the box of the header (stored as max x, min x, max y, ...), None where nobody filled it in."""
    high, low = extremes[0::2], extremes[1::2]
    if header.count == 0 or not (extremes != 0.0).any():
        return None
    if not np.isfinite(extremes).all() or (low > high).any():
        raise source.error(f"its box from {low.tolist()} to {high.tolist()} cannot be", "byte 179", _LIES)
    return np.stack([low, high])


def _read_records(source: Source, header: LasHeader, size: int, count: int) -> None:
    at, start = size, header.start
    source.stream.seek(at)
    for i in range(count):
        if at + _RECORD > start:
            raise source.error(f"it announces {count} records, {i} lie before the points", f"byte {at}", _LIES)
        user, number, length, text = struct.unpack("<2x16sHH32s", source.stream.read(_RECORD).ljust(_RECORD, b"\0"))
        at += _RECORD + length
        if at > start:
            raise source.error(f"record {i} runs into the points", f"byte {at - length}", _LIES)
        data = source.stream.read(length)
        if len(data) < length:
            raise source.error("the file ends within its records", f"byte {source.size}", _CUT)
        header.records.append(Record(_text(user), number, _text(text), data))


def _read_long_records(source: Source, header: LasHeader, at: int, count: int) -> None:
    """Read the extended records behind the points; the long ones are only noted with their place."""
    if count == 0:
        return
    if at < header.start or at + count * _LONG_RECORD > source.size:
        raise source.error(
            f"it announces {count} extended records from byte {at}, the file has {source.size} bytes", "byte 235", _CUT
        )
    header.end = at
    for i in range(count):
        if at + _LONG_RECORD > source.size:
            raise source.error(f"extended record {i} lies beyond the end", f"byte {at}", _CUT)
        source.stream.seek(at)
        user, number, length, text = struct.unpack("<2x16sHQ32s", source.stream.read(_LONG_RECORD))
        at += _LONG_RECORD
        if at + length > source.size:
            raise source.error(f"extended record {i} of {length} bytes runs beyond the end", f"byte {at}", _CUT)
        header.long_records.append((_text(user), number, at, length))
        if length <= _LONGEST_EVLR and _text(user) != COPC_INFO[0]:
            header.records.append(Record(_text(user), number, _text(text), source.stream.read(length)))
        at += length


def _check_length(source: Source, header: LasHeader) -> None:
    """Compare the number of points with the bytes between the header and what follows them."""
    waves = 0
    if header.version >= 3 and header.fixed["encoding"] & 2:
        waves = struct.unpack("<Q", source.head(WITH_WAVES)[227:])[0]
    if header.start < waves < header.end:
        header.end = waves
    there, needed = header.end - header.start, header.count * header.record
    if needed > there:
        raise source.error(
            f"its header announces {header.count} points of {header.record} bytes, {there // header.record} are there",
            f"byte {header.end}", _CUT,
        )  # fmt: skip
    if there - needed >= header.record:
        raise source.error(
            f"its header announces {header.count} points, and {there - needed} bytes follow them",
            f"byte {header.start + needed}", _LIES,
        )  # fmt: skip
    if there > needed:
        header.notes.append(f"{there - needed} bytes behind the last point were passed over")
    header.end = header.start + needed


def _text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode("utf-8", "replace")
