"""The compressed points of a LAZ file, chunk by chunk: every size is checked before the decompressor sees it.

What lazrs decompresses is checked afterwards as well (the box of the header, in ``las_points``). The chunks of point
formats 6 to 10 tell the size of each of their layers, which has to add up. What cannot be detected: damage within one
layer of such a chunk that leaves its numbers plausible (LAZ has no checksums).

Source: M. Isenburg, "LASzip: lossless compression of LiDAR data", Photogrammetric Engineering & Remote Sensing 79
(2013); LAZ specification 1.4 - R1, chapters 4 and 8.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from surfel.core.errors import FileFormatError
from surfel.io.las_header import LASZIP, LasHeader
from surfel.io.source import Bytes, Source

VARIABLE = 0xFFFFFFFF
_BATCH = 1 << 25  # bytes of decompressed points at a time: many chunks, which lazrs shares out to threads
_PIECE = 1 << 20  # points at a time out of a single chunk that is larger than a batch
_DAMAGED = "the compressed points were damaged; fetch the file again"
_POINT10, _TIME, _RGB, _WAVE, _BYTE = (6, 20), (7, 8), (8, 6), (9, 29), 0
_POINT14, _RGB14, _RGBNIR14, _WAVE14, _BYTE14 = (10, 30), (11, 6), (12, 8), (13, 29), 14
_ITEMS = (
    (_POINT10,), (_POINT10, _TIME), (_POINT10, _RGB), (_POINT10, _TIME, _RGB), (_POINT10, _TIME, _WAVE),
    (_POINT10, _TIME, _RGB, _WAVE), (_POINT14,), (_POINT14, _RGB14), (_POINT14, _RGBNIR14), (_POINT14, _WAVE14),
    (_POINT14, _RGBNIR14, _WAVE14),
)  # fmt: skip
_LAYERS = {_POINT14: 9, _RGB14: 1, _RGBNIR14: 2, _WAVE14: 1}


class Chunk(NamedTuple):
    """One run of points that is decompressed by itself."""

    first: int
    points: int
    at: int
    size: int


@dataclass
class Packed:
    """How the points of a file are compressed: the record that says so, and where each chunk lies."""

    record: bytes
    layers: int  # 0 where the points are not in layers
    chunks: list[Chunk]


def packed(source: Source, header: LasHeader) -> Packed:
    """Return where the compressed chunks of a file lie.

    Raises
    ------
    FileFormatError
        If the table of chunks does not fit the file or the number of points.
    """
    record = header.data_of(LASZIP)
    if record is None:
        raise source.error("its points are compressed, and the record that tells how is not there", "header", _DAMAGED)
    size, layers = _checked_record(source, header, record)
    if header.count == 0:
        return Packed(record, layers, [])
    table, end = _table(source, header, record, size)
    counts, sizes = _counts(source, header, table, size), [entry[1] for entry in table]
    begin = header.start + 8
    if any(s < header.record for s in sizes) or begin + sum(sizes) > end:
        raise source.error(f"the chunks do not fit between byte {begin} and byte {end}", f"byte {end}", _DAMAGED)
    places = begin + np.concatenate([[0], np.cumsum(sizes)])
    firsts = np.concatenate([[0], np.cumsum(counts)])
    if begin + sum(sizes) != end:
        header.notes.append(f"{end - begin - sum(sizes)} bytes behind the last chunk were passed over")
    chunks = [Chunk(int(firsts[i]), counts[i], int(places[i]), sizes[i]) for i in range(len(counts))]
    return Packed(record, layers, chunks)


def batches(source: Source, header: LasHeader, how: Packed, chunks: list[Chunk]) -> Iterator[tuple[int, Bytes]]:
    """Decompress chunks; yield the number of the first point and the records, some megabytes at a time.

    Raises
    ------
    FileFormatError
        At the first chunk that cannot be decompressed.
    """
    run: list[Chunk] = []
    waiting = 0
    for chunk in chunks:
        _check_layers(source, header, how, chunk)
        if chunk.points * header.record > _BATCH:
            yield from _runs(source, header, how, run)
            run, waiting = [], 0
            yield from _pieces(source, header, how, chunk)
            continue
        touching = not run or (run[-1].at + run[-1].size == chunk.at and run[-1].first + run[-1].points == chunk.first)
        if run and (waiting + chunk.points * header.record > _BATCH or not touching):
            yield from _runs(source, header, how, run)
            run, waiting = [], 0
        run.append(chunk)
        waiting += chunk.points * header.record
    yield from _runs(source, header, how, run)


def _checked_record(source: Source, header: LasHeader, record: bytes) -> tuple[int, int]:
    """Return the points of a chunk and the layers, having compared the record with the point format."""
    where = "record 'laszip encoded' 22204"
    if len(record) < 34:
        raise source.error(f"the record has {len(record)} bytes, at least 34 are needed", where, _DAMAGED)
    kind, coder = struct.unpack_from("<HH", record)
    size, number = struct.unpack_from("<I", record, 12)[0], struct.unpack_from("<H", record, 32)[0]
    if len(record) < 34 + 6 * number:
        raise source.error(f"{number} items do not fit into {len(record)} bytes", where, _DAMAGED)
    items = [struct.unpack_from("<3H", record, 34 + 6 * i) for i in range(number)]
    expected = list(_ITEMS[header.format])
    layered = expected[0] == _POINT14
    behind = header.record - sum(item[1] for item in expected)
    if behind:
        expected.append((_BYTE14 if layered else _BYTE, behind))
    if [item[:2] for item in items] != expected or coder != 0:
        raise source.error(f"its items do not make up point format {header.format}", where, _DAMAGED)
    if kind != (3 if layered else 2) or any(item[2] not in ((3, 4) if layered else (1, 2)) for item in items):
        raise source.error(
            f"compressor {kind} with items of version {items[0][2]} is not read", where,
            "compress it anew with a LASzip of version 2 or later, in chunks",
        )  # fmt: skip
    if size == 0:
        raise source.error("its chunks have no points", where, _DAMAGED)
    return size, sum(_LAYERS.get(item, item[1]) for item in expected) if layered else 0


def _table(source: Source, header: LasHeader, record: bytes, size: int) -> tuple[list[tuple[int, int]], int]:
    """Return the table of chunks (points, bytes) and the byte where it lies, behind the last chunk."""
    begin = header.start
    if begin + 8 > source.size:
        raise source.error("the file ends before its compressed points", f"byte {source.size}", _DAMAGED)
    source.stream.seek(begin)
    place = struct.unpack("<q", source.stream.read(8))[0]
    if place == -1:  # written to a pipe: the last eight bytes tell
        source.stream.seek(source.size - 8)
        place = struct.unpack("<q", source.stream.read(8))[0]
    if not begin + 8 <= place <= source.size - 8:
        raise source.error(
            f"the table of its chunks should lie at byte {place}, the file has {source.size} bytes", f"byte {begin}",
            "the file was cut or changed; fetch it again",
        )  # fmt: skip
    source.stream.seek(place)
    version, number = struct.unpack("<II", source.stream.read(8))
    expected = -(-header.count // size) if size != VARIABLE else number
    if version != 0 or number != expected or not 0 < number <= (place - begin) // header.record:
        raise source.error(
            f"the table lists {number} chunks, {header.count} points need {expected}", f"byte {place}", _DAMAGED
        )
    # a chunk's size takes a few bytes in the table: what follows the table is no business of the decompressor
    source.stream.seek(place)
    data = source.stream.read(min(source.size - place, 64 + 16 * number))
    table = _called(
        source, f"byte {place}", lambda lazrs: lazrs.read_chunk_table_only(io.BytesIO(data), lazrs.LazVlr(record))
    )
    return [(int(points), int(length)) for points, length in table], place


def _counts(source: Source, header: LasHeader, table: list[tuple[int, int]], size: int) -> list[int]:
    """Return how many points each chunk has; they have to add up."""
    if size != VARIABLE:
        return [size] * (len(table) - 1) + [header.count - size * (len(table) - 1)]
    counts = [entry[0] for entry in table]
    if sum(counts) != header.count or any(c <= 0 for c in counts):
        raise source.error(
            f"the chunks hold {sum(counts)} points, the header announces {header.count}", "table of chunks", _DAMAGED
        )
    return counts


def _check_layers(source: Source, header: LasHeader, how: Packed, chunk: Chunk) -> None:
    """Compare the sizes that a layered chunk gives with its own: the first point whole, a count, sizes, layers."""
    if not how.layers:
        return
    head = header.record + 4 + 4 * how.layers
    source.stream.seek(chunk.at)
    raw = source.stream.read(min(head, chunk.size))
    if len(raw) == head:
        count, *sizes = struct.unpack_from(f"<{1 + how.layers}I", raw, header.record)
        if count == chunk.points and head + sum(sizes) == chunk.size:
            return
    raise source.error("the layers of a chunk do not fill it", _place(chunk), _DAMAGED)


def _runs(source: Source, header: LasHeader, how: Packed, run: list[Chunk]) -> Iterator[tuple[int, Bytes]]:
    """Decompress chunks that lie one behind the other at once; if that fails, find the one to blame."""
    if not run:
        return
    source.stream.seek(run[0].at)
    data = source.take(sum(chunk.size for chunk in run))
    out = np.empty(sum(chunk.points for chunk in run) * header.record, np.uint8)
    try:
        _decompress(source, how, data, out, run, f"{len(run)} chunks")
    except FileFormatError:
        at = 0
        for chunk in run:
            part = np.empty(chunk.points * header.record, np.uint8)
            _decompress(source, how, data[at : at + chunk.size], part, [chunk], _place(chunk))
            at += chunk.size
        raise
    yield run[0].first, out


def _decompress(source: Source, how: Packed, data: Bytes, out: Bytes, run: list[Chunk], place: str) -> None:
    table = [(chunk.points, chunk.size) for chunk in run]
    _called(
        source, place, lambda lazrs: lazrs.decompress_points_with_chunk_table(data.tobytes(), how.record, out, table)
    )


def _pieces(source: Source, header: LasHeader, how: Packed, chunk: Chunk) -> Iterator[tuple[int, Bytes]]:
    """Decompress one very large chunk piece by piece, so that a lying count meets the end of the data first."""
    source.stream.seek(chunk.at)
    alone = io.BytesIO()
    alone.write(struct.pack("<q", 8 + chunk.size))
    alone.write(source.take(chunk.size).data)
    _called(
        source, _place(chunk),
        lambda lazrs: lazrs.write_chunk_table(alone, [(chunk.points, chunk.size)], lazrs.LazVlr(how.record)),
    )  # fmt: skip
    alone.seek(0)
    reader = _called(source, _place(chunk), lambda lazrs: lazrs.LasZipDecompressor(alone, how.record))
    for first in range(0, chunk.points, _PIECE):
        out = np.empty(min(_PIECE, chunk.points - first) * header.record, np.uint8)
        _called(source, _place(chunk), lambda _, out=out: reader.decompress_many(out))
        yield chunk.first + first, out


def _called(source: Source, place: str, work: Any) -> Any:
    """Call lazrs; what it says about damaged data becomes our error, a panic of its Rust code included."""
    import lazrs

    try:
        return work(lazrs)
    except (lazrs.LazrsError, OSError, ValueError, TypeError, OverflowError) as error:
        raise source.error(f"its compressed points cannot be read ({error})", place, _DAMAGED) from None
    except BaseException as error:  # a panic is none of Exception
        if type(error).__name__ != "PanicException":
            raise
        raise source.error(f"its compressed points cannot be read ({error})", place, _DAMAGED) from None


def _place(chunk: Chunk) -> str:
    return f"points {chunk.first} to {chunk.first + chunk.points - 1}, bytes {chunk.at} to {chunk.at + chunk.size - 1}"
