"""PTS, as scanners of Leica write it: a count, then that many rows x y z [intensity] [r g b]; scan behind scan."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.io.content import Content, Head
from surfel.io.scan_lines import CUT, ScanRows, joined, next_line, rows_ahead
from surfel.io.source import Source

_ANY = 1 << 62
_CHUNK = 1 << 15


def load(source: Source) -> Content:
    """Read all scans of a file.

    Rows have 3, 4, 6 or 7 columns. The intensity is kept as it is stored (-2048 to 2047 by Leica's scanners, 0 to 255
    or 0 to 1 by other programs). A file without a count is read to its end.

    Raises
    ------
    FileFormatError
        If there are fewer or more rows than the count, or a row is not what the first is.
    """
    return joined(list(chunks(source, _ANY)))


def chunks(source: Source, size: int) -> Iterator[Content]:
    """Read run after run of at most ``size`` points.

    Raises
    ------
    FileFormatError
        As :func:`load` does.
    """
    from surfel.io.table_rows import TableRows, Text  # on first use, because it has kernels

    made: ScanRows | None = None
    while True:
        wanted = _count_ahead(source)
        if wanted is None:
            break
        if wanted == 0:
            continue
        made = rows_ahead(source, made)
        table = TableRows(source, made.columns, Text())
        counted = wanted < _ANY
        while wanted and len(values := table.read(min(size, wanted), all_of_them=counted)):
            yield made.content(source, values, None, [])
            wanted -= len(values)
        table.finish()
    if made is None:
        yield ScanRows("0 0 0").content(source, np.empty((0, 3)), None, [])


def head(source: Source) -> Head | None:
    """Return None: whether the count is true shows only at the end."""
    return None


def save(stream: BinaryIO, content: Content, *, ascii: bool = True, suffix: str = ".pts") -> list[str]:
    """Write one scan: its count, then x y z [intensity] [r g b], doubles with all their digits.

    Colors become bytes. An intensity is written as it is.

    Raises
    ------
    InputError
        If a coordinate is not finite.
    """
    rows = _Writer(stream)
    rows.add(content)
    rows.close()
    if content.triangles is not None:
        rows.lost.append(f"{len(content.triangles)} triangles")
    return rows.lost


def writer(stream: BinaryIO, first: Content, head: Head, *, suffix: str) -> _Writer | None:
    """Return what writes run after run, or None where only all colors together tell how bright they are."""
    return _Writer(stream) if first.colors is None or first.colors.dtype == np.uint8 else None


class _Writer:
    """Writes rows behind a count that is filled in at the end."""

    def __init__(self, stream: BinaryIO) -> None:
        self.lost: list[str] = []
        self._stream, self._count = stream, 0
        stream.write(self._first_line())

    def add(self, content: Content) -> None:
        """Write rows."""
        if not np.isfinite(content.points).all():
            raise InputError("PTS holds finite coordinates only; drop the others")
        lost = [what.split(" of ")[0] for what in content.lost_without("colors", "attributes", "triangles")]
        lost += [f"attribute {name!r}" for name in content.attributes if name != "intensity"]
        columns: list[NDArray[Any]] = [content.points[:, i] for i in range(3)]
        intensity = content.attributes.get("intensity")
        if intensity is not None and intensity.ndim == 1 and intensity.dtype.kind in "fiub":
            columns.append(_plain(intensity))
        elif intensity is not None:
            lost.append("attribute 'intensity'")
        columns += _bytes_of(content, lost)
        self.lost += [what for what in lost if what not in self.lost]
        for first in range(0, len(content.points), _CHUNK):
            texts = [map(repr, column[first : first + _CHUNK].tolist()) for column in columns]
            self._stream.write(("\n".join(map(" ".join, zip(*texts, strict=True))) + "\n").encode())
        self._count += len(content.points)

    def close(self) -> None:
        """Fill in the count."""
        self._stream.seek(0)
        self._stream.write(self._first_line())
        self._stream.seek(0, 2)

    def _first_line(self) -> bytes:
        return f"{self._count:<19}\n".encode()


def _count_ahead(source: Source) -> int | None:
    """Read the count of the next scan: None at the end, ``_ANY`` where the file begins with a row."""
    start = source.position
    line = next_line(source)
    if line is None and start == 0:
        raise source.error("there is no count and no row", "the first line", CUT)
    if line is None or _is_count(line):
        return None if line is None else int(line)
    if start == 0 and len(line.split()) >= 3:
        source.stream.seek(start)
        return _ANY
    raise source.error(f"a count of rows or the end of the file is due, there is {line[:60]!r}", f"byte {start}", CUT)


def _is_count(line: str) -> bool:
    return line.isascii() and line.isdigit() and len(line) < 19


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    """Return whole numbers as such, so that they are written without a decimal point."""
    if values.dtype.kind == "b":
        return values.astype(np.uint8)
    if values.dtype.kind != "f" or not np.isfinite(values).all() or (np.abs(values) > 1e15).any():
        return values
    return values.astype(np.int64) if (values == np.floor(values)).all() else values


def _bytes_of(content: Content, lost: list[str]) -> list[NDArray[Any]]:
    """Return the colors as three columns of bytes."""
    colors = content.colors
    if colors is None:
        return []
    rgb: Floats = colors[:, :3].astype(np.float64)
    if colors.dtype.kind == "f":
        rgb = np.clip(np.nan_to_num(rgb), 0.0, 1.0) * 255.0 if not len(rgb) or rgb.max() <= 1.0 else rgb
    elif colors.dtype.itemsize > 1 and len(rgb) and rgb.max() > 255.0:
        rgb = rgb / 257.0
    words = np.clip(np.rint(rgb), 0.0, 255.0)
    if (words != rgb).any():
        lost.append("colors beyond 8 bits")
    if colors.shape[1] == 4:
        lost.append("alpha of the colors")
    return [words[:, i].astype(np.int64) for i in range(3)]
