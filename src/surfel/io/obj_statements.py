"""The statements of an OBJ file that carry geometry (v, vn and f), read by a kernel in two passes: count, then fill."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, kernel
from surfel.core.cast import Floats, Integers
from surfel.io.numbers import HARD, INTEGER, scan_number
from surfel.io.rows import NEWLINE, RETURN, RowError, line_of, resolve
from surfel.io.source import Bytes, Source
from surfel.io.words import address_of, byte_at

_WIDTH = 8
_VERTICES, _NORMALS, _FACES, _CORNERS, _OTHERS = range(5)
_DONE, _FULL, _UNKNOWN, _FEW, _MANY, _CORNER = range(6)
_PASSED = (
    "vt vp cstype deg bmat step parm trim hole scrv sp end con g s mg o bevel c_interp d_interp lod usemtl mtllib "
    "usemap maplib shadow_obj trace_obj ctech stech call csh res"
)
_SHAPES = "p l curv curv2 surf"
_CURE = "the file was cut or changed; fetch it again"


class Statements(NamedTuple):
    """What was read: up to seven numbers a vertex (``widths`` says how many), normals, and the corners of the faces."""

    vertices: Floats
    widths: Integers
    normals: Floats
    corners: Integers
    lengths: Integers
    others: int


def read_statements(source: Source) -> Statements:
    """Read all v, vn and f lines; corners are rows of the vertices, not yet compared with their number.

    Raises
    ------
    FileFormatError
        At the first line that is no statement of the format.
    """
    data = source.rest()
    newline = RETURN if not (data == NEWLINE).any() and (data == RETURN).any() else NEWLINE
    _join_continued(data, newline)
    counts = np.zeros(5, np.int64)
    status, at = _count(data, newline, _codes(_PASSED), _codes(_SHAPES), counts)
    if status == _UNKNOWN:
        word = data[at : at + 20].tobytes().split()[0].decode("ascii", "backslashreplace")
        place = f"line {line_of(data, at, newline)}"
        raise source.error(f"{word!r} is no statement of an OBJ file", place, _CURE)
    return _filled(source, data, newline, counts)


def _filled(source: Source, data: Bytes, newline: int, counts: Integers) -> Statements:
    """Allocate what was counted and fill it."""
    vertices = np.zeros((counts[_VERTICES], _WIDTH), np.uint64)
    widths = np.empty(counts[_VERTICES], np.int64)
    normals = np.zeros((counts[_NORMALS], 3), np.uint64)
    corners = np.empty(counts[_CORNERS], np.int64)
    lengths = np.empty(counts[_FACES], np.int64)
    hard = np.empty((256, 4), np.int64)
    while True:
        status, at, hards, corner = _read(data, newline, vertices, widths, normals, corners, lengths, hard)
        if status != _FULL:
            break
        hard = np.empty((4 * len(hard), 4), np.int64)
    place = f"line {line_of(data, at, newline)}"
    if status != _DONE:
        problem = {
            _FEW: "the line has too few values",
            _MANY: "the line has too many values",
            _CORNER: "a corner of the face is not a vertex number",
        }[status]
        raise source.error(problem, place, _CURE)
    try:
        tokens = hard[:hards]
        resolve(data, tokens[tokens[:, 1] >= 0], vertices)
        tokens[:, 1] = -1 - tokens[:, 1]
        resolve(data, tokens[tokens[:, 1] >= 0], normals)
    except RowError as error:
        raise source.error(error.problem, f"line {line_of(data, error.position, newline)}", _CURE) from None
    return Statements(
        vertices.view(np.float64), widths, normals.view(np.float64), corners[:corner], lengths, int(counts[_OTHERS])
    )


def _join_continued(data: Bytes, newline: int) -> None:
    """Blank every backslash at the end of a line together with its line end."""
    for at in np.flatnonzero(data == ord("\\")):
        end = at + 1
        if end < len(data) and data[end] == RETURN and newline != RETURN:
            end += 1
        if end < len(data) and data[end] == newline:
            data[at : end + 1] = ord(" ")


def _codes(words: str) -> NDArray[np.int64]:
    """Return words as the kernel packs them: their first seven bytes."""
    return np.array([int.from_bytes(word.encode()[:7], "big") for word in words.split()], np.int64)


@inner
def _keyword(text, p, stop):
    """Return the packed word at p and the position after it."""
    code = np.int64(0)
    length = 0
    while p < stop and byte_at(text, p) > 32:
        if length < 7:
            code = (code << 8) | byte_at(text, p)
        length += 1
        p += 1
    return code, p


@inlined
def _blanks(text, p, stop, newline):
    while (
        p < stop
        and (byte_at(text, p) == 32 or byte_at(text, p) == 9 or byte_at(text, p) == 13)
        and byte_at(text, p) != newline
    ):
        p += 1
    return p


@inlined
def _ends(text, p, stop, newline):
    """Whether no further value stands on the line."""
    return p >= stop or byte_at(text, p) == newline or byte_at(text, p) == 35


@inlined
def _to_next_line(text, p, stop, newline):
    while p < stop and byte_at(text, p) != newline:
        p += 1
    return p + 1


@kernel
def _count(data, newline, passed, shapes, counts):
    """Count statements and corners; stop at a word that is no statement."""
    text, stop = address_of(data), len(data)
    p = 0
    while p < stop:
        p = _blanks(text, p, stop, newline)
        if not _ends(text, p, stop, newline):
            start = p
            code, p = _keyword(text, p, stop)
            if code == 118:  # v
                counts[_VERTICES] += 1
            elif code == 30318:  # vn
                counts[_NORMALS] += 1
            elif code == 102:  # f
                counts[_FACES] += 1
                p = _blanks(text, p, stop, newline)
                while not _ends(text, p, stop, newline):
                    counts[_CORNERS] += 1
                    _, p = _keyword(text, p, stop)
                    if p == stop or byte_at(text, p) == newline:
                        break
                    before = p
                    p = _blanks(text, p, stop, newline)
                    if p == before:  # a control character, refused later
                        p += 1
            else:
                known = False
                for other in passed:
                    known = known or other == code
                for other in shapes:
                    if other == code:
                        known = True
                        counts[_OTHERS] += 1
                if not known:
                    return _UNKNOWN, start
        p = _to_next_line(text, p, stop, newline)
    return _DONE, p


@kernel
def _read(data, newline, vertices, widths, normals, corners, lengths, hard):
    """Fill the arrays; return why it stopped, where, and how many hard numbers and corners there are."""
    text, stop = address_of(data), len(data)
    p = 0
    vertex = 0
    normal = 0
    face = 0
    corner = 0
    hards = 0
    while p < stop:
        p = _blanks(text, p, stop, newline)
        if not _ends(text, p, stop, newline):
            code, p = _keyword(text, p, stop)
            if code == 118 or code == 30318:
                width = 0
                p = _blanks(text, p, stop, newline)
                while not _ends(text, p, stop, newline):
                    if width >= (7 if code == 118 else 3):
                        return _MANY, p, hards, corner
                    start = p
                    bits, _, kind, p = scan_number(text, p, stop, False)
                    if p < stop and byte_at(text, p) > 32:
                        kind = HARD
                    if kind == HARD or (p < stop and byte_at(text, p) <= 32 and p == start):
                        while p < stop and byte_at(text, p) > 32:
                            p += 1
                        if hards == len(hard):
                            return _FULL, p, hards, corner
                        hard[hards, 0] = vertex if code == 118 else normal
                        hard[hards, 1] = width if code == 118 else -1 - width
                        hard[hards, 2] = start
                        hard[hards, 3] = max(p, start + 1)
                        p = max(p, start + 1)
                        hards += 1
                    elif code == 118:
                        vertices[vertex, width] = bits
                    else:
                        normals[normal, width] = bits
                    width += 1
                    p = _blanks(text, p, stop, newline)
                if width < 3:
                    return _FEW, min(p, stop - 1), hards, corner
                if code == 118:
                    widths[vertex] = width
                    vertex += 1
                else:
                    normal += 1
            elif code == 102:
                first = corner
                p = _blanks(text, p, stop, newline)
                while not _ends(text, p, stop, newline):
                    index, good, p = _corner(text, p, stop, vertex)
                    if not good or corner == len(corners):
                        return _CORNER, min(p, stop - 1), hards, corner
                    corners[corner] = index
                    corner += 1
                    p = _blanks(text, p, stop, newline)
                if corner - first < 3:
                    return _FEW, min(p, stop - 1), hards, corner
                lengths[face] = corner - first
                face += 1
        p = _to_next_line(text, p, stop, newline)
    return _DONE, stop, hards, corner


@inner
def _corner(text, p, stop, vertices):
    """Read ``v``, ``v/vt``, ``v//vn`` or ``v/vt/vn``; return the vertex's row, whether all is well, and the end."""
    _, index, kind, p = scan_number(text, p, stop, True)
    good = kind == INTEGER and index != 0
    slashes = 0
    while good and p < stop and byte_at(text, p) == 47:
        slashes += 1
        p += 1
        if p < stop and byte_at(text, p) > 32 and byte_at(text, p) != 47:
            _, other, kind, p = scan_number(text, p, stop, True)
            good = kind == INTEGER and other != 0
        elif p >= stop or byte_at(text, p) != 47:
            good = False
        good = good and slashes <= 2
    good = good and (p >= stop or byte_at(text, p) <= 32)
    return (index - 1 if index > 0 else vertices + index), good, p
