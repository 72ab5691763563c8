"""E57 (ASTM E2807): several scans, each moved by its pose into one system of coordinates; written as one scan.

The pages with their checksums, the description and the packets are read here, so that no damaged file reaches a library
that may end the process, and nothing has to be installed for it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.io.content import Content, Frame, Head
from surfel.io.e57_packets import runs
from surfel.io.e57_pages import Pages
from surfel.io.e57_tree import OWN, Number, Scan, scans_of
from surfel.io.scan_lines import joined
from surfel.io.source import Source

_RUN = 1 << 20
_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_NORMALS = ("normalX", "normalY", "normalZ")
_COLORS = ("colorRed", "colorGreen", "colorBlue")
_INVALID = ("cartesianInvalidState", "sphericalInvalidState")


def load(source: Source) -> Content:
    """Read all scans.

    Points are moved by the pose of their scan. Those that the scanner marked as invalid are dropped, and the notes
    count them. Colors keep the type of the file where all scans have the same; values that only some scans have are nan
    or 0 elsewhere. Where there are several scans, the attribute ``scan`` numbers them from 0.

    Raises
    ------
    FileFormatError
        If a page does not match its checksum, or the description does not fit what is there.
    """
    return joined(list(chunks(source, _RUN)))


def chunks(source: Source, size: int) -> Iterator[Content]:
    """Read run after run of at most ``size`` points; the notes count what was invalid within a run.

    Raises
    ------
    FileFormatError
        As :func:`load` does.
    """
    pages = Pages(source)
    scans, crs = scans_of(source, pages.xml)
    layout = _Layout(source, scans)
    frame = Frame(crs=crs, extra={"e57": {"scans": [_told(scan) for scan in scans]}})
    empty = True
    for index, scan in enumerate(scans):
        for arrays in runs(pages, scan, size):
            values = {n.name: a for n, a in zip(scan.numbers, arrays, strict=True) if a is not None}
            yield layout.content(scan, index, values, frame)
            empty = False
    if empty:
        yield layout.nothing(frame)


def head(source: Source) -> Head | None:
    """Return None: how many points are valid only the points tell."""
    return None


def save(stream: BinaryIO, content: Content, *, ascii: bool = False, suffix: str = ".e57") -> list[str]:
    """Write one scan: doubles, normals, colors, and every attribute of numbers that has a name XML allows."""
    from surfel.io.e57_write import written

    return written(stream, content)


class _Layout:
    """Which columns all scans together have, so that every run has the same ones in the same types."""

    def __init__(self, source: Source, scans: list[Scan]) -> None:
        self._several = len(scans) > 1
        self.attributes: dict[str, np.dtype[Any]] = {}
        self.colors: np.dtype[Any] | None = None
        self.normals = False
        for scan in scans:
            numbers = {number.name: number for number in scan.numbers if number.kind != "skipped"}
            if not numbers.keys() >= set(_CARTESIAN) and not numbers.keys() >= set(_SPHERICAL):
                raise source.error(
                    f"the points of {scan.name!r} have neither x, y and z nor range, azimuth and elevation",
                    "description", "write it again with coordinates",
                )  # fmt: skip
            if numbers.keys() >= set(_COLORS):
                here = np.result_type(*(_color_type(numbers[name]) for name in _COLORS))
                self.colors = here if self.colors is None else np.promote_types(self.colors, here)
            self.normals |= numbers.keys() >= set(_NORMALS)
            for name, number in numbers.items():
                if name not in (*_places(numbers), *_INVALID, *_taken(numbers)):
                    dtype, key = number.dtype, _snake(name)
                    old = self.attributes.get(key)
                    self.attributes[key] = dtype if old is None else np.promote_types(old, dtype)

    def content(self, scan: Scan, index: int, values: dict[str, NDArray[Any]], frame: Frame) -> Content:
        """Return the valid points of a run of one scan."""
        valid = ~np.any([values[name] != 0 for name in _INVALID if name in values], axis=0)
        if valid.ndim:  # there is such a state
            lost = int(len(valid) - valid.sum())
            values = {name: array[valid] for name, array in values.items()}
        else:
            lost = 0
        points = _points(values) @ scan.rotation.T + scan.translation
        content = Content(points, frame=frame)
        if lost:
            content.notes.append(f"{lost} points of {scan.name!r} that the scanner marked as invalid were dropped")
        count = len(points)
        if self.normals:
            content.normals = np.zeros((count, 3))
            if values.keys() >= set(_NORMALS):
                content.normals = np.stack([values[n] for n in _NORMALS], axis=1).astype(np.float64) @ scan.rotation.T
        if self.colors is not None:
            content.colors = np.zeros((count, 3), self.colors)
            if values.keys() >= set(_COLORS):
                content.colors = np.stack([values[n] for n in _COLORS], axis=1).astype(self.colors)
        by_key = {_snake(name): array for name, array in values.items()}
        for key, dtype in self.attributes.items():
            content.attributes[key] = by_key[key].astype(dtype) if key in by_key else _missing(count, dtype)
        if self._several:
            content.attributes["scan"] = np.full(count, index, np.int32)
        return content

    def nothing(self, frame: Frame) -> Content:
        """Return a content of no points with all columns."""
        content = Content(np.empty((0, 3)), normals=np.empty((0, 3)) if self.normals else None, frame=frame)
        content.colors = None if self.colors is None else np.empty((0, 3), self.colors)
        content.attributes = {key: np.empty(0, dtype) for key, dtype in self.attributes.items()}
        if self._several:
            content.attributes["scan"] = np.empty(0, np.int32)
        return content


def _points(values: dict[str, NDArray[Any]]) -> Floats:
    if values.keys() >= set(_CARTESIAN):
        return np.stack([values[name].astype(np.float64) for name in _CARTESIAN], axis=1)
    r, azimuth, elevation = (values[name].astype(np.float64) for name in _SPHERICAL)
    flat = r * np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), r * np.sin(elevation)], axis=1)


def _places(numbers: dict[str, Number]) -> tuple[str, ...]:
    """Return the names of the coordinates that are used."""
    return _CARTESIAN if numbers.keys() >= set(_CARTESIAN) else _SPHERICAL


def _taken(numbers: dict[str, Number]) -> tuple[str, ...]:
    """Return the names that become normals and colors."""
    return tuple(n for group in (_NORMALS, _COLORS) if numbers.keys() >= set(group) for n in group)


def _color_type(number: Number) -> np.dtype[Any]:
    """Return the type of a color: bytes or words as the file has them, floats otherwise."""
    if number.kind == "integer" and number.low >= 0 and number.high <= 65535:
        return np.dtype(np.uint8 if number.high <= 255 else np.uint16)
    return np.dtype(np.float64)


def _missing(count: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    return np.full(count, np.nan if dtype.kind == "f" else 0, dtype)


def _snake(name: str) -> str:
    """Return a name as attributes have it: ``rowIndex`` is ``row_index``; what surfel wrote keeps its name."""
    if name.startswith(OWN):
        return name.removeprefix(OWN)
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def _told(scan: Scan) -> dict[str, object]:
    return {
        "name": scan.name, "guid": scan.guid, "points": scan.count, "rotation": scan.rotation.tolist(),
        "translation": scan.translation.tolist(),
    }  # fmt: skip
