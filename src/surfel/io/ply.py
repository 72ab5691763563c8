"""PLY: ascii and both binaries, any properties and elements; polygons and strips become triangles."""

from __future__ import annotations

import re
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Integers
from surfel.io.columns import COLORS, NORMALS, POINTS, content_by_name, first_of, flat_columns
from surfel.io.content import Content
from surfel.io.ply_ascii import AsciiBody
from surfel.io.ply_binary import BinaryBody
from surfel.io.ply_header import Element, read_header
from surfel.io.polygons import fans, strips
from surfel.io.source import Source

_LISTS = ("vertex_indices", "vertex_index")
_CHUNK = 1 << 17
_NAMES = {
    "i1": "char",
    "u1": "uchar",
    "i2": "short",
    "u2": "ushort",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}


def load(source: Source) -> Content:
    """Read a PLY file.

    Elements other than ``vertex``, ``face`` and ``tristrips`` (a range grid, a camera) are checked and passed over;
    what a face carries beside its corners is passed over too.

    Raises
    ------
    FileFormatError
        If the file is cut, its header does not fit its body, or a face names a vertex that is not there.
    """
    header = read_header(source)
    body = AsciiBody(source, header) if header.order == "" else BinaryBody(source, header)
    content: Content | None = None
    faces: list[tuple[Element, Integers]] = []
    notes: list[str] = []
    for element in header.elements:
        corners = next((p for p in element.lists if p.name in _LISTS), None)
        if element.name == "vertex":
            content = _points(source, element, body, notes)
        elif element.name in ("face", "tristrips") and corners is not None:
            items, lengths = body.lists(element, corners)
            faces.append((element, _triangles(source, element, items, lengths, notes)))
            others = [p.name for p in element.properties if p is not corners]
            notes += [f"of {element.name!r}, {', '.join(others)} was passed over"] if others else []
        else:
            body.skip(element)
            notes.append(f"the element {element.name!r} ({element.count} records) was passed over")
    body.finish()
    if content is None:
        raise source.error("there is no element 'vertex'", "header", "the file holds no points")
    for element, triangles in faces:
        _check_corners(source, element, triangles, len(content.points))
    if any(len(triangles) for _, triangles in faces):
        content.triangles = np.concatenate([triangles for _, triangles in faces])
    return content


def save(stream: BinaryIO, content: Content, *, ascii: bool = False, suffix: str = "") -> list[str]:
    """Write a PLY file, little-endian or ascii; coordinates in double precision, other values in their own type.

    Returns
    -------
    list of str
        What could not be kept.
    """
    lost: list[str] = []
    columns = _columns(content, lost)
    record = np.dtype([(name, kind) for name, kind, _ in columns])
    lines = ["ply", f"format {'ascii' if ascii else 'binary_little_endian'} 1.0", "comment written by surfel"]
    lines.append(f"element vertex {len(content.points)}")
    lines += [f"property {_NAMES[kind[1:]]} {name}" for name, kind, _ in columns]
    if content.triangles is not None:
        lines += [f"element face {len(content.triangles)}", "property list uchar int vertex_indices"]
    stream.write(("\n".join([*lines, "end_header"]) + "\n").encode())
    for first in range(0, len(content.points), _CHUNK):
        block = np.empty(min(_CHUNK, len(content.points) - first), record)
        for name, _, values in columns:
            block[name] = values[first : first + _CHUNK]
        _write_block(stream, block, ascii)
    for first in range(0, 0 if content.triangles is None else len(content.triangles), _CHUNK):
        assert content.triangles is not None
        corners = content.triangles[first : first + _CHUNK]
        faces = np.empty(len(corners), [("n", "u1"), ("a", "<i4"), ("b", "<i4"), ("c", "<i4")])
        faces["n"] = 3
        for i, name in enumerate("abc"):
            faces[name] = corners[:, i]
        _write_block(stream, faces, ascii)
    return lost


