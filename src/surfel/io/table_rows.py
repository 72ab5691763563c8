"""Rows of plain numbers in long text, read window after window, each window in parts on several threads."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, rows, threads_for
from surfel.core.cast import Floats
from surfel.core.errors import FileFormatError
from surfel.io.numbers import HARD, scan_number
from surfel.io.rows import NEWLINE, RowError, at_comment, parse_rows, problem_of, resolve, skip_blanks
from surfel.io.source import Source
from surfel.io.words import address_of, byte_at

_WINDOW = 1 << 22
_PART = 1 << 18
_HARD = 1024
_MANY, _SHORT, _LONG, _EMPTY, _END = 2, 3, 4, 6, 7  # as in rows.py
_NAN, _INF = np.uint64(0x7FF8000000000000), np.uint64(0x7FF0000000000000)
_MINUS = np.uint64(1 << 63)


class Text(NamedTuple):
    """How rows are written: the byte that ends a line, one that parts numbers besides blanks, and so on."""

    newline: int = NEWLINE
    delimiter: int = 0
    comments: bool = False
    decimal_comma: bool = False


class TableRows:
    """Reads rows of ``columns`` numbers from where the source stands.

    Parameters
    ----------
    source : Source
        Stands at the beginning of the first row.
    columns : int
        How many numbers a row has.
    text : Text
        How they are written.
    what : str
        What errors call a row.
    """

    def __init__(self, source: Source, columns: int, text: Text, what: str = "row") -> None:
        self._source, self._columns, self._text, self._what = source, columns, text, what
        self._offset = source.position  # in the file, of the first byte of the window that was not read yet
        self._next = source.position  # in the file, of the byte behind the window
        self._bytes = bytearray(min(_WINDOW, max(1, source.remaining)))
        self._window = np.frombuffer(self._bytes, np.uint8)
        self._begin = self._end = 0
        self.count = 0

    def read(self, most: int, all_of_them: bool = False) -> Floats:
        """Return the next rows, at most so many; fewer only where the text ends.

        Raises
        ------
        FileFormatError
            At the first row that does not have so many numbers, or, if all are wanted, where the text ends before.
        """
        return self.read_groups(most, [list(range(self._columns))], all_of_them)[0]

    def read_groups(self, most: int, groups: list[list[int]], all_of_them: bool = False) -> list[Floats]:
        """Return the same as an array for each group of columns."""
        direct = groups == [list(range(self._columns))]
        expected = min(most, self._expected())
        found = [np.empty((expected, len(group))) for group in groups]
        scratch = np.empty((0, self._columns))
        filled = 0
        while filled < most:
            if not self._has_line() and not self._refill():
                break
            cuts, bases, room = self._parts(most - filled)
            if filled + room > len(found[0]):
                more = min(most, max(filled + room, self._expected() + filled))
                found = [_grown(values, filled, more) for values in found]
            if direct:
                filled += self._parse(cuts, bases, found[0][filled:])
                continue
            scratch = scratch if len(scratch) >= room else np.empty((room, self._columns))  # stays in the cache
            count = self._parse(cuts, bases, scratch)
            for group, values in zip(groups, found, strict=True):
                for i, column in enumerate(group):
                    values[filled : filled + count, i] = scratch[:count, column]
            filled += count
        if all_of_them and filled < most:
            line = self._source.line_at(self._source.size, self._text.newline)
            raise self._source.error(
                f"the file ends after {self.count} of {self.count + most - filled} records",
                f"line {line}, {self._what} {self.count}", "the file was cut or changed; fetch it again",
            )  # fmt: skip
        return [values[:filled] if 2 * filled > len(values) else values[:filled].copy() for values in found]

    def runs(self, size: int) -> Iterator[Floats]:
        """Yield run after run of rows to the end of the text."""
        while len(values := self.read(size)):
            yield values

    def finish(self) -> int:
        """Leave the source behind the last row that was read; return that place."""
        self._source.stream.seek(self._offset)
        return self._offset

    def _expected(self) -> int:
        """Return about how many rows are left, from the length of the lines in the window."""
        if not self._has_line():
            self._refill()
        seen = self._window[self._begin : min(self._end, self._begin + (1 << 16))]
        lines = int(np.count_nonzero(seen == self._text.newline)) or 1
        left = self._source.size - self._offset
        return int(left * lines / max(1, len(seen)) * 1.02) + 16 if len(seen) else 0

    def _has_line(self) -> bool:
        """Tell whether the window holds a whole line, or all the rest."""
        if self._begin == self._end:
            return False
        return self._next >= self._source.size or self._bytes.find(self._text.newline, self._begin, self._end) >= 0

    def _refill(self) -> bool:
        """Move what is left to the front and read on; make room for a line that is longer than the window."""
        while self._next < self._source.size:
            left = self._end - self._begin
            rest = self._window[self._begin : self._end].copy()
            if left == len(self._window):
                self._bytes = bytearray(min(2 * left, left + self._source.size - self._next))
                self._window = np.frombuffer(self._bytes, np.uint8)
            window = self._window
            window[:left] = rest
            fresh = window[left : left + min(len(window) - left, self._source.size - self._next)]
            self._source.stream.seek(self._next)
            self._source.fill(fresh)
            if self._text.decimal_comma:
                fresh[fresh == ord(",")] = ord(".")
            self._begin, self._end = 0, left + len(fresh)
            self._next += len(fresh)
            if self._has_line():
                break
        return self._begin < self._end

    def _parts(self, most: int) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
        """Cut the whole lines of the window, at most so many, into parts; say where the rows of each may begin."""
        newline, stop = self._text.newline, self._end
        if self._next < self._source.size:
            stop = self._bytes.rfind(newline, self._begin, self._end) + 1
        lines = self._count(self._begin, stop)
        if lines > most:
            ends = np.flatnonzero(self._window[self._begin : stop] == newline)
            stop = self._begin + int(ends[most - 1]) + 1
        cuts = [self._begin]
        while stop - cuts[-1] > _PART and 0 < (end := self._bytes.find(newline, cuts[-1] + _PART, stop) + 1) < stop:
            cuts.append(end)
        cuts.append(stop)
        counts = [self._count(first, last) for first, last in pairwise(cuts)]
        bases = np.concatenate([[0], np.cumsum(counts)])
        return np.array(cuts), bases[:-1], int(bases[-1])

    def _count(self, first: int, last: int) -> int:
        """Return how many lines there are, one that has no end included."""
        newline = self._text.newline
        return int(np.count_nonzero(self._window[first:last] == newline)) + (self._bytes[last - 1] != newline)

    def _parse(self, cuts: NDArray[np.int64], bases: NDArray[np.int64], out: Floats) -> int:
        """Read the parts; return how many rows they had."""
        found = np.empty((len(bases), 5), np.int64)
        hard = np.empty((len(bases), _HARD, 4), np.int64)
        text = self._text
        with threads_for(int(cuts[-1] - cuts[0]) // 16):
            _parse_parts(
                len(bases), self._window, cuts, bases, np.int64(self._columns), np.uint8(text.newline),
                np.uint8(text.delimiter), text.comments, out.view(np.uint64), found, hard,
            )  # fmt: skip
        filled = 0
        for part, (status, at, count, hards, token) in enumerate(found.tolist()):
            own = out[bases[part] :]
            try:
                if status == _MANY:
                    count = self._parse_slowly(int(cuts[part]), int(cuts[part + 1]), own)
                else:
                    resolve(self._window, hard[part, :hards], own.view(np.uint64))
                    if status != _END:
                        raise RowError(problem_of(status, 0, 0, token), at, count)
            except RowError as error:
                raise self._located(error, self.count + filled + error.row) from None
            if filled != bases[part]:  # a part before had empty lines or comments
                out[filled : filled + count] = out[bases[part] : bases[part] + count].copy()
            filled += count
        self._offset += int(cuts[-1]) - self._begin
        self._begin = int(cuts[-1])
        self.count += filled
        return filled

    def _parse_slowly(self, start: int, stop: int, out: Floats) -> int:
        """Read a part with more tokens for Python than are kept; return how many rows it had."""
        text = self._text
        values = parse_rows(
            self._window[:stop], start, (0,) * self._columns, newline=text.newline, delimiter=text.delimiter,
            comments=text.comments,
        ).values  # fmt: skip
        out[: len(values)] = values
        return len(values)

    def _located(self, error: RowError, row: int) -> FileFormatError:
        line = self._source.line_at(self._offset + error.position - self._begin, self._text.newline)
        return self._source.error(
            error.problem, f"line {line}, {self._what} {row}", "the file was cut or changed; fetch it again"
        )


def _grown(values: Floats, filled: int, rows: int) -> Floats:
    larger = np.empty((rows, values.shape[1]))
    larger[:filled] = values[:filled]
    return larger


@rows
def _parse_parts(first, last, data, cuts, bases, columns, newline, delimiter, comments, out, found, hard):
    """Read the rows of parts; write down for each why it ended, where, and how many rows and hard tokens it had."""
    for part in range(first, last):
        status, p, count, hards, token = _parse_part(
            address_of(data),
            cuts[part],
            cuts[part + 1],
            columns,
            newline,
            delimiter,
            comments,
            out[bases[part] :],
            hard[part],
        )
        found[part, 0] = status
        found[part, 1] = p
        found[part, 2] = count
        found[part, 3] = hards
        found[part, 4] = token


@inlined
def _parse_part(text, p, stop, columns, newline, delimiter, comments, out, hard):
    row = 0
    hards = 0
    while True:
        while p < stop:  # to the first value of the next row
            p = skip_blanks(text, p, stop, newline)
            if comments and at_comment(text, p, stop):
                while p < stop and byte_at(text, p) != newline:
                    p += 1
            if p >= stop or byte_at(text, p) != newline:
                break
            p += 1
        if p >= stop:
            return _END, p, row, hards, 0
        for column in range(columns):
            if p >= stop or byte_at(text, p) == newline or (comments and at_comment(text, p, stop)):
                return _SHORT, p, row, hards, column
            if delimiter != 0 and byte_at(text, p) == delimiter:
                return _EMPTY, p, row, hards, column
            start = p
            bits, _, kind, p = scan_number(text, p, stop, False)
            if p < stop and byte_at(text, p) > 32 and byte_at(text, p) != delimiter:
                kind = HARD
                while p < stop and byte_at(text, p) > 32 and byte_at(text, p) != delimiter:
                    p += 1
            if kind == HARD:
                known, bits = _not_a_number(text, start, p)
                if not known:
                    if hards == len(hard):
                        return _MANY, start, row, hards, column
                    hard[hards, 0] = row
                    hard[hards, 1] = column
                    hard[hards, 2] = start
                    hard[hards, 3] = p
                    hards += 1
            out[row, column] = bits
            p = skip_blanks(text, p, stop, newline)
            if delimiter != 0 and p < stop and byte_at(text, p) == delimiter:
                p = skip_blanks(text, p + 1, stop, newline)
        if p < stop and byte_at(text, p) != newline and not (comments and at_comment(text, p, stop)):
            return _LONG, p, row, hards, columns
        row += 1


@inlined
def _not_a_number(text, start, stop):
    """Read nan, inf and -inf, of which scans may have one in every row; return whether it was one, and its bits."""
    minus = byte_at(text, start) == 45
    p = start + 1 if minus or byte_at(text, start) == 43 else start
    if stop - p != 3:
        return False, np.uint64(0)
    a, b, c = byte_at(text, p) | 32, byte_at(text, p + 1) | 32, byte_at(text, p + 2) | 32
    if a == 110 and b == 97 and c == 110:
        return True, _NAN
    if a == 105 and b == 110 and c == 102:
        return True, (_INF | _MINUS) if minus else _INF
    return False, np.uint64(0)
