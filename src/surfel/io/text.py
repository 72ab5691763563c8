"""XYZ, CSV, TXT, ASC: columns of numbers, parted by blanks, tabs, commas or semicolons."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from surfel.core.errors import InputError
from surfel.io.columns import POINTS, content_of_table, table_of
from surfel.io.content import Content
from surfel.io.rows import NEWLINE, RETURN, RowError, line_of, located, parse_rows
from surfel.io.source import Bytes, Source

_SNIFFED = 1 << 16
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
    data = source.rest()
    layout = _sniffed(source, data)
    if layout.decimal_comma:
        body = data[layout.start :]
        body[body == ord(",")] = ord(".")
    try:
        rows = parse_rows(
            data, layout.start, (0,) * layout.columns, newline=layout.newline, delimiter=layout.delimiter,
            comments=True,
        )  # fmt: skip
    except RowError as error:
        raise located(source, data, error, layout.newline, "row") from None
    if layout.count is not None and layout.count != len(rows.values):
        raise source.error(
            f"its first line announces {layout.count} rows, {len(rows.values)} were read",
            f"line {line_of(data, len(data) - 1, layout.newline)}", "the file was cut; fetch it again",
        )  # fmt: skip
    content = content_of_table(rows.values, layout.names)
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
    names, columns, lost = table_of(content)
    if content.triangles is not None:
        lost.append(f"{len(content.triangles)} triangles")
    between = "," if suffix == ".csv" else " "
    words = _written_names(names, between, lost)
    if suffix == ".csv":
        stream.write((between.join(words) + "\n").encode())
    elif len(words) > 3:
        stream.write(("# " + between.join(words) + "\n").encode())
    for first in range(0, len(content.points), _CHUNK):
        texts = [map(repr, _plain(c[first : first + _CHUNK]).tolist()) for c in columns]
        stream.write(("\n".join(map(between.join, zip(*texts, strict=True))) + "\n").encode())
    return lost


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


def _sniffed(source: Source, data: Bytes) -> _Layout:
    """Find delimiter, names, count and the first row."""
    head = data[:_SNIFFED].tobytes()
    if head.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in head:
        raise source.error("it is not plain text", f"byte {max(0, head.find(0))}", "save it as text in UTF-8")
    newline = RETURN if b"\n" not in head and b"\r" in head else NEWLINE
    at = 3 if head.startswith(b"\xef\xbb\xbf") else 0
    names: list[str] | None = None
    count: int | None = None
    while at < len(data):
        stop = int(at + (np.flatnonzero(data[at : at + _SNIFFED] == newline)[:1].tolist() or [_SNIFFED])[0])
        line = data[at : min(stop, len(data))].tobytes().decode("utf-8", "replace").strip()
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
                line_number = line_of(data, at, newline)
                raise source.error(
                    f"{bare[:60]!r} is neither numbers nor column names", f"line {line_number}", _COLUMNS_CURE
                )
            elif numbers and len(words) == 1 and count is None and words[0].isdigit():
                count = int(words[0])
            else:
                return _checked(
                    source, data, _Layout(at, len(words), ord(delimiter or "\0"), newline, names, count, comma)
                )
        at = stop + 1
    raise source.error(
        "there is no row of numbers", "the last line", "the file was cut, or it is not a table of points"
    )


def _checked(source: Source, data: Bytes, layout: _Layout) -> _Layout:
    if layout.names is not None and len(layout.names) != layout.columns:
        layout.names = None
    if layout.columns < 3:
        line = line_of(data, layout.start, layout.newline)
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