def _points(source: Source, element: Element, body: AsciiBody | BinaryBody, notes: list[str]) -> Content:
    """Read the vertices and sort their properties into points, normals, colors, radii and attributes."""
    scalars = [p.name for p in element.properties if p.count_type is None]
    if not set(POINTS[0]) <= set(scalars):
        raise source.error("the element 'vertex' has no x, y and z", "header", "the file holds no points")
    groups = [POINTS[0]]
    normals = first_of(NORMALS, scalars)
    if normals is not None:
        groups.append(normals)
    joined = {name for group in groups for name in group}
    groups += [(name,) for name in scalars if name not in joined]
    notes += [f"the list {p.name!r} of 'vertex' was passed over" for p in element.lists]
    found = body.scalars(element, groups)
    points = found.pop(POINTS[0])
    stored = None if normals is None else found.pop(normals)
    return content_by_name({name: values for (name,), values in found.items()}, points, stored, notes)


def _triangles(source: Source, element: Element, items: Integers, lengths: Integers, notes: list[str]) -> Integers:
    if element.name == "tristrips":
        if len(items) and int(items.min()) < -1:
            raise source.error("a strip has a corner below -1", f"item {int(items.argmin())}", "the file was changed")
        return strips(items, lengths)
    small = int((lengths < 3).sum())
    if small:
        notes.append(f"{small} faces of fewer than three corners were passed over")
    if (lengths > 3).any():
        notes.append(f"{int((lengths > 3).sum())} polygons were cut into fans of triangles")
    return fans(items, lengths)


def _check_corners(source: Source, element: Element, triangles: Integers, vertices: int) -> None:
    if len(triangles) and not (int(triangles.min()) >= 0 and int(triangles.max()) < vertices):
        wrong = int(np.flatnonzero(((triangles < 0) | (triangles >= vertices)).any(axis=1))[0])
        raise source.error(
            f"a face has the corners {triangles[wrong].tolist()}, but there are {vertices} vertices",
            f"{element.name}, triangle {wrong}", "the file was changed; write it again",
        )  # fmt: skip


def _columns(content: Content, lost: list[str]) -> list[tuple[str, str, NDArray[Any]]]:
    """Return name, type and values of each property to be written; say what has no type in PLY."""
    columns: list[tuple[str, str, NDArray[Any]]] = [(n, "<f8", content.points[:, i]) for i, n in enumerate(POINTS[0])]
    if content.normals is not None:
        columns += [(n, "<f8", content.normals[:, i]) for i, n in enumerate(NORMALS[0])]
    if content.radii is not None:
        columns.append(("radius", "<f8", content.radii))
    if content.colors is not None:
        for i, name in enumerate([*COLORS[0], "alpha"][: content.colors.shape[1]]):
            _add_column(columns, name, content.colors[:, i], lost)
    for name, values in content.attributes.items():
        flat = flat_columns(values)
        for i in range(flat.shape[1]):
            _add_column(columns, name if values.ndim == 1 else f"{name}_{i}", flat[:, i], lost)
    return columns


def _add_column(columns: list[tuple[str, str, NDArray[Any]]], name: str, values: NDArray[Any], lost: list[str]) -> None:
    kind = _kind(values)
    word = re.sub(r"\s+", "_", name.strip()) or "unnamed"
    taken = {n for n, _, _ in columns}
    while word in taken:
        word += "_"
    if kind is None:
        lost.append(f"attribute {name!r} of type {values.dtype}")
        return
    if word != name:
        lost.append(f"the name {name!r} (written as {word!r})")
    columns.append((word, kind, values))


def _kind(values: NDArray[Any]) -> str | None:
    """Return the PLY type that holds the values without loss, or None."""
    kind = values.dtype.kind
    if kind == "b":
        return "|u1"
    if kind == "f" and values.dtype.itemsize <= 8:
        return "<f4" if values.dtype.itemsize <= 4 else "<f8"
    if kind not in "iu":
        return None
    if values.dtype.itemsize < 8:
        return f"<{values.dtype.kind}{values.dtype.itemsize}"
    low, high = (int(values.min()), int(values.max())) if len(values) else (0, 0)
    for choice in ("i4", "u4"):
        if np.iinfo(choice).min <= low and high <= np.iinfo(choice).max:
            return f"<{choice}"
    return "<f8" if low >= -(2**53) and high <= 2**53 else None


def _write_block(stream: BinaryIO, block: NDArray[Any], ascii: bool) -> None:
    if not ascii:
        stream.write(block.view(np.uint8).data)
        return
    words = [map(repr, block[name].tolist()) for name in block.dtype.names or ()]
    stream.write(("\n".join(map(" ".join, zip(*words, strict=True))) + "\n").encode())
