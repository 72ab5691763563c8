"""Cloud-optimised LAZ: which chunks of the octree a box, a level or a resolution needs.

Source: COPC specification 1.0 (hobu, Inc., 2021): the info record, the hierarchy pages and the voxel keys.
"""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

import numpy as np

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.io.las_header import COPC_INFO, LasHeader
from surfel.io.las_laz import Chunk
from surfel.io.options import Options
from surfel.io.source import Source

_INFO, _ENTRY = 160, 32
_DEEPEST = 31
_DAMAGED = "the tree of the file was damaged; read it without bounds, resolution and level, or fetch it again"


class Info(NamedTuple):
    """The cube of the root, the spacing of its points, and where the root page of the hierarchy lies."""

    center: Floats
    half: float
    spacing: float
    page: tuple[int, int]


class Node(NamedTuple):
    """One node of the octree: its key (level, x, y, z) and its chunk."""

    key: tuple[int, int, int, int]
    at: int
    size: int
    points: int


def info_of(source: Source, header: LasHeader) -> Info | None:
    """Return what the first record of a COPC file says; None where the file is no COPC.

    Raises
    ------
    FileFormatError
        If that record cannot be true.
    """
    raw = header.data_of(COPC_INFO)
    if raw is None:
        return None
    if len(raw) != _INFO:
        raise source.error(f"its COPC record has {len(raw)} bytes instead of {_INFO}", "record copc 1", _DAMAGED)
    x, y, z, half, spacing, at, size = struct.unpack_from("<5dQQ", raw)
    fits = header.start <= at <= source.size and 0 < size <= source.size - at and size % _ENTRY == 0
    if not np.isfinite((x, y, z, half, spacing)).all() or half <= 0.0 or spacing <= 0.0 or not fits:
        raise source.error("its COPC record names a cube or a page that cannot be", "record copc 1", _DAMAGED)
    return Info(np.array([x, y, z]), half, spacing, (at, size))


def needed(source: Source, header: LasHeader, info: Info, chunks: list[Chunk], options: Options) -> list[Chunk]:
    """Return the chunks that may hold wanted points, in the file's order.

    Raises
    ------
    FileFormatError
        If the hierarchy does not fit the chunks of the file.
    """
    deepest = _deepest(info, options)
    if deepest is None and options.bounds is None:
        return chunks
    by_place = {chunk.at: chunk for chunk in chunks}
    wanted = []
    for node in _nodes(source, header, info):
        chunk = by_place.get(node.at)
        if chunk is None or (chunk.size, chunk.points) != (node.size, node.points):
            raise source.error(f"the chunk of node {node.key} is none of the file's", f"byte {node.at}", _DAMAGED)
        if (deepest is None or node.key[0] <= deepest) and _touches(node, info, header, options.bounds):
            wanted.append(chunk)
    return sorted(wanted)


def refuse_without_tree(options: Options) -> None:
    """Refuse what only a COPC file can answer.

    Raises
    ------
    InputError
        If a level or a resolution is asked for.
    """
    if options.level is not None or options.resolution is not None:
        name = "level" if options.level is not None else "resolution"
        raise InputError(f"{name} needs a file with levels of detail (COPC); thin this one by every=")


def _deepest(info: Info, options: Options) -> int | None:
    """Return the last level that is wanted: the first whose spacing is not above the resolution."""
    if options.level is not None:
        return options.level
    if options.resolution is None:
        return None
    return max(0, math.ceil(math.log2(info.spacing / options.resolution) - 1e-9))


def _nodes(source: Source, header: LasHeader, info: Info) -> list[Node]:
    """Return all nodes that have points; every page is read once, and there are no more than the file can hold."""
    nodes: list[Node] = []
    pages, seen = [info.page], {info.page[0]}
    read = 0
    while pages:
        at, size = pages.pop()
        read += size
        if read > source.size:
            raise source.error("the pages of its hierarchy are larger than the file", f"byte {at}", _DAMAGED)
        source.stream.seek(at)
        raw = source.take(size).tobytes()
        for i, (level, x, y, z, place, length, points) in enumerate(struct.iter_unpack("<4iQ2i", raw)):
            where = f"byte {at + _ENTRY * i}"
            if not 0 <= level <= _DEEPEST or not all(0 <= k < 1 << level for k in (x, y, z)) or points < -1:
                raise source.error(f"entry {i} of a page has the key {(level, x, y, z)}", where, _DAMAGED)
            if points == 0:
                continue
            if length <= 0 or not header.start <= place <= source.size - length:
                raise source.error(f"entry {i} of a page points to byte {place}", where, _DAMAGED)
            if points > 0:
                nodes.append(Node((level, x, y, z), place, length, points))
            elif place in seen or length % _ENTRY:
                raise source.error(f"entry {i} of a page points to a page that was read before", where, _DAMAGED)
            else:
                seen.add(place)
                pages.append((place, length))
    return nodes


def _touches(node: Node, info: Info, header: LasHeader, box: Floats | None) -> bool:
    """Tell whether the cube of a node meets the box, with two steps of the coordinates to spare."""
    if box is None:
        return True
    side = 2.0 * info.half / (1 << node.key[0])
    low = info.center - info.half + side * np.array(node.key[1:])
    slack = 2.0 * np.abs(header.scale)
    return bool((low - slack <= box[1]).all() and (low + side + slack >= box[0]).all())
