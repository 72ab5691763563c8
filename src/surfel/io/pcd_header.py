"""The header of a PCD file (the Point Cloud Library's format, version 0.7 and before), read strictly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfel.io.source import Source

_LONGEST = 1 << 20
_CURE = "the header was changed or is not that of a PCD file; write the file again"
_TYPES = {
    ("I", "1"): "<i1", ("I", "2"): "<i2", ("I", "4"): "<i4", ("I", "8"): "<i8", ("U", "1"): "<u1", ("U", "2"): "<u2",
    ("U", "4"): "<u4", ("U", "8"): "<u8", ("F", "4"): "<f4", ("F", "8"): "<f8",
}  # fmt: skip
_KEYS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")
PADDING = "_"


@dataclass(frozen=True)
class Field:
    """One value of a point, or several under one name."""

    name: str
    type: np.dtype[np.generic]
    count: int


@dataclass(frozen=True)
class PcdHeader:
    """A whole header; ``start`` is the first byte of the body."""

    version: str
    fields: list[Field]
    width: int
    height: int
    viewpoint: tuple[float, ...]
    data: str
    start: int
    newline: int

    @property
    def points(self) -> int:
        """How many points there are."""
        return self.width * self.height

    @property
    def record(self) -> np.dtype[np.void]:
        """One point in a binary file, fields one after the other; those of padding have names of their own."""
        names = [f.name if f.name != PADDING else f"{PADDING}{i}" for i, f in enumerate(self.fields)]
        formats = [f.type if f.count == 1 else (f.type, (f.count,)) for f in self.fields]
        return np.dtype({"names": names, "formats": formats})


def read_header(source: Source) -> PcdHeader:
    """Read the header and leave the source at the first byte of the body.

    Raises
    ------
    FileFormatError
        If it is not a header, has no end, or says something that no body can follow; the place is its line.
    """
    said, lines_of, start, newline = _lines(source)

    def refuse(key: str, problem: str) -> Exception:
        return source.error(problem, f"header line {lines_of.get(key, max(lines_of.values()))}", _CURE)

    for key in ("FIELDS", "SIZE", "TYPE", "WIDTH", "DATA"):
        if key not in said:
            raise refuse(key, f"the header has no {key}")
    names = said["FIELDS"]
    counts = said.get("COUNT", ["1"] * len(names))
    if not names or not len(names) == len(said["SIZE"]) == len(said["TYPE"]) == len(counts):
        raise refuse("COUNT", f"FIELDS, SIZE, TYPE and COUNT name {len(names)}, {len(said['SIZE'])}, "
                     f"{len(said['TYPE'])} and {len(counts)} fields")  # fmt: skip
    fields = []
    for name, size, kind, count in zip(names, said["SIZE"], said["TYPE"], counts, strict=True):
        if (kind.upper(), size) not in _TYPES:
            raise refuse("TYPE", f"the field {name!r} has the unknown type {kind} of {size} bytes")
        if not _is_count(count) or not 1 <= int(count) <= 1 << 16:
            raise refuse("COUNT", f"the field {name!r} has the count {count!r}")
        fields.append(Field(name, np.dtype(_TYPES[kind.upper(), size]), int(count)))
    held = [f.name for f in fields if f.name != PADDING]
    if len(set(held)) != len(held):
        raise refuse("FIELDS", "a field comes twice")
    if not {"x", "y", "z"} <= set(held) or any(f.count != 1 for f in fields if f.name in ("x", "y", "z")):
        raise refuse("FIELDS", f"the fields are {', '.join(held)}; x, y and z are needed")
    width, height = _whole(refuse, said, "WIDTH"), _whole(refuse, said, "HEIGHT", 1)
    if "POINTS" in said and _whole(refuse, said, "POINTS") != width * height:
        raise refuse("POINTS", f"POINTS is {said['POINTS'][0]}, but WIDTH times HEIGHT is {width * height}")
    if said["DATA"] not in (["ascii"], ["binary"], ["binary_compressed"]):
        raise refuse("DATA", f"DATA is {' '.join(said['DATA'])!r}; known are ascii, binary and binary_compressed")
    return PcdHeader(
        " ".join(said.get("VERSION", [""])), fields, width, height, _viewpoint(refuse, said), said["DATA"][0], start,
        newline,
    )  # fmt: skip


def _lines(source: Source) -> tuple[dict[str, list[str]], dict[str, int], int, int]:
    """Return the words behind each key, the key's line, where the body begins and which byte ends a line."""
    head = source.head(_LONGEST)
    newline = b"\r" if b"\n" not in head[:4096] and b"\r" in head[:4096] else b"\n"
    said: dict[str, list[str]] = {}
    lines_of: dict[str, int] = {}
    start, number = 0, 0
    while "DATA" not in said:
        stop = head.find(newline, start)
        number += 1
        if stop < 0:
            raise source.error("the header has no DATA line", f"byte {len(head)}, header line {number}",
                               "the file was cut or changed")  # fmt: skip
        words = head[start:stop].decode("utf-8", "replace").split()
        start = stop + 1
        if not words or words[0].startswith("#"):
            continue
        key = {"COLUMNS": "FIELDS"}.get(words[0].upper(), words[0].upper())
        if key not in _KEYS or key in said:
            raise source.error(f"cannot read {' '.join(words)[:60]!r}", f"header line {number}", _CURE)
        said[key], lines_of[key] = words[1:], number
    said["DATA"] = [word.lower() for word in said["DATA"]]
    source.stream.seek(start)
    return said, lines_of, start, newline[0]


def _is_count(word: str) -> bool:
    return word.isascii() and word.isdigit() and len(word) <= 15


def _whole(refuse: object, said: dict[str, list[str]], key: str, default: int | None = None) -> int:
    words = said.get(key)
    if words is None and default is not None:
        return default
    if words is None or len(words) != 1 or not _is_count(words[0]):
        raise refuse(key, f"{key} is {' '.join(words or [])[:40]!r}, not a count")  # type: ignore[operator]
    return int(words[0])


def _viewpoint(refuse: object, said: dict[str, list[str]]) -> tuple[float, ...]:
    """Return where the sensor stood: three coordinates and a quaternion."""
    words = said.get("VIEWPOINT", ["0", "0", "0", "1", "0", "0", "0"])
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        numbers = ()
    if len(numbers) != 7:
        raise refuse("VIEWPOINT", f"VIEWPOINT is {' '.join(words)[:60]!r}, not seven numbers")  # type: ignore[operator]
    return numbers
