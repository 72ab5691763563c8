"""XYZ, CSV, TXT, ASC: columns of numbers, parted by blanks, tabs, commas or semicolons."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.io.columns import POINTS, Spread, content_of_table, depends_on_values, table_of
from surfel.io.content import Content, Head
from surfel.io.source import Source

if TYPE_CHECKING:
    from surfel.io.table_rows import TableRows

NEWLINE, RETURN = 10, 13
_SNIFFED = 1 << 20
_CHUNK = 1 << 15
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|infinity|nan)|-?nan\(\w*\)|-?1\.#\w+", re.I)
_COMMENT = re.compile(r"\s*(#+|//+)")
_COLUMNS_CURE = "give columns x y z, and name further ones in a first line such as: x y z nx ny nz intensity"


@dataclass
class _Layout:
    """What the first lines tell."""

    start: int
    columns: int
    delimiter: int
    newline: int
    names: list[str] | None = None
    count: int | None = None
    decimal_comma: bool = False


def load(source: Source) -> Content:
    """Read columns of numbers.

    The first line may name the columns (also as a comment), the next may give the number of rows, which is then
    compared. Comments begin with ``#`` or ``//``. The delimiter is found in the first row: a semicolon, a comma, or
    blanks; where a semicolon parts, a comma is the decimal point. Without names, columns go by
    :func:`surfel.io.columns.content_of_table`.

    Raises
    ------
    FileFormatError
        At the first line that does not have as many numbers as the first, or if the count does not fit.
    """
    layout = _sniffed(source)
    rows = _rows(source, layout)
    values = rows.read(source.size)
    _compare(source, layout, rows)
    return _content(values, layout, None)


def chunks(source: Source, size: int) -> Iterator[Content]:
    """Yield the points in runs; where roles of columns depend on their values, the text is read twice.

    Raises
    ------
    FileFormatError
        As :func:`load` does, once the damage is reached.
    """
    layout = _sniffed(source)
    spread: Spread | None = None
    if depends_on_values(layout.names, layout.columns):
        rows = _rows(source, layout)
        for values in rows.runs(size):
            own = Spread.of(values)
            spread = own if spread is None else spread.joined(own)
    rows = _rows(source, layout)
    for values in rows.runs(size):
        yield _content(values, layout, spread)
    _compare(source, layout, rows)


def _rows(source: Source, layout: _Layout) -> TableRows:
    from surfel.io.table_rows import TableRows, Text

    source.stream.seek(layout.start)
    return TableRows(
        source, layout.columns, Text(layout.newline, layout.delimiter, True, layout.decimal_comma)
    )  # fmt: skip


def _compare(source: Source, layout: _Layout, rows: TableRows) -> None:
    if layout.count is not None and layout.count != rows.count:
        raise source.error(
            f"its first line announces {layout.count} rows, {rows.count} were read",
            f"line {source.line_at(source.size - 1, layout.newline)}", "the file was cut; fetch it again",
        )  # fmt: skip


def _content(values: Floats, layout: _Layout, spread: Spread | None) -> Content:
    content = content_of_table(values, layout.names, spread)
    if layout.decimal_comma:
        content.notes.append("commas were read as decimal points")
    return content


def save(stream: BinaryIO, content: Content, *, ascii: bool = True, suffix: str = ".xyz") -> list[str]:
    """Write columns of numbers, each with all the digits that it takes to read the same double again.

    A ``.csv`` names its columns in its first line; the other suffixes do so in a comment, and only where there are more
    than x, y and z.

    Raises
    ------
    InputError
        If there are no points.
    """
    if len(content.points) == 0:
        raise InputError("a text file cannot hold a cloud of no points; write .ply or .npz")
    written = Writer(stream, content, suffix)
    written.add(content)
    return written.lost


def writer(stream: BinaryIO, first: Content, head: Head, *, suffix: str) -> Writer:
    """Return a writer of runs."""
    return Writer(stream, first, suffix)


class Writer:
    """Takes run after run."""

    def __init__(self, stream: BinaryIO, first: Content, suffix: str) -> None:
        names, _, self.lost = table_of(first)
        if first.triangles is not None:
            self.lost.append(f"{len(first.triangles)} triangles")
        self._stream, self._rows = stream, 0
        self._between = "," if suffix == ".csv" else " "
        words = _written_names(names, self._between, self.lost)
        if suffix == ".csv" or len(words) > 3:
            stream.write((("" if suffix == ".csv" else "# ") + self._between.join(words) + "\n").encode())

    def add(self, run: Content) -> None:
        """Write one run."""
        columns = table_of(run)[1]
        for first in range(0, len(run.points), _CHUNK):
            texts = [map(repr, _plain(c[first : first + _CHUNK]).tolist()) for c in columns]
            self._stream.write(("\n".join(map(self._between.join, zip(*texts, strict=True))) + "\n").encode())
        self._rows += len(run.points)

    def close(self) -> None:
        """Refuse a file of no points.

        Raises
        ------
        InputError
            If there were none.
        """
        if self._rows == 0:
            raise InputError("a text file cannot hold a cloud of no points; write .ply or .npz")


def _plain(column: NDArray[Any]) -> NDArray[Any]:
    return column.astype(np.uint8) if column.dtype.kind == "b" else column


def _written_names(names: list[str], between: str, lost: list[str]) -> list[str]:
    """Return names that can stand in a line of names."""
    words: list[str] = []
    for name in names:
        word = re.sub(r"[\s,;#\"'/]+", "_", name).lower() or "unnamed"
        while word in words:
            word += "_"
        if word != name:
            lost.append(f"the name {name!r} (written as {word!r})")
        words.append(word)
    return words


def _sniffed(source: Source) -> _Layout:
    """Find delimiter, names, count and the first row; in all of the file if a megabyte is not enough."""
    head = source.head(_SNIFFED)
    if head.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in head:
        raise source.error("it is not plain text", f"byte {max(0, head.find(0))}", "save it as text in UTF-8")
    layout = _layout_of(source, head, len(head) == source.size)
    if layout is None and len(head) < source.size:
        layout = _layout_of(source, source.head(source.size), True)
    if layout is None:
        raise source.error(
            "there is no row of numbers", "the last line", "the file was cut, or it is not a table of points"
        )
    return layout


def _layout_of(source: Source, data: bytes, whole: bool) -> _Layout | None:
    """Go through the first lines to the first row of numbers; None if it is not there."""
    newline = RETURN if b"\n" not in data[:_SNIFFED] and b"\r" in data else NEWLINE
    at = 3 if data.startswith(b"\xef\xbb\xbf") else 0
    names: list[str] | None = None
    count: int | None = None
    while at < len(data):
        stop = data.find(newline, at)
        if stop < 0 and not whole:
            return None
        stop = len(data) if stop < 0 else stop
        line = data[at:stop].decode("utf-8", "replace").strip()
        comment = _COMMENT.match(line)
        bare = line[comment.end() :].strip() if comment else re.split(r"#|//", line)[0].strip()
        if bare:
            delimiter = ";" if ";" in bare else "," if "," in bare else ""
            words = _words(bare, delimiter)
            comma = delimiter == ";" and "," in bare
            numbers = all(_NUMBER.fullmatch(w.replace(",", ".") if comma else w) for w in words)
            if comment:
                names = _names(words) or names
            elif not numbers and names is None and count is None and _names(words):
                names = _names(words)
            elif not numbers and not any(_NUMBER.fullmatch(w) for w in words):
                raise source.error(
                    f"{bare[:60]!r} is neither numbers nor column names", f"line {source.line_at(at, newline)}",
                    _COLUMNS_CURE,
                )  # fmt: skip
            elif numbers and len(words) == 1 and count is None and words[0].isdigit():
                count = int(words[0])
            else:
                return _checked(source, _Layout(at, len(words), ord(delimiter or "\0"), newline, names, count, comma))
        at = stop + 1
    return None


def _checked(source: Source, layout: _Layout) -> _Layout:
    if layout.names is not None and len(layout.names) != layout.columns:
        layout.names = None
    if layout.columns < 3:
        line = source.line_at(layout.start, layout.newline)
        raise source.error(f"its rows have {layout.columns} columns, three are needed", f"line {line}", _COLUMNS_CURE)
    return layout


def _words(line: str, delimiter: str) -> list[str]:
    if not delimiter:
        return line.split()
    words = [word.strip() for word in line.split(delimiter)]
    return words[:-1] if words[-1] == "" else words


def _names(words: list[str]) -> list[str] | None:
    """Return the words as column names if x, y and z are among them and none comes twice."""
    names = [word.strip("\"'").strip().lower() for word in words]
    return names if set(POINTS[0]) <= set(names) and len(set(names)) == len(names) else None
