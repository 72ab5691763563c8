"""Rows of numbers in text, one record a line, read by a kernel: the ground of ascii PLY, XYZ, OFF and ascii STL."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, kernel
from surfel.core.errors import FileFormatError
from surfel.io.numbers import HARD, INTEGER, scan_number
from surfel.io.source import Bytes, Source
from surfel.io.words import address_of, byte_at

NEWLINE, RETURN = 10, 13
_DONE, _DOUBTFUL, _FULL, _SHORT, _LONG, _COUNT, _EMPTY, _END = range(8)
_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|infinity|nan)", re.IGNORECASE)
_MICROSOFT_NAN = re.compile(rb"-?nan\(\w*\)|-?1\.#(IND|QNAN|SNAN|INF)0*", re.IGNORECASE)


class RowError(Exception):
    """What is wrong with the text, and at which byte of it; the reader makes a FileFormatError of it."""

    def __init__(self, problem: str, position: int, row: int) -> None:
        super().__init__(problem, position, row)
        self.problem = problem
        self.position = position
        self.row = row


class Rows(NamedTuple):
    """What was read: (rows, columns) numbers, one list a row laid end to end, and the byte after the last row."""

    values: NDArray[np.float64]
    items: NDArray[np.int64]
    lengths: NDArray[np.int64]
    end: int


def parse_rows(
    data: Bytes,
    start: int,
    layout: tuple[int, ...],
    *,
    rows: int | None = None,
    keep: bool = True,
    newline: int = NEWLINE,
    delimiter: int = 0,
    comments: bool = False,
    loose: bool = False,
) -> Rows:
    """Read records of numbers, one a line; blank lines are skipped.

    Parameters
    ----------
    data : ndarray of uint8
        The text.
    start : int
        Where the first record begins.
    layout : tuple of int
        What a record holds, in order: 0 is a number, 1 a list (a count and so many numbers) that is passed over, 2 the
        list whose whole numbers are kept.
    rows : int, optional
        How many records have to be there; by default all to the end of the text.
    keep : bool
        Keep the numbers; otherwise they are only checked.
    newline : int
        The byte that ends a line: 10, or 13 in old files.
    delimiter : int
        A byte that parts numbers besides blanks, such as a comma; 0 for blanks alone.
    comments : bool
        Take the rest of a line after ``#`` or ``//`` for a comment.
    loose : bool
        Pass over what follows a record on its line.

    Raises
    ------
    RowError
        At the first record that is cut, too short, too long or not made of numbers.
    """
    kinds = np.array(layout, np.int64)
    columns = int((kinds == 0).sum())
    most = (len(data) - start) // 2 + 1  # a number takes at least one byte and one separator
    if rows is not None and rows * len(layout) > most:
        raise RowError(
            f"{rows} records do not fit into the {len(data) - start} bytes that are left",
            len(data), most // len(layout),
        )  # fmt: skip
    capacity = min(_lines(data, start, newline), most // max(1, len(layout)) + 1) if rows is None else rows
    values = np.empty((capacity if keep else 0, columns), np.uint64)
    listed = bool((kinds == 2).any())
    items = np.empty(most if listed else 0, np.int64)
    lengths = np.empty(capacity if listed else 0, np.int64)
    hard = np.empty((256, 4), np.int64)
    at, row, item = start, 0, 0
    while True:
        before = row
        status, at, row, item, hards, token = _read_rows(
            data,
            at,
            row,
            item,
            capacity,
            kinds,
            keep,
            values,
            items,
            lengths,
            hard,
            newline,
            delimiter,
            comments,
            loose,
        )
        resolve(data, hard[:hards], values, keep)
        if status != _FULL:
            break
        if row == before:
            hard = np.empty((2 * len(hard), 4), np.int64)
    if status != _DONE and not (status == _END and rows is None):
        raise RowError(problem_of(status, row, capacity, token), at, row)
    numbers = values[:row].view(np.float64)
    return Rows(numbers, items[:item].copy() if listed else items, lengths[:row], at)


def line_of(data: Bytes, position: int, newline: int = NEWLINE) -> int:
    """Return the number of the line (from 1) in which a byte lies."""
    return int(np.count_nonzero(data[:position] == newline)) + 1


def located(source: Source, data: Bytes, error: RowError, newline: int, what: str) -> FileFormatError:
    """Return the error of a reader for a ``RowError``, with the line and the record in which it lies."""
    place = f"line {line_of(data, error.position, newline)}, {what} {error.row}"
    return source.error(error.problem, place, "the file was cut or changed; fetch it again")


def _lines(data: Bytes, start: int, newline: int) -> int:
    return int(np.count_nonzero(data[start:] == newline)) + 1


def problem_of(status: int, read: int, wanted: int, column: int) -> str:
    """Return in words what a status of the kernels says."""
    return {
        _SHORT: f"the line ends after {column} values",
        _LONG: "the line has more values than its record",
        _COUNT: "a list has a count or an item that is not a whole number",
        _EMPTY: f"value {column + 1} of the line is empty",
        _END: f"the file ends after {read} of {wanted} records",
    }[status]


def resolve(data: Bytes, hard: NDArray[np.int64], values: NDArray[np.uint64], keep: bool = True) -> None:
    """Let Python read the tokens (row, column, start, stop) that a kernel could not.

    Raises
    ------
    RowError
        At the first that is no number.
    """
    for row, column, start, stop in hard.tolist():
        token = data[start : min(stop, start + 2000)].tobytes()
        if _NUMBER.fullmatch(token):
            value = float(token)
        elif _MICROSOFT_NAN.fullmatch(token):
            value = float("nan")
        else:
            text = token[:40].decode("ascii", "backslashreplace")
            raise RowError(f"{text!r} is not a number", start, row)
        if keep and column >= 0:
            values[row, column] = np.float64(value).view(np.uint64)


@kernel
def _read_rows(
    data, p, row, item, rows, kinds, keep, values, items, lengths, hard, newline, delimiter, comments, loose
):
    """Read records until there are enough; return why it stopped, where, and how much of each was whole by then."""
    text = address_of(data)
    stop = len(data)
    hards = 0
    while row < rows:
        while p < stop:  # to the first value of the next record
            p = skip_blanks(text, p, stop, newline)
            if comments and at_comment(text, p, stop):
                while p < stop and byte_at(text, p) != newline:
                    p += 1
            if p >= stop or byte_at(text, p) != newline:
                break
            p += 1
        if p >= stop:
            return _END, p, row, item, hards, 0
        begin, item_before, hards_before = p, item, hards
        column = 0
        token = 0
        for kind in kinds:
            if kind == 0:
                status, bits, _, start, end, p = _next(text, p, stop, newline, delimiter, comments, False)
                if status > _DOUBTFUL:
                    return status, start, row, item_before, hards_before, token
                if status == _DOUBTFUL:
                    if hards == len(hard):
                        return _FULL, begin, row, item_before, hards_before, token
                    hards = _note(hard, hards, row, column, start, end)
                if keep:
                    values[row, column] = bits
                column += 1
                token += 1
                continue
            status, _, count, start, _, p = _next(text, p, stop, newline, delimiter, comments, True)
            if status == _DONE and (count < 0 or count > (stop - p) // 2 + 1):
                status = _COUNT
            if status != _DONE:
                return status, start, row, item_before, hards_before, token
            token += 1
            if kind == 2:
                lengths[row] = count
            for _ in range(count):
                status, _, whole, start, end, p = _next(text, p, stop, newline, delimiter, comments, kind == 2)
                if status > _DOUBTFUL:
                    return status, start, row, item_before, hards_before, token
                if status == _DOUBTFUL:
                    if hards == len(hard):
                        return _FULL, begin, row, item_before, hards_before, token
                    hards = _note(hard, hards, row, -1, start, end)
                if kind == 2:
                    items[item] = whole
                    item += 1
                token += 1
        while loose and p < stop and byte_at(text, p) != newline:
            p += 1
        if p < stop and byte_at(text, p) != newline and not (comments and at_comment(text, p, stop)):
            return _LONG, p, row, item_before, hards_before, token
        row += 1
    return _DONE, p, row, item, hards, 0


@inner
def _next(text, p, stop, newline, delimiter, comments, counted):
    """Read a value: return a status, its bits, its whole value, where it begins and ends, and where the next is."""
    if p >= stop or byte_at(text, p) == newline or (comments and at_comment(text, p, stop)):
        return _SHORT, np.uint64(0), 0, p, p, p
    if delimiter != 0 and byte_at(text, p) == delimiter:
        return _EMPTY, np.uint64(0), 0, p, p, p
    start = p
    bits, whole, kind, p = scan_number(text, p, stop, counted)
    while p < stop and byte_at(text, p) > 32 and byte_at(text, p) != delimiter:
        kind = HARD
        p += 1
    end = p
    p = skip_blanks(text, p, stop, newline)
    if delimiter != 0 and p < stop and byte_at(text, p) == delimiter:
        p = skip_blanks(text, p + 1, stop, newline)
    if counted:
        return (_DONE if kind == INTEGER else _COUNT), bits, whole, start, end, p
    return (_DOUBTFUL if kind == HARD else _DONE), bits, whole, start, end, p


@inlined
def _note(hard, hards, row, column, start, end):
    """Write down a token for Python, and return how many there are."""
    hard[hards, 0] = row
    hard[hards, 1] = column
    hard[hards, 2] = start
    hard[hards, 3] = end
    return hards + 1


@inlined
def skip_blanks(text, p, stop, newline):
    """Return where the next character that is no blank stands."""
    while (
        p < stop
        and (byte_at(text, p) == 32 or byte_at(text, p) == 9 or byte_at(text, p) == 13)
        and byte_at(text, p) != newline
    ):
        p += 1
    return p


@inlined
def at_comment(text, p, stop):
    """Tell whether a comment begins here."""
    return p < stop and (
        byte_at(text, p) == 35 or (byte_at(text, p) == 47 and p + 1 < stop and byte_at(text, p + 1) == 47)
    )
