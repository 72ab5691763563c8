"""OBJ (Wavefront): vertices, their colors or normals, and faces.

Texture coordinates, materials and groups are passed over: corners are told by their vertex alone, so that a seam of a
texture doubles no point.
"""

from __future__ import annotations

from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from surfel.core.errors import InputError
from surfel.io.content import Content
from surfel.io.obj_statements import Statements, read_statements
from surfel.io.polygons import fans
from surfel.io.source import Source

_CHUNK = 1 << 15


def load(source: Source) -> Content:
    """Read an OBJ file; polygons become fans of triangles.

    A file without faces is a cloud; its ``vn`` lines are its normals if there is one for each vertex.

    Raises
    ------
    FileFormatError
        At the first line that is no statement of the format, or a face that names a vertex that is not there.
    """
    read = read_statements(source)
    if len(read.vertices) == 0:
        raise source.error("it has no vertices", "the whole file", "it was cut, or it is not an OBJ file")
    wrong = np.flatnonzero((read.corners < 0) | (read.corners >= len(read.vertices)))
    if len(wrong):
        face = int(np.searchsorted(np.cumsum(read.lengths), wrong[0], side="right"))
        raise source.error(
            f"a face names vertex {int(read.corners[wrong[0]]) + 1} of {len(read.vertices)}", f"face {face}",
            "the file was cut or changed; fetch it again",
        )  # fmt: skip
    return _content(read)


def save(stream: BinaryIO, content: Content, *, ascii: bool = True, suffix: str = ".obj") -> list[str]:
    """Write vertices (with colors in 0 to 1 behind them), normals and triangles.

    Raises
    ------
    InputError
        If there are no points.
    """
    if len(content.points) == 0:
        raise InputError("an OBJ file cannot hold a cloud of no points; write .ply or .npz")
    lost = content.lost_without("normals", "colors", "triangles")
    columns = [content.points[:, i] for i in range(3)]
    if content.colors is not None:
        scale = np.iinfo(content.colors.dtype).max if content.colors.dtype.kind in "iu" else 1
        columns += [content.colors[:, i].astype(np.float64) / scale for i in range(3)]
        if content.colors.shape[1] == 4:
            lost.append("the fourth column of the colors")
    stream.write(b"# written by surfel\n")
    write_rows(stream, "v ", columns)
    if content.normals is not None and content.triangles is None:
        write_rows(stream, "vn ", [content.normals[:, i] for i in range(3)])
    elif content.normals is not None:
        lost.append(f"normals of {len(content.points)} points")
    if content.triangles is not None:
        write_rows(stream, "f ", [content.triangles[:, i] + 1 for i in range(3)])
    return lost


def write_rows(stream: BinaryIO, word: str, columns: list[NDArray[Any]]) -> None:
    """Write a word and numbers a line, with all their digits."""
    for first in range(0, len(columns[0]), _CHUNK):
        texts = [map(repr, column[first : first + _CHUNK].tolist()) for column in columns]
        stream.write("".join(f"{word}{' '.join(row)}\n" for row in zip(*texts, strict=True)).encode())


def _content(read: Statements) -> Content:
    """Put the statements together."""
    content = Content(np.ascontiguousarray(read.vertices[:, :3]))
    if (read.widths >= 6).all():
        content.colors = np.ascontiguousarray(read.vertices[:, 3:6])
    faces = len(read.lengths)
    if faces:
        content.triangles = fans(read.corners, read.lengths)
        many = int((read.lengths > 3).sum())
        if many:
            content.notes.append(f"{many} polygons were cut into fans of triangles")
    if len(read.normals) == len(read.vertices) and not faces:
        content.normals = read.normals
    elif len(read.normals):
        content.notes.append(f"{len(read.normals)} normals of corners were passed over")
    if read.others:
        content.notes.append(f"{read.others} points, lines or free-form curves and surfaces were passed over")
    return content
