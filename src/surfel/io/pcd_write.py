"""PCD written: binary or ascii, whole or run after run."""

from __future__ import annotations

import re
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from surfel.io.columns import NORMALS, POINTS, RADIUS
from surfel.io.content import Content, Head
from surfel.io.registry import NotStreamed

_BLOCK = 1 << 18
_WIDTH = 15
_LETTERS = {"i": "I", "u": "U", "f": "F"}
_CHANNELS = ("r", "g", "b", "a")

Column = tuple[str, str, NDArray[Any]]
"""The name of a field, its type (with how many values it has), and its values."""


def save(stream: BinaryIO, content: Content, *, ascii: bool = False, suffix: str = ".pcd") -> list[str]:
    """Write a PCD file, binary or ascii.

    Coordinates and normals take single precision where that keeps all digits, as other readers expect it, else double.

    Returns
    -------
    list of str
        What could not be kept.
    """
    lost: list[str] = content.lost_without("normals", "radii", "colors", "attributes")
    columns = _columns(content, lost, ascii)
    stream.write(_header(columns, str(len(content.points)), content, ascii))
    _write_rows(stream, columns, ascii)
    return lost


def writer(stream: BinaryIO, first: Content, head: Head, *, suffix: str) -> Writer:
    """Return a writer of runs of a binary file."""
    return Writer(stream, first)


class Writer:
    """Takes run after run; the count goes into the header at the end."""

    def __init__(self, stream: BinaryIO, first: Content) -> None:
        self.lost: list[str] = []
        self._stream, self._count = stream, 0
        columns = _columns(first, self.lost, False)
        self._types = [kind for _, kind, _ in columns]
        header = _header(columns, "?" * _WIDTH, first, False)
        mark = b"?" * _WIDTH
        self._places = [header.index(mark), header.rindex(mark)]
        stream.write(header)

    def add(self, run: Content) -> None:
        """Write one run.

        Raises
        ------
        NotStreamed
            If it needs double precision and the runs before did not.
        """
        columns = _columns(run, [], False)
        for (_, kind, _), wanted in zip(columns, self._types, strict=True):
            if kind == "<f8" and wanted == "<f4":
                raise NotStreamed
        self._count += len(run.points)
        same = [(name, wanted, values) for (name, _, values), wanted in zip(columns, self._types, strict=True)]
        _write_rows(self._stream, same, False)

    def close(self) -> None:
        """Write the count."""
        for place in self._places:
            self._stream.seek(place)
            self._stream.write(str(self._count).rjust(_WIDTH, "0").encode())
        self._stream.seek(0, 2)


def _header(columns: list[Column], count: str, content: Content, ascii: bool) -> bytes:
    types = [np.dtype(kind) for _, kind, _ in columns]
    known: Any = content.frame.extra.get("pcd") if content.frame is not None else None
    viewpoint = known["viewpoint"] if known is not None else (0, 0, 0, 1, 0, 0, 0)
    lines = [
        "# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7",
        "FIELDS " + " ".join(name for name, _, _ in columns),
        "SIZE " + " ".join(str(t.base.itemsize) for t in types),
        "TYPE " + " ".join(_LETTERS[t.base.kind] for t in types),
        "COUNT " + " ".join(str(t.shape[0] if t.shape else 1) for t in types),
        f"WIDTH {count}", "HEIGHT 1", "VIEWPOINT " + " ".join(f"{number:.17g}" for number in viewpoint),
        f"POINTS {count}", f"DATA {'ascii' if ascii else 'binary'}",
    ]  # fmt: skip
    return ("\n".join(lines) + "\n").encode()


def _write_rows(stream: BinaryIO, columns: list[Column], ascii: bool) -> None:
    record = np.dtype([(name, kind) for name, kind, _ in columns])
    count = len(columns[0][2])
    step = max(1, _BLOCK // record.itemsize)
    block = np.empty(min(step, count), record)
    for first in range(0, count, step):
        rows = block[: min(step, count - first)]
        for name, _, values in columns:
            rows[name] = values[first : first + step]
        if ascii:
            flat = [rows[name].reshape(len(rows), -1).T for name, _, _ in columns]
            words = [map(repr, column.tolist()) for part in flat for column in part]
            stream.write(("\n".join(map(" ".join, zip(*words, strict=True))) + "\n").encode())
        else:
            stream.write(rows.view(np.uint8).data)


def _columns(content: Content, lost: list[str], ascii: bool) -> list[Column]:
    """Return name, type and values of each field; say what has no type in PCD."""
    kind = _float_kind(content.points)
    columns: list[Column] = [(name, kind, content.points[:, i]) for i, name in enumerate(POINTS[0])]
    if content.normals is not None:
        kind = _float_kind(content.normals)
        columns += [(name, kind, content.normals[:, i]) for i, name in enumerate(NORMALS[1])]
    if content.radii is not None:
        columns.append((RADIUS, _float_kind(content.radii), content.radii))
    if content.colors is not None and content.colors.dtype == np.uint8:
        columns.append(_packed(content.colors, ascii))
    elif content.colors is not None:
        for i, name in enumerate(_CHANNELS[: content.colors.shape[1]]):
            _add(columns, name, content.colors[:, i], lost)
    for name, values in content.attributes.items():
        _add(columns, name, values, lost)
    return columns


def _packed(colors: NDArray[np.uint8], ascii: bool) -> Column:
    """Return colors as words; ``rgb`` as floats with these bits, which is what readers know best, but not in text."""
    alpha = colors.shape[1] == 4
    octets = np.zeros((len(colors), 4), np.uint8)
    octets[:, [2, 1, 0]] = colors[:, :3]
    if alpha:
        octets[:, 3] = colors[:, 3]
    words = octets.view("<u4")[:, 0]
    return ("rgba", "<u4", words) if alpha else ("rgb", "<u4", words) if ascii else ("rgb", "<f4", words.view("<f4"))


def _add(columns: list[Column], name: str, values: NDArray[Any], lost: list[str]) -> None:
    flat = values if values.ndim == 1 else values.reshape(len(values), int(np.prod(values.shape[1:])))
    kind = _kind(flat)
    if kind is None or (flat.ndim == 2 and not 1 < flat.shape[1] <= 1 << 16):
        if flat.ndim == 2 and flat.shape[1] == 1 and kind is not None:
            flat = flat[:, 0]
        else:
            lost.append(f"attribute {name!r} of type {values.dtype}")
            return
    word = re.sub(r"\s+", "_", name.strip()).strip("_") or "unnamed"
    taken = {n for n, _, _ in columns}
    while word in taken or word in ("rgb", "rgba"):
        word += "_"
    if word != name:
        lost.append(f"the name {name!r} (written as {word!r})")
    columns.append((word, kind if flat.ndim == 1 else f"({flat.shape[1]},){kind}", flat))


def _kind(values: NDArray[Any]) -> str | None:
    kind, size = values.dtype.kind, values.dtype.itemsize
    if kind == "b":
        return "<u1"
    if kind == "f":
        return "<f4" if size <= 4 else "<f8" if size == 8 else None
    return f"<{kind}{size}" if kind in "iu" else None


def _float_kind(values: NDArray[np.float64]) -> str:
    """Return single precision where it holds all values to the last digit."""
    with np.errstate(over="ignore"):
        exact = (values.astype(np.float32) == values) | np.isnan(values)
    return "<f4" if exact.all() else "<f8"
