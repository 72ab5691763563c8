"""The header of a PLY file (G. Turk, "The PLY polygon file format", 1994), read strictly."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.io.source import Source

Group = tuple[str, ...]
"""The names of properties that are read together, as x, y and z."""
Columns = dict[Group, NDArray[Any]]
"""The values of each group: (n, k) doubles for k > 1 names, else (n,) in the declared type."""

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST = 1 << 20
_CURE = "the header was changed or is not that of a PLY file; write the file again"


@dataclass(frozen=True)
class Property:
    """One property of an element: its type, and for a list the type of its count."""

    name: str
    type: np.dtype[np.generic]
    count_type: np.dtype[np.generic] | None = None


@dataclass(frozen=True)
class Element:
    """One kind of record: its name, how many there are, and what each holds."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)

    @property
    def lists(self) -> list[Property]:
        """The properties that are lists."""
        return [p for p in self.properties if p.count_type is not None]

    @property
    def least_size(self) -> int:
        """The fewest bytes that a binary record can have: all lists empty."""
        return sum((p.count_type or p.type).itemsize for p in self.properties)


@dataclass(frozen=True)
class Header:
    """A whole header; ``order`` is '' for ascii, '<' or '>' for binary, ``newline`` the byte that ends a line."""

    order: str
    elements: list[Element]
    newline: int

    @property
    def encoding(self) -> str:
        """The format's own word for it."""
        return next(word for word, order in _ORDERS.items() if order == self.order)


def read_header(source: Source) -> Header:
    """Read the header and leave the source at the first byte of the body.

    Raises
    ------
    FileFormatError
        If it is not a header, has no end, or says something that no body can follow; the place is its line.
    """
    lines, newline = _lines(source)
    order = None
    elements: list[Element] = []
    for number, line in enumerate(lines[1:], start=2):
        words = line.split()
        where = f"header line {number}"
        match words:
            case [] | ["comment", *_] | ["obj_info", *_]:
                continue
            case ["format", word, "1.0"] if order is None and not elements:
                if word not in _ORDERS:
                    raise source.error(f"unknown encoding {word!r}", where, f"known: {', '.join(_ORDERS)}")
                order = _ORDERS[word]
            case ["element", name, count]:
                if not (count.isascii() and count.isdigit()) or len(count) > 18:
                    raise source.error(f"{count!r} is not a count of records", where, _CURE)
                if any(e.name == name for e in elements):
                    raise source.error(f"the element {name!r} comes twice", where, _CURE)
                elements.append(Element(name, int(count)))
            case ["property", *_] if elements:
                _add_property(source, elements[-1], words[1:], order or "<", where)
            case _:
                raise source.error(f"cannot read {line[:60]!r}", where, _CURE)
    if order is None:
        raise source.error("the header has no format line", "header", _CURE)
    return Header(order, elements, newline)


def _lines(source: Source) -> tuple[list[str], int]:
    """Return the header's lines before ``end_header``, and the byte that ends a line."""
    head = source.head(_LONGEST)
    if not head.startswith((b"ply\n", b"ply\r", b"ply ", b"ply\t")):
        raise source.error(f"it begins with {head[:8]!r} instead of 'ply'", "byte 0", "it is not a PLY file")
    first = head.splitlines(keepends=True)[0]
    ending = b"\r\n" if first.endswith(b"\r\n") else first[-1:]
    lines: list[str] = []
    start = 0
    while True:
        stop = head.find(ending, start)
        if stop < 0:
            raise source.error("the header has no end_header line", f"byte {len(head)}", "the file was cut or changed")
        line = head[start:stop]
        start = stop + len(ending)
        if line.strip() == b"end_header":
            source.stream.seek(start)
            return lines, ending[-1]
        lines.append(line.decode("utf-8", "replace"))


def _add_property(source: Source, element: Element, words: list[str], order: str, where: str) -> None:
    """Add the property of a header line to its element."""
    match words:
        case ["list", count_type, item_type, name] if count_type in _TYPES and item_type in _TYPES:
            counts = np.dtype(order + _TYPES[count_type])
            if counts.kind == "f":
                raise source.error(f"the list {name!r} is counted in {count_type}, not in whole numbers", where, _CURE)
            added = Property(name, np.dtype(order + _TYPES[item_type]), counts)
        case [scalar_type, name] if scalar_type in _TYPES:
            added = Property(name, np.dtype(order + _TYPES[scalar_type]))
        case _:
            raise source.error(f"cannot read the property {' '.join(words)[:60]!r}", where, _CURE)
    if any(p.name == name for p in element.properties):
        raise source.error(f"the property {name!r} of {element.name!r} comes twice", where, _CURE)
    element.properties.append(added)
