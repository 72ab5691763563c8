"""PLY: ascii and both binaries, any properties and elements; polygons and strips become triangles."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from surfel.core.cast import Integers
from surfel.io.columns import COLORS, NORMALS, POINTS, RADIUS, content_by_name, first_of
from surfel.io.content import Content, Head
from surfel.io.ply_header import Columns, Element, Group, Header, Property, read_header
from surfel.io.ply_write import save, writer
from surfel.io.polygons import fans, strips
from surfel.io.source import Source

__all__ = ["chunks", "head", "load", "save", "writer"]

_LISTS = ("vertex_indices", "vertex_index")


class _Body(Protocol):
    """What the bodies of both kinds can do, element after element."""

    def scalars(self, element: Element, groups: list[Group]) -> Columns: ...
    def runs(self, element: Element, groups: list[Group], size: int) -> Iterator[Columns]: ...
    def lists(self, element: Element, wanted: Property) -> tuple[Integers, Integers]: ...
    def skip(self, element: Element) -> None: ...
    def finish(self) -> None: ...


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
    body = _body(source, header)
    content: Content | None = None
    faces: list[tuple[Element, Integers]] = []
    notes: list[str] = []
    for element in header.elements:
        corners = _corners(element)
        if element.name == "vertex":
            groups = _groups(source, element, notes)
            content = _content(body.scalars(element, groups), notes)
        elif corners is not None:
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


def chunks(source: Source, size: int) -> Iterator[Content] | None:
    """Yield the points in runs; a file with faces, or with lists among its vertices, is not read so.

    Raises
    ------
    FileFormatError
        As :func:`load` does, once the damage is reached.
    """
    header = read_header(source)
    vertices = next((e for e in header.elements if e.name == "vertex"), None)
    if vertices is None or vertices.lists or any(_corners(e) is not None and e.count for e in header.elements):
        return None
    notes: list[str] = []
    groups = _groups(source, vertices, notes)
    return _runs(_body(source, header), header, groups, notes, size)


def head(source: Source) -> Head | None:
    """Tell what the header says; in a binary file without lists its counts are compared with the file's size."""
    header = read_header(source)
    vertices = next((e for e in header.elements if e.name == "vertex"), None)
    if vertices is None or any(_corners(e) is not None and e.count for e in header.elements):
        return None
    if header.order and not any(e.lists for e in header.elements):
        _compare_size(source, header)
    names = {p.name for p in vertices.properties if p.count_type is None}
    _groups(source, vertices, [])
    normals, colors = first_of(NORMALS, names), first_of(COLORS, names)
    alphas = {"alpha", "diffuse_alpha", "a"} if colors else set()
    rest = names - {*POINTS[0], *(normals or ()), *(colors or ()), RADIUS} - alphas
    attributes = [p.name for p in vertices.properties if p.name in rest]
    return Head(vertices.count, normals is not None, None, RADIUS in names, colors is not None, attributes)


def _body(source: Source, header: Header) -> _Body:
    if header.order == "":
        from surfel.io.ply_ascii import AsciiBody

        return AsciiBody(source, header)
    from surfel.io.ply_binary import BinaryBody

    return BinaryBody(source, header)


def _runs(body: _Body, header: Header, groups: list[Group], notes: list[str], size: int) -> Iterator[Content]:
    for element in header.elements:
        if element.name == "vertex":
            for columns in body.runs(element, groups, size):
                yield _content(columns, notes)
        else:
            body.skip(element)
    body.finish()


def _corners(element: Element) -> Property | None:
    """Return the list that holds the corners of faces or strips, if that is what the element holds."""
    if element.name not in ("face", "tristrips"):
        return None
    return next((p for p in element.lists if p.name in _LISTS), None)


def _groups(source: Source, element: Element, notes: list[str]) -> list[Group]:
    """Return the properties of a vertex, those of points and normals together, and note what is passed over."""
    scalars = [p.name for p in element.properties if p.count_type is None]
    if not set(POINTS[0]) <= set(scalars):
        raise source.error("the element 'vertex' has no x, y and z", "header", "the file holds no points")
    groups = [POINTS[0]]
    normals = first_of(NORMALS, scalars)
    if normals is not None:
        groups.append(normals)
    joined = {name for group in groups for name in group}
    notes += [f"the list {p.name!r} of 'vertex' was passed over" for p in element.lists]
    return groups + [(name,) for name in scalars if name not in joined]


def _content(columns: Columns, notes: list[str]) -> Content:
    """Sort columns into points, normals, colors, radii and attributes."""
    points = columns.pop(POINTS[0])
    normals = next((columns.pop(group) for group in NORMALS if group in columns), None)
    return content_by_name({name: values for (name,), values in columns.items()}, points, normals, notes)


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


def _compare_size(source: Source, header: Header) -> None:
    need = source.position + sum(e.count * e.least_size for e in header.elements)
    if not need <= source.size <= need + 4096:  # line ends at the very end are let pass
        raise source.error(
            f"its header announces {need} bytes, it has {source.size}", f"byte {min(need, source.size)}",
            "the file was cut or its header is wrong; fetch it again",
        )  # fmt: skip
