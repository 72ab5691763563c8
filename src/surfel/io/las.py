"""LAS, LAZ and COPC: all point formats, versions 1.0 to 1.4; read in runs, written with the last stored digit.

The header, the layout of records and the COPC tree are read here and checked against the file's size; only the
decompression is done by lazrs.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np

from surfel.io.content import Content, Frame, Head
from surfel.io.copc import info_of, needed, refuse_without_tree
from surfel.io.las_crs import crs_of
from surfel.io.las_header import COPC_INFO, EXTRA_BYTES, LASZIP, LasHeader, read_header
from surfel.io.las_lattice import lattice_of, lattice_within
from surfel.io.las_laz import batches, packed
from surfel.io.las_plan import plan_for
from surfel.io.las_points import Columns
from surfel.io.las_write import LasWriter
from surfel.io.options import Options
from surfel.io.select import chosen
from surfel.io.source import Bytes, Source

SELECTS = frozenset({"bounds", "every", "classes", "resolution", "level"})
NEEDS_BOUNDS = True
_RUN = 1 << 25  # bytes of records at a time
_TRUST = 24  # rows are made room for at once while they take no more than so many times the file


def load(source: Source, options: Options | None = None) -> Content:
    """Read points, intensity, returns, classification, colors, time, waveform packets and extra bytes.

    Values have the names that are usual for LAS (``classification``, ``return_number``, ``gps_time``, ...), and the
    types of the file; extra bytes are scaled as they describe it. ``scan_angle_rank`` is in degrees, ``scan_angle``
    (point formats 6 to 10) in 0.006 degrees.

    Raises
    ------
    FileFormatError
        If the header does not fit the file, or compressed points cannot be read or lie out of the header's box.
    InputError
        If a level or a resolution is asked for and the file is no COPC.
    """
    options = options or Options()
    header = read_header(source)
    columns = None
    parts: list[Content] = []
    for first, data in _runs(source, header, options):
        if columns is None or options.asked:
            columns = _columns(header, len(data) if options.asked else _room(source, header, len(data)))
        columns.add(source, data, first)
        if options.asked:
            parts.append(chosen(columns.content(_frame(header), []), options.without(("level", "resolution")), first))
    if parts:
        return _joined(parts, header)
    if columns is None:
        columns = _columns(header, 0)
        return chosen(columns.content(_frame(header), header.notes), options.without(("level", "resolution")))
    content = columns.content(_frame(header), header.notes)
    content.notes += _remarks(content)
    return content


def chunks(source: Source, size: int, options: Options | None = None) -> Iterator[Content]:
    """Read run after run of at most ``size`` points.

    Raises
    ------
    FileFormatError, InputError
        As :func:`load` does.
    """
    options = options or Options()
    rest = options.without(("level", "resolution"))
    header = read_header(source)
    frame = _frame(header)
    empty = True
    for first, data in _runs(source, header, options, size):
        for start in range(0, len(data), size * header.record):
            run = data[start : start + size * header.record]
            columns = _columns(header, len(run))
            columns.add(source, run, first + start // header.record)
            yield chosen(columns.content(frame, list(header.notes)), rest, first + start // header.record)
            empty = False
    if empty:
        yield chosen(_columns(header, 0).content(frame, list(header.notes)), rest)


def head(source: Source) -> Head:
    """Tell what the header says; the points are not looked at.

    Raises
    ------
    FileFormatError
        If the header does not fit the file.
    """
    header = read_header(source)
    if header.packed:
        packed(source, header)
    tree = info_of(source, header) if header.packed else None
    empty = _columns(header, 0).content(_frame(header), [])
    facts: dict[str, object] = {
        "version": f"1.{header.version}", "point_format": header.format, "compressed": header.packed,
        "returns": list(header.returns), "scale": list(header.scale), "offset": list(header.offset),
    }  # fmt: skip
    if tree is not None:
        facts["copc"] = {"spacing": tree.spacing, "center": tree.center.tolist(), "half": tree.half}
    return Head(
        points=header.count, normals=empty.normals is not None, bounds=header.bounds, radii=empty.radii is not None,
        colors=empty.colors is not None, attributes=list(empty.attributes), frame=empty.frame, notes=header.notes,
        facts=facts,
    )  # fmt: skip


def save(stream: BinaryIO, content: Content, *, ascii: bool = False, suffix: str = ".las") -> list[str]:
    """Write LAS, or LAZ where the suffix says so.

    A cloud that came from a LAS file keeps its point format, its scale and offset and its records. Colors become 16-bit
    words; normals, radii and all attributes that LAS has no field for become extra bytes.
    """
    plan = plan_for(content, whole=True)
    assert plan is not None  # only what is seen in part can be undecided
    scale, offset = lattice_of(content.points, content.frame)
    writer = LasWriter(
        stream, plan, scale, offset, suffix == ".laz", content, 4 if len(content.points) >= 1 << 32 else 2
    )
    writer.add(content)
    writer.close()
    return writer.lost + _lost_faces(content)


def writer(stream: BinaryIO, first: Content, head: Head, *, suffix: str) -> LasWriter | None:
    """Return what writes run after run, or None where the types of the first run do not say what later ones need."""
    plan = plan_for(first, whole=False)
    if plan is None:
        return None
    box = head.bounds if head.bounds is not None else np.zeros((2, 3))
    scale, offset = lattice_within(box, first.frame)
    many = head.points is None or head.points >= 1 << 32
    return LasWriter(stream, plan, scale, offset, suffix == ".laz", first, 4 if many else 2)


def _runs(source: Source, header: LasHeader, options: Options, size: int = 1 << 62) -> Iterator[tuple[int, Bytes]]:
    """Yield the number of the first record of a run and its bytes."""
    if not header.packed:
        refuse_without_tree(options)
        step = max(1, min(size, _RUN // header.record))
        source.stream.seek(header.start)
        for first in range(0, header.count, step):
            yield first, source.take(min(step, header.count - first) * header.record)
        return
    how = packed(source, header)
    tree = info_of(source, header)
    if tree is None:
        refuse_without_tree(options)
    wanted = how.chunks if tree is None else needed(source, header, tree, how.chunks, options)
    yield from batches(source, header, how, wanted)


def _columns(header: LasHeader, size: int) -> Columns:
    """Return empty columns with room for so many bytes of records."""
    return Columns(header, size // header.record)


def _room(source: Source, header: LasHeader, run: int) -> int:
    """Return for how many bytes of records to make room: for all, unless few bytes promise very many."""
    return max(run, min(header.count * header.record, _TRUST * source.size))


def _frame(header: LasHeader) -> Frame:
    las = {
        "format": header.format,
        "version": header.version,
        "records": [
            r for r in header.records if (r.user, r.number) not in (LASZIP, EXTRA_BYTES) and r.user != COPC_INFO[0]
        ],
        "extras": {extra.field.name: extra for extra in header.extras},
        "encoding": header.fixed["encoding"],
        "fixed": {name: value for name, value in header.fixed.items() if name != "encoding"},
    }
    return Frame(header.scale, header.offset, crs_of(header.records), {"las": las})


def _remarks(content: Content) -> list[str]:
    """Return what somebody who uses the points should know."""
    notes = []
    withheld = content.attributes.get("withheld")
    if withheld is not None and withheld.dtype == np.uint8 and withheld.any():
        notes.append(f"points flagged as withheld, and kept: {int(np.count_nonzero(withheld))}")
    if content.colors is not None and len(content.colors) and 0 < content.colors.max() <= 255:
        notes.append("colors are no larger than 255, as if they were bytes; LAS means 65535 to be white")
    return notes


def _joined(parts: list[Content], header: LasHeader) -> Content:
    def together(arrays: list[Any]) -> Any:
        return None if arrays[0] is None else np.concatenate(arrays)

    attributes = {name: together([part.attributes[name] for part in parts]) for name in parts[0].attributes}
    return Content(
        together([part.points for part in parts]), None, together([part.normals for part in parts]),
        together([part.radii for part in parts]), together([part.colors for part in parts]), attributes, header.notes,
        parts[0].frame,
    )  # fmt: skip


def _lost_faces(content: Content) -> list[str]:
    return [] if content.triangles is None else [f"{len(content.triangles)} triangles"]
