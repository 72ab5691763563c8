"""The few lines before and between the scans of a PTS or PTX file, and what the columns of their rows are."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.io.content import Content, Frame
from surfel.io.source import Source

_LONGEST = 4096
CUT = "the file was cut or changed; fetch it again"
COLUMNS = {3: "x y z", 4: "x y z intensity", 6: "x y z red green blue", 7: "x y z intensity red green blue"}
"""What rows can be, by how many numbers they have."""


def next_line(source: Source) -> str | None:
    """Return the next line that is not blank, None at the end of the file.

    Raises
    ------
    FileFormatError
        If it is too long to be a line of such a file.
    """
    while True:
        start = source.position
        raw = source.stream.readline(_LONGEST)
        if not raw:
            return None
        if len(raw) == _LONGEST:
            raise source.error("there is a line of more than 4,000 characters", f"byte {start}", CUT)
        if b"\0" in raw:
            raise source.error("it is not plain text", f"byte {start + raw.index(0)}", CUT)
        text = raw.decode("utf-8", "replace").strip().lstrip("\ufeff")
        if text:
            return text


def peeked(source: Source) -> str | None:
    """Return the next line that is not blank and leave the source before it."""
    before = source.position
    line = next_line(source)
    source.stream.seek(before)
    return line


def numbers_in(source: Source, line: str | None, count: int, what: str) -> Floats:
    """Return the ``count`` finite numbers of a line.

    Raises
    ------
    FileFormatError
        If these are not what it holds.
    """
    words = (line or "").split()
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        values = np.empty(0)
    if len(values) != count or len(words) != count or not np.isfinite(values).all():
        raise source.error(
            f"{what} should be {count} numbers, there is {(line or 'nothing')[:60]!r}",
            f"before byte {source.position}",
            CUT,
        )
    return values


class ScanRows:
    """Makes contents of the rows of a file, all of the same columns and types.

    Parameters
    ----------
    first : str
        The first row. Where its colors are written as whole numbers, all colors have to be bytes.
    """

    def __init__(self, first: str) -> None:
        words = first.split()
        self.columns = len(words)
        self._bytes = all(word.isdigit() for word in words[-3:])

    def content(self, source: Source, values: Floats, frame: Frame | None, notes: list[str]) -> Content:
        """Return rows as points, intensity and colors.

        Raises
        ------
        FileFormatError
            If a color is no byte where the first ones were.
        """
        colors: NDArray[Any] | None = None
        if self.columns >= 6:
            colors = values[:, -3:]
            if self._bytes and not _are_bytes(colors):
                raise source.error(
                    "a color is not a whole number from 0 to 255, as that of the first row is",
                    f"before byte {source.position}",
                    CUT,
                )
            colors = np.ascontiguousarray(colors, np.uint8 if self._bytes else np.float64)
        attributes = {"intensity": np.ascontiguousarray(values[:, 3])} if self.columns in (4, 7) else {}
        points = np.ascontiguousarray(values[:, :3])
        return Content(points, colors=colors, attributes=attributes, notes=list(notes), frame=frame)


def rows_ahead(source: Source, before: ScanRows | None) -> ScanRows:
    """Return what the next row of a source says about its columns; they have to be those of the scan before.

    Raises
    ------
    FileFormatError
        If there is no row, rows of so many columns mean nothing, or the scan before had others.
    """
    line = peeked(source) or ""
    count = len(line.split())
    if count not in COLUMNS:
        raise source.error(
            f"its rows have {count} columns" if line else "the rows of a scan are missing", f"byte {source.position}",
            f"rows are {', or '.join(COLUMNS.values())}; name any other table of numbers .xyz",
        )  # fmt: skip
    if before is not None and before.columns != count:
        raise source.error(
            f"one scan has rows of {before.columns} columns, the next of {count}", f"byte {source.position}", CUT
        )
    return before or ScanRows(line)


def joined(parts: list[Content]) -> Content:
    """Return contents with the same columns as one."""
    if len(parts) == 1:
        return parts[0]
    first = parts[0]
    attributes = {name: np.concatenate([part.attributes[name] for part in parts]) for name in first.attributes}

    def together(arrays: list[Any]) -> Any:
        return None if arrays[0] is None else np.concatenate(arrays)

    return Content(
        np.concatenate([part.points for part in parts]), None, together([part.normals for part in parts]),
        together([part.radii for part in parts]), together([part.colors for part in parts]), attributes,
        list(dict.fromkeys(note for part in parts for note in part.notes)), first.frame,
    )  # fmt: skip


def _are_bytes(values: Floats) -> bool:
    whole: NDArray[np.bool_] = np.asarray((values >= 0.0) & (values <= 255.0) & (values == np.floor(values)))
    return bool(whole.all())
