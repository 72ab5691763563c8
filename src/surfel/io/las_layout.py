"""Point records of LAS: the fields of the eleven point formats and the extra bytes behind them.

Source: ASPRS LAS Specification 1.4 - R15, tables 6 to 17 (point data records 0 to 10) and 24, 25 (extra bytes).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

COLORS = ("red", "green", "blue")
UNDOCUMENTED = "extra_bytes"
DESCRIPTOR = 192
"""Bytes of one description of an extra field."""


@dataclass(frozen=True)
class Field:
    """One value of a point record: ``dtype`` at byte ``offset``, or some bits of that byte."""

    name: str
    dtype: str
    offset: int
    shift: int = 0
    bits: int = 0
    width: int = 1  # how many values lie side by side

    @property
    def type(self) -> np.dtype:
        """What the record holds at ``offset``."""
        return np.dtype((self.dtype, (self.width,))) if self.width > 1 else np.dtype(self.dtype)

    @property
    def largest(self) -> int:
        """The largest whole number that fits."""
        return (1 << self.bits) - 1 if self.bits else int(np.iinfo(self.dtype).max)


@dataclass(frozen=True)
class Extra:
    """An extra field: its place, and how its raw numbers become values (value = raw * scale + offset)."""

    field: Field
    scale: float | None = None
    offset: float = 0.0
    descriptor: bytes = b""


def _run(start: int, *items: tuple[str, str]) -> tuple[tuple[Field, ...], int]:
    fields = []
    for name, dtype in items:
        fields.append(Field(name, dtype, start))
        start += np.dtype(dtype).itemsize
    return tuple(fields), start


_LEGACY = (
    Field("intensity", "<u2", 12),
    Field("return_number", "u1", 14, 0, 3),
    Field("number_of_returns", "u1", 14, 3, 3),
    Field("scan_direction_flag", "u1", 14, 6, 1),
    Field("edge_of_flight_line", "u1", 14, 7, 1),
    Field("classification", "u1", 15, 0, 5),
    Field("synthetic", "u1", 15, 5, 1),
    Field("key_point", "u1", 15, 6, 1),
    Field("withheld", "u1", 15, 7, 1),
    Field("scan_angle_rank", "i1", 16),
    Field("user_data", "u1", 17),
    Field("point_source_id", "<u2", 18),
)
_EXTENDED = (
    Field("intensity", "<u2", 12),
    Field("return_number", "u1", 14, 0, 4),
    Field("number_of_returns", "u1", 14, 4, 4),
    Field("synthetic", "u1", 15, 0, 1),
    Field("key_point", "u1", 15, 1, 1),
    Field("withheld", "u1", 15, 2, 1),
    Field("overlap", "u1", 15, 3, 1),
    Field("scanner_channel", "u1", 15, 4, 2),
    Field("scan_direction_flag", "u1", 15, 6, 1),
    Field("edge_of_flight_line", "u1", 15, 7, 1),
    Field("classification", "u1", 16),
    Field("user_data", "u1", 17),
    Field("scan_angle", "<i2", 18),
    Field("point_source_id", "<u2", 20),
    Field("gps_time", "<f8", 22),
)
_TIME = (("gps_time", "<f8"),)
_COLORS = tuple((name, "<u2") for name in COLORS)
_NIR = (("nir", "<u2"),)
WAVES = (
    ("wavepacket_index", "u1"), ("wavepacket_offset", "<u8"), ("wavepacket_size", "<u4"),
    ("return_point_wave_location", "<f4"), ("x_t", "<f4"), ("y_t", "<f4"), ("z_t", "<f4"),
)  # fmt: skip
_BEHIND: tuple[tuple[tuple[str, str], ...], ...] = (
    (), _TIME, _COLORS, _TIME + _COLORS, _TIME + WAVES, _TIME + _COLORS + WAVES,
    (), _COLORS, _COLORS + _NIR, WAVES, _COLORS + _NIR + WAVES,
)  # fmt: skip
_FIRST_EXTENDED = 6
CHANNEL_FORMATS = (9, 10)
"""Point formats with waveform packets whose compressed form lazrs gets wrong where scanner channels alternate."""


def _format(number: int) -> tuple[tuple[Field, ...], int]:
    base, size = (_LEGACY, 20) if number < _FIRST_EXTENDED else (_EXTENDED, 30)
    behind, length = _run(size, *_BEHIND[number])
    return base + behind, length


_FORMATS = tuple(_format(number) for number in range(11))


def fields_of(number: int) -> tuple[Field, ...]:
    """Return the fields of a point format besides X, Y and Z, which are three int32 at its beginning."""
    return _FORMATS[number][0]


def length_of(number: int) -> int:
    """Return how many bytes a point format has without extra bytes."""
    return _FORMATS[number][1]


def extended(number: int) -> bool:
    """Tell whether it is one of the formats that came with LAS 1.4."""
    return number >= _FIRST_EXTENDED


_SCALARS = ("", "u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f4", "<f8")
_NO_DATA, _SCALE, _OFFSET = 1, 8, 16


def extras_of(descriptors: bytes, number: int, record: int, taken: Iterable[str]) -> tuple[list[Extra], list[str]]:
    """Return the extra fields of records of ``record`` bytes, and what has to be said about them.

    Parameters
    ----------
    descriptors : bytes
        The descriptions, 192 bytes each.
    number : int
        The point format.
    record : int
        The length of a record; bytes without a description become ``extra_bytes``.
    taken : iterable of str
        Names that are in use.

    Raises
    ------
    ValueError
        If a description has an unknown type, or they need more bytes than a record has.
    """
    names = set(taken)
    extras: list[Extra] = []
    notes: list[str] = []
    at = length_of(number)
    for i in range(0, len(descriptors) - DESCRIPTOR + 1, DESCRIPTOR):
        raw = descriptors[i : i + DESCRIPTOR]
        kind, options = raw[2], raw[3]
        if kind > 30:
            raise ValueError(f"extra field {i // DESCRIPTOR} has the type {kind}; types are 0 to 30")
        width = options if kind == 0 else (kind - 1) // 10 + 1
        dtype = "u1" if kind == 0 else _SCALARS[(kind - 1) % 10 + 1]
        name = _fresh(raw[4:36].split(b"\0")[0].decode("utf-8", "replace").strip() or "extra", names)
        field = Field(name, dtype, at, width=width)
        at += np.dtype(dtype).itemsize * width
        if at > record:
            raise ValueError(
                f"its extra fields need {at - length_of(number)} bytes, a record has {record - length_of(number)}"
            )
        if width == 0:
            continue
        scale, offset = None, 0.0
        if kind != 0 and options & (_SCALE | _OFFSET):
            scale = struct.unpack_from("<d", raw, 112)[0] if options & _SCALE else 1.0
            offset = struct.unpack_from("<d", raw, 136)[0] if options & _OFFSET else 0.0
            if width > 1 or not (np.isfinite(scale) and np.isfinite(offset) and scale != 0.0):
                scale = None
                notes.append(f"the scale of extra field {name!r} was not applied")
        extras.append(Extra(field, scale, offset, raw))
    if at < record:
        extras.append(Extra(Field(_fresh(UNDOCUMENTED, names), "u1", at, width=record - at)))
        notes.append(f"{record - at} extra bytes without a description")
    return extras, notes


def described(name: str, dtype: np.dtype, width: int) -> bytes:
    """Return the description of a new extra field.

    Raises
    ------
    ValueError
        If there is no type for it.
    """
    if not 1 <= width <= 3:
        raise ValueError(f"{width} values side by side")
    kind = _SCALARS.index(dtype.newbyteorder("<").str.lstrip("|")) + 10 * (width - 1)
    return struct.pack("<2xBB32s", kind, 0, clipped(name)).ljust(DESCRIPTOR, b"\0")


def clipped(name: str) -> bytes:
    """Return a name in the 32 bytes that there are for it."""
    return name.encode()[:32].decode("utf-8", "ignore").encode()


def _fresh(name: str, names: set[str]) -> str:
    """Return the name, or the next like it that is not in use, in the form that attributes have."""
    plain = re.sub(r"\s+", "_", name)
    found, number = plain, 1
    while found in names or found in ("x", "y", "z"):
        number += 1
        found = f"{plain}_{number}"
    names.add(found)
    return found
