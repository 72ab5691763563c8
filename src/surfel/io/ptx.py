"""PTX, as scanners of Leica write it: scan behind scan, each a grid of rows with the pose of its scanner; read only."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from surfel.core.cast import Floats
from surfel.io.content import Content, Frame, Head
from surfel.io.scan_lines import CUT, ScanRows, joined, next_line, numbers_in, rows_ahead
from surfel.io.source import Source

_WHOLE = 1 << 62


class _Scan(NamedTuple):
    columns: int
    rows: int
    scanner: Floats
    matrix: Floats  # of the file: (x y z 1) times it is the place in the world


def load(source: Source) -> Content:
    """Read all scans of a file into one system of coordinates.

    Each point is moved by the transformation of its scan; the attribute ``scan`` numbers the scans from 0. Rows that
    are 0 0 0 met nothing: they are dropped, and the notes count them. ``frame.extra["ptx"]`` keeps the places of the
    scanners.

    Raises
    ------
    FileFormatError
        If there are fewer or more rows than a scan announces, or its transformation is none.
    """
    return joined(list(_runs(source, _WHOLE)))


def chunks(source: Source, size: int) -> Iterator[Content]:
    """Read run after run of at most ``size`` points; the notes count what met nothing within a run.

    Raises
    ------
    FileFormatError
        As :func:`load` does.
    """
    return _runs(source, size)


def head(source: Source) -> Head | None:
    """Return None: the numbers of rows in the header count what met nothing as well."""
    return None


def _runs(source: Source, size: int) -> Iterator[Content]:
    from surfel.io.table_rows import TableRows, Text  # on first use, because it has kernels

    made: ScanRows | None = None
    number = 0
    scanners: list[list[float]] = []  # one list for all runs: it is whole when the last scan is read
    frame = Frame(extra={"ptx": {"scanners": scanners}})
    while (line := next_line(source)) is not None:
        scan = _scan(source, line)
        scanners.append(scan.scanner.tolist())
        wanted = scan.columns * scan.rows
        if wanted:
            made = rows_ahead(source, made)
            table = TableRows(source, made.columns, Text())
            while wanted:
                values = table.read(min(size, wanted), all_of_them=True)
                wanted -= len(values)
                yield _placed(made.content(source, values, frame, []), scan, number)
            table.finish()
        number += 1
    if number == 0:
        raise source.error("there is no scan", "the first line", CUT)
    if made is None:
        empty = ScanRows("0 0 0").content(source, np.empty((0, 3)), frame, [])
        empty.attributes["scan"] = np.empty(0, np.int32)
        yield empty


def _scan(source: Source, line: str) -> _Scan:
    """Read the ten lines before the rows of a scan."""
    columns = _count(source, line, "the number of columns")
    rows = _count(source, next_line(source), "the number of rows")
    if columns * rows > source.remaining:
        raise source.error(
            f"{columns} columns of {rows} rows do not fit into the {source.remaining} bytes that are left",
            f"before byte {source.position}", CUT,
        )  # fmt: skip
    scanner = numbers_in(source, next_line(source), 3, "the place of the scanner")
    for axis in "xyz":
        numbers_in(source, next_line(source), 3, f"the {axis} axis of the scanner")
    matrix = np.stack([numbers_in(source, next_line(source), 4, "a row of the transformation") for _ in range(4)])
    if (np.abs(matrix[:, 3] - [0.0, 0.0, 0.0, 1.0]) > 1e-9).any() or abs(np.linalg.det(matrix[:3, :3])) < 1e-12:
        raise source.error(
            "the transformation of a scan has no last column 0 0 0 1, or flattens space",
            f"before byte {source.position}", CUT,
        )  # fmt: skip
    return _Scan(columns, rows, scanner, matrix)


def _count(source: Source, line: str | None, what: str) -> int:
    if line is None or not (line.isascii() and line.isdigit()) or len(line) > 18:
        raise source.error(
            f"{what} should be a whole number, there is {(line or 'nothing')[:60]!r}", f"before byte {source.position}",
            CUT,
        )  # fmt: skip
    return int(line)


def _placed(content: Content, scan: _Scan, number: int) -> Content:
    """Drop what met nothing and move the rest into the common system."""
    met = np.asarray((content.points != 0.0).any(axis=1))
    nothing = int(len(met) - met.sum())
    if nothing:
        content = content.rows(met)
        content.notes.append(f"rows of scan {number} that met nothing (0 0 0) and were dropped: {nothing}")
    content.points = content.points @ scan.matrix[:3, :3] + scan.matrix[3, :3]
    content.attributes["scan"] = np.full(len(content.points), number, np.int32)
    return content
