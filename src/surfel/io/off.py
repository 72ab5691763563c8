"""OFF (Geomview): counts, vertices (with normals or colors behind them), polygons."""

from __future__ import annotations

import re
from typing import BinaryIO

import numpy as np

from surfel.core.cast import Floats
from surfel.io.columns import content_of_table
from surfel.io.content import Content
from surfel.io.obj import write_rows
from surfel.io.polygons import fans
from surfel.io.rows import NEWLINE, RETURN, RowError, Rows, line_of, located, parse_rows
from surfel.io.source import Bytes, Source

_KEYWORD = re.compile(rb"(ST)?(C)?(N)?OFF")
_CURE = "the file was cut or changed; fetch it again"


def load(source: Source) -> Content:
    """Read an OFF file: ``OFF``, ``COFF``, ``NOFF`` and their kin, in text.

    Colors of faces are passed over; polygons become fans of triangles.

    Raises
    ------
    FileFormatError
        If the counts do not fit what follows, or a face names a vertex that is not there.
    """
    data = source.rest()
    newline = RETURN if not (data == NEWLINE).any() and (data == RETURN).any() else NEWLINE
    keyword, at = _keyword(source, data, newline)
    counts = _rows(source, data, at, (0, 0), 1, newline, "the counts of its header", loose=True)
    vertices, faces = _counts(source, counts.values[0], len(data) - counts.end)
    width = _first_width(data, counts.end, newline) if vertices else 3
    if vertices and width < 3:
        raise source.error(
            f"the first vertex has {width} numbers", f"line {line_of(data, counts.end, newline) + 1}", _CURE
        )
    points = _rows(source, data, counts.end, (0,) * width, vertices, newline, "vertex")
    polygons = _rows(source, data, points.end, (2,), faces, newline, "face", loose=True)
    _check_end(source, data, polygons.end, newline)
    content = _content(points.values, keyword)
    if len(polygons.items) and not (polygons.items.min() >= 0 and polygons.items.max() < vertices):
        wrong = int(np.flatnonzero((polygons.items < 0) | (polygons.items >= vertices))[0])
        face = int(np.searchsorted(np.cumsum(polygons.lengths), wrong, side="right"))
        raise source.error(f"a face names vertex {int(polygons.items[wrong])} of {vertices}", f"face {face}", _CURE)
    if faces:
        small = int((polygons.lengths < 3).sum())
        if small:
            content.notes.append(f"{small} faces of fewer than three corners were passed over")
        if (polygons.lengths > 3).any():
            many = int((polygons.lengths > 3).sum())
            content.notes.append(f"{many} polygons were cut into fans of triangles")
        content.triangles = fans(polygons.items, polygons.lengths)
    return content


def save(stream: BinaryIO, content: Content, *, ascii: bool = True, suffix: str = ".off") -> list[str]:
    """Write vertices, with their normals if there are any (``NOFF``), and triangles."""
    columns = [content.points[:, i] for i in range(3)]
    if content.normals is not None:
        columns += [content.normals[:, i] for i in range(3)]
    faces = content.triangles if content.triangles is not None else np.empty((0, 3), np.int64)
    stream.write(f"{'OFF' if content.normals is None else 'NOFF'}\n{len(content.points)} {len(faces)} 0\n".encode())
    write_rows(stream, "", columns)
    write_rows(stream, "3 ", [faces[:, i] for i in range(3)])
    return content.lost_without("normals", "triangles")


def _keyword(source: Source, data: Bytes, newline: int) -> tuple[bytes, int]:
    """Return the first word and where the counts begin (they may stand on its line)."""
    head = data[:4096].tobytes()
    start = 3 if head.startswith(b"\xef\xbb\xbf") else 0
    for line in head[start:].split(bytes([newline])):
        words = line.split(b"#")[0].split()
        if words:
            if not _KEYWORD.fullmatch(words[0]):
                shown = words[0][:20].decode("ascii", "backslashreplace")
                raise source.error(
                    f"it begins with {shown!r} instead of OFF", f"line {line_of(data, start, newline)}",
                    "four-dimensional and nameless OFF files are not read",
                )  # fmt: skip
            if len(words) > 1 and words[1].upper() == b"BINARY":
                raise source.error("it is a binary OFF file", "line 1", "convert it to text OFF or to PLY")
            return words[0], head.index(words[0], start) + len(words[0])
        start += len(line) + 1
    raise source.error("it holds only comments", "byte 0", _CURE)


def _counts(source: Source, values: Floats, left: int) -> tuple[int, int]:
    """Return the counts of vertices and faces; a record takes at least two bytes."""
    for what, value in zip(("vertices", "faces"), values.tolist(), strict=True):
        if not (value >= 0 and value == np.floor(value)) or 2 * value > left + 2:
            raise source.error(f"its header announces {value:g} {what}, {left} bytes follow", "header", _CURE)
    return int(values[0]), int(values[1])


def _first_width(data: Bytes, at: int, newline: int) -> int:
    """Return how many numbers the first vertex has."""
    while at < len(data):
        stop = at + int((np.flatnonzero(data[at : at + 65536] == newline)[:1].tolist() or [65536])[0])
        words = data[at:stop].tobytes().split(b"#")[0].split()
        if words:
            return len(words)
        at = stop + 1
    return 3


def _rows(
    source: Source,
    data: Bytes,
    at: int,
    layout: tuple[int, ...],
    count: int,
    newline: int,
    what: str,
    loose: bool = False,
) -> Rows:
    try:
        return parse_rows(data, at, layout, rows=count, newline=newline, comments=True, loose=loose)
    except RowError as error:
        raise located(source, data, error, newline, what) from None


def _check_end(source: Source, data: Bytes, at: int, newline: int) -> None:
    try:
        more = len(parse_rows(data, at, (0,), newline=newline, comments=True, loose=True).values)
    except RowError:
        more = 1
    if more:
        line = line_of(data, at, newline) + 1
        raise source.error("there are more lines than the header announces", f"line {line}", "its counts are wrong")


def _content(values: Floats, keyword: bytes) -> Content:
    """Sort the columns of the vertices; the keyword names those behind x, y and z."""
    found = _KEYWORD.fullmatch(keyword)
    assert found is not None
    further = values.shape[1] - 3
    names = ["x", "y", "z"]
    if found[3] and further >= 3:
        names += ["nx", "ny", "nz"]
    if (found[2] or not found[3]) and values.shape[1] - len(names) in (3, 4):
        names += ["red", "green", "blue", "alpha"][: values.shape[1] - len(names)]
    names += [f"column_{i + 1}" for i in range(len(names), values.shape[1])]
    return content_of_table(values, names)
