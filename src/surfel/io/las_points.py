"""Point records of LAS to points and attributes, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.io.columns import NORMALS
from surfel.io.content import Content, Frame
from surfel.io.las_header import LasHeader
from surfel.io.las_layout import CHANNEL_FORMATS, COLORS, Extra, Field, fields_of
from surfel.io.source import Bytes, Source

_BLOCK = 1 << 15  # records at a time: as many as fit into the cache
_CHANNELS = "waveform packets of several scanner channels in LAZ: lazrs may have unpacked them wrongly"
_OUTSIDE = "points lie outside of the box that the header gives"


class Columns:
    """The columns of a file, filled run after run; they grow where the header may promise more than there is.

    Parameters
    ----------
    header : LasHeader
        Tells which columns there are.
    rows : int
        How many rows to make room for.
    """

    def __init__(self, header: LasHeader, rows: int) -> None:
        self.header = header
        self.rows = 0
        self._room = rows
        self._fields = fields_of(header.format)
        self._arrays: dict[str, NDArray[Any]] = {"points": np.empty((rows, 3))}
        if COLORS[0] in {f.name for f in self._fields}:
            self._arrays["colors"] = np.empty((rows, 3), np.uint16)
        for field in self._fields:
            if field.name not in COLORS:
                self._arrays[field.name] = np.empty(rows, field.type.newbyteorder("="))
        for extra in header.extras:
            self._arrays[extra.field.name] = np.empty((rows, *extra.field.type.shape), _type_of(extra))

    def add(self, source: Source, data: Bytes, first: int) -> None:
        """Append records; ``first`` is the number of the first, for errors."""
        from surfel.io.las_unpack import coordinates  # on first use, because it has a kernel

        count = len(data) // self.header.record
        self._make_room(count)
        points = self._arrays["points"][self.rows : self.rows + count]
        low, high = coordinates(data, self.header, points)
        self._check_box(source, low, high, first, count)
        table = data[: count * self.header.record].reshape(count, self.header.record)
        for start in range(0, count, _BLOCK):
            self._fill(table[start : start + _BLOCK], self.rows + start)
        self.rows += count
        self._warn_of_channels(count)

    def _fill(self, table: NDArray[np.uint8], start: int) -> None:
        """Take all fields but the coordinates out of a few records, while these lie in the processor's cache."""
        here = slice(start, start + len(table))
        for field in self._fields:
            if field.name in COLORS:
                self._arrays["colors"][here, COLORS.index(field.name)] = values_of(table, field)
            else:
                self._arrays[field.name][here] = values_of(table, field)
        for extra in self.header.extras:
            raw = values_of(table, extra.field)
            self._arrays[extra.field.name][here] = raw if extra.scale is None else raw * extra.scale + extra.offset

    def content(self, frame: Frame, notes: list[str]) -> Content:
        """Return what was filled in so far."""
        arrays = {name: array[: self.rows] for name, array in self._arrays.items()}
        content = Content(arrays.pop("points"), colors=arrays.pop("colors", None), notes=notes, frame=frame)
        lower = {name.lower(): name for name in arrays}
        for group in NORMALS:
            if set(group) <= lower.keys():
                content.normals = np.stack([arrays.pop(lower[n]).astype(np.float64) for n in group], axis=1)
                break
        if "radius" in arrays and arrays["radius"].ndim == 1:
            content.radii = arrays.pop("radius").astype(np.float64)
        content.attributes = arrays
        return content

    def _warn_of_channels(self, count: int) -> None:
        channels = self._arrays.get("scanner_channel")
        if self.header.packed and self.header.format in CHANNEL_FORMATS and channels is not None and count:
            here = channels[self.rows - count : self.rows]
            if (here != here[0]).any() and _CHANNELS not in self.header.notes:
                self.header.notes.append(_CHANNELS)

    def _make_room(self, count: int) -> None:
        if self.rows + count > self._room:
            self._room = max(self.rows + count, 2 * self._room)
            for name, array in self._arrays.items():
                grown = np.empty((self._room, *array.shape[1:]), array.dtype)
                grown[: self.rows] = array[: self.rows]
                self._arrays[name] = grown

    def _check_box(self, source: Source, low: Floats, high: Floats, first: int, count: int) -> None:
        """Compare points with the box of the header.

        What damage unpacks to lies far out, as a rule, so compressed points have to lie in the box. Of others damage
        would move single ones; tools that do not keep the box up to date are more common. Only if none of them can be
        in the box, it is an error, because then the scale or the offset is wrong.
        """
        box = self.header.bounds
        if box is None or count == 0:
            return
        slack = 2.0 * np.abs(self.header.scale) + 2e-7 * np.abs(box).max(axis=0)  # some tools keep the box in float32
        if (low >= box[0] - slack).all() and (high <= box[1] + slack).all():
            return
        if self.header.packed or (low > box[1] + slack).any() or (high < box[0] - slack).any():
            raise source.error(
                f"points reach from {low.tolist()} to {high.tolist()}, out of the box of the header, "
                f"{box[0].tolist()} to {box[1].tolist()}",
                f"points {first} to {first + count - 1}",
                "the file was damaged: fetch it again; if its header is wrong, mend it with: lasinfo -repair",
            )  # fmt: skip
        if _OUTSIDE not in self.header.notes:
            self.header.notes.append(_OUTSIDE)


def values_of(table: NDArray[np.uint8], field: Field) -> NDArray[Any]:
    """Return one field of records, shape (n,) or (n, width)."""
    if field.bits:
        byte = table[:, field.offset]
        low = byte >> field.shift if field.shift else byte
        return low if field.shift + field.bits == 8 else low & ((1 << field.bits) - 1)
    size = field.type.itemsize
    if size == 1:
        return table[:, field.offset].view(field.dtype)
    record = table.shape[1]
    return np.ndarray(
        (len(table), *field.type.shape), field.dtype, table, field.offset,
        (record,) if field.width == 1 else (record, np.dtype(field.dtype).itemsize),
    )  # fmt: skip


def _type_of(extra: Extra) -> np.dtype[Any]:
    return np.dtype(np.float64) if extra.scale is not None else np.dtype(extra.field.dtype).newbyteorder("=")
