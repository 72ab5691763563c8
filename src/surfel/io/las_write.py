"""Writing LAS and LAZ, run after run: the header is written last, when everything has been counted."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.io.content import Content
from surfel.io.las_crs import PROJECTION, Record, records_of
from surfel.io.las_header import COPC_INFO, EXTRA_BYTES, LASZIP, NEW, OLD, WITH_WAVES
from surfel.io.las_lattice import lies_on
from surfel.io.las_layout import CHANNEL_FORMATS, COLORS, Field, extended, fields_of
from surfel.io.las_plan import Plan, colors_of, column_of, fitting, stored
from surfel.io.source import Bytes

_RUN = 1 << 18
_MOST = 2**31 - 1
_LONGEST_RECORD = 65535
_WAVES_OUTSIDE, _WKT, _KEPT_BITS = 4, 16, 1 | 8  # kept: the kind of GPS time, synthetic returns


class LasWriter:
    """Writes records behind a place left free for the header.

    Parameters
    ----------
    stream : BinaryIO
        A seekable stream at its beginning.
    plan : Plan
        How columns become records.
    scale, offset : ndarray of float64, shape (3,)
        The lattice of the coordinates.
    packed : bool
        Write LAZ.
    first : Content
        Tells the coordinate system and what else a LAS file said that it came from.
    version : int
        The least version: 4 where more points may come than 32 bits can count.
    """

    def __init__(
        self,
        stream: BinaryIO,
        plan: Plan,
        scale: Floats,
        offset: Floats,
        packed: bool,
        first: Content,
        version: int = 2,
    ) -> None:
        self.lost: list[str] = list(plan.lost)
        self._stream, self._plan, self._packed = stream, plan, packed
        self._scale, self._offset = scale, offset
        self._count = 0
        self._channel: int | None = None
        self._returns = np.zeros(16, np.int64)
        self._low, self._high = np.full(3, _MOST), np.full(3, -_MOST)
        self._before = _before(first)
        needed = 4 if extended(plan.number) else 3 if plan.number >= 4 else 2
        self._version = max(version, needed, int(self._before.get("version", 2)))
        self._records = self._records_for(first)
        self._compressor = _Compressor(plan) if packed else None
        if self._compressor is not None:
            self._records.append(Record(*LASZIP, "", self._compressor.record))
        stream.write(self._header())
        if self._compressor is not None:
            self._compressor.start(stream)

    def add(self, content: Content) -> None:
        """Write points.

        Raises
        ------
        InputError
            If a coordinate does not fit into 32 bits, or a value into its field.
        """
        for first in range(0, len(content.points), _RUN):
            data = self._records_of(content.rows(slice(first, first + _RUN)))
            if self._compressor is None:
                self._stream.write(data.data)
            else:
                self._compressor.add(data)

    def close(self) -> None:
        """Finish the points and write the header with their number and box."""
        if self._compressor is not None:
            self._compressor.close()
        self._stream.seek(0)
        self._stream.write(self._header())
        self._stream.seek(0, 2)

    def _records_of(self, content: Content) -> Bytes:
        table = np.zeros((len(content.points), self._plan.record), np.uint8)
        whole = np.rint((content.points - self._offset) / self._scale)
        if not (np.abs(whole) <= _MOST).all():
            raise InputError("a coordinate lies too far out for the steps of this LAS file; write the points at once")
        if not lies_on(content.points, self._scale, self._offset):
            self._say(f"digits of the coordinates beyond steps of {', '.join(f'{s:g}' for s in self._scale)}")
        for axis in range(3):
            _put(table, Field("xyz"[axis], "<i4", 4 * axis), whole[:, axis])
        self._low = np.minimum(self._low, whole.min(axis=0)).astype(np.int64)
        self._high = np.maximum(self._high, whole.max(axis=0)).astype(np.int64)
        if self._packed:
            self._refuse_channels(content)
        held = {name for name, _ in self._plan.fields}
        for name, field in self._plan.fields:
            values = content.attributes[name]
            if np.dtype(field.dtype).kind != "f" and not fitting(values, field.dtype, field.largest):
                raise InputError(f"a value of {name!r} does not fit its field of LAS; write the points at once")
            _put(table, field, values)
        self._put_rest(table, content, held)
        self._count += len(table)
        returns = table[:, 14] & (15 if extended(self._plan.number) else 7)
        self._returns += np.bincount(np.maximum(returns, 1), minlength=16)  # 0 is no return: it counts as the first
        return table.reshape(-1)

    def _refuse_channels(self, content: Content) -> None:
        """Refuse what lazrs (0.8) would write wrongly: waveform packets of more than one scanner channel."""
        channels = content.attributes.get("scanner_channel")
        if self._plan.number not in CHANNEL_FORMATS or channels is None or len(channels) == 0:
            return
        self._channel = int(channels[0]) if self._channel is None else self._channel
        if (channels != self._channel).any():
            raise InputError("the compressor of LAZ garbles waveform packets of several scanner channels; write .las")

    def _put_rest(self, table: NDArray[np.uint8], content: Content, held: set[str]) -> None:
        """Put in what is no attribute of that name: a single return where none is told, colors, extra fields."""
        fields = {field.name: field for field in fields_of(self._plan.number)}
        for name in ("return_number", "number_of_returns"):
            if name not in held:
                _put(table, fields[name], np.ones(len(table), np.uint8))
        if COLORS[0] in fields:
            words = colors_of(content, self.lost)
            for i, name in enumerate(COLORS):
                _put(table, fields[name], words[:, i])
        for attribute, column, extra in self._plan.extras:
            values = stored(column_of(content, attribute, column, extra.field.name), extra)
            if extra.scale is not None and not fitting(values, extra.field.dtype):
                raise InputError(f"a value of {attribute!r} does not fit its field of LAS; write the points at once")
            _put(table, extra.field, values)

    def _records_for(self, first: Content) -> list[Record]:
        """Return the records for the header: those it came with, the coordinate system, the extra fields."""
        known = [r for r in self._before.get("records", []) if isinstance(r, Record)]
        records = [r for r in known if (r.user, r.number) not in (LASZIP, EXTRA_BYTES) and r.user != COPC_INFO[0]]
        crs = first.frame.crs if first.frame is not None else ""
        if not any(record.user == PROJECTION for record in records):
            records = records_of(crs) + records
        for record in [r for r in records if len(r.data) > _LONGEST_RECORD]:
            self._say(f"the record {record.user} {record.number} of {len(record.data)} bytes")
            records.remove(record)
        if self._plan.descriptors:
            records.append(Record(*EXTRA_BYTES, "extra bytes", self._plan.descriptors))
        return records

    def _header(self) -> bytes:
        records = b"".join(_record(r) for r in self._records)
        fixed: Mapping[str, bytes] = self._before.get("fixed", {})
        size = NEW if self._version == 4 else WITH_WAVES if self._version == 3 else OLD
        encoding = int(self._before.get("encoding", 0)) & _KEPT_BITS
        encoding |= _WKT if self._version == 4 and any(r[:2] == (PROJECTION, 2112) for r in self._records) else 0
        encoding |= _WAVES_OUTSIDE if any(name == "wavepacket_index" for name, _ in self._plan.fields) else 0
        # point formats of 1.4 have no legacy counts, and neither have more points than 32 bits can count
        old = not extended(self._plan.number) and self._count < 1 << 32
        if not old and self._version < 4:
            raise InputError(
                "there are more points than were announced, and LAS 1.4 is needed for them; write them at once"
            )
        low, high = [axis * self._scale + self._offset for axis in (self._low, self._high)]
        if self._count == 0:
            low, high = np.zeros(3), np.zeros(3)
        low, high = np.minimum(low, high), np.maximum(low, high)
        raw = struct.pack(
            "<4s2sH16sBB32s32s4sHIIBHI5I12d", b"LASF", fixed.get("source_id", b""), encoding, fixed.get("guid", b""), 1,
            self._version, fixed.get("system", b""), b"surfel", fixed.get("created", b""), size, size + len(records),
            len(self._records), self._plan.number | (0x80 if self._packed else 0), self._plan.record,
            self._count if old else 0, *(self._returns[1:6] if old else [0] * 5), *self._scale, *self._offset,
            *np.stack([high, low], axis=1).reshape(-1),
        )  # fmt: skip
        if self._version >= 3:
            raw += struct.pack("<Q", 0)
        if self._version >= 4:
            raw += struct.pack("<QIQ15Q", 0, 0, self._count, *self._returns[1:16])
        return raw + records

    def _say(self, what: str) -> None:
        if what not in self.lost:
            self.lost.append(what)


class _Compressor:
    """lazrs behind a stream that remembers why a write failed: a full disk must not look like a damaged file."""

    def __init__(self, plan: Plan) -> None:
        import lazrs

        bare = sum(extra.field.type.itemsize for _, _, extra in plan.extras)
        self._record = lazrs.LazVlr.new_for_compression(plan.number, bare)
        self.record: bytes = bytes(self._record.record_data())

    def start(self, stream: BinaryIO) -> None:
        import lazrs

        self._stream = _Remembering(stream)
        self._packer = self._tried(lambda: lazrs.ParLasZipCompressor(self._stream, self._record))

    def add(self, data: Bytes) -> None:
        if len(data):
            self._tried(lambda: self._packer.compress_many(data))

    def close(self) -> None:
        self._tried(self._packer.done)

    def _tried(self, work: Callable[[], Any]) -> Any:
        try:
            result = work()
        except BaseException:
            if self._stream.error is not None:
                raise self._stream.error from None
            raise
        if self._stream.error is not None:
            raise self._stream.error
        return result


class _Remembering:
    """A stream that keeps the first error of its writes."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self.error: BaseException | None = None

    def write(self, data: bytes) -> int:
        try:
            return self._stream.write(data)
        except BaseException as error:
            self.error = error
            raise

    def seek(self, place: int, whence: int = 0) -> int:
        return self._stream.seek(place, whence)

    def tell(self) -> int:
        return self._stream.tell()

    def flush(self) -> None:
        self._stream.flush()


def _before(content: Content) -> Mapping[str, Any]:
    found = content.frame.extra.get("las") if content.frame is not None else None
    return found if isinstance(found, Mapping) else {}


def _record(record: Record) -> bytes:
    head = struct.pack(
        "<2x16sHH32s", record.user.encode(), record.number, len(record.data), record.description.encode()
    )
    return head + record.data


def _put(table: NDArray[np.uint8], field: Field, values: NDArray[Any]) -> None:
    """Write one column into its place in the records."""
    if field.bits:
        table[:, field.offset] |= values.astype(np.uint8) << field.shift
        return
    raw = np.ascontiguousarray(values.astype(field.dtype)).reshape(len(table), field.width)
    table[:, field.offset : field.offset + field.type.itemsize] = raw.view(np.uint8).reshape(len(table), -1)
