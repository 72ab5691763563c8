"""All neighbours within a distance: places that lie together share one walk through the boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, rows, threads_for
from surfel.core.cast import Floats
from surfel.index.blocks import BLOCK, WIDTH, Blocks, collect, gather_group

_CHUNK = 1024
_GROUP = 16


def search_within(
    blocks: Blocks, places: Floats, order: NDArray[np.int32], own: bool, r: float
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return compressed rows of the points within ``r`` of ``places[order]``, counted first and then written.

    With ``own`` the places are the indexed points, and no point is its own neighbour.
    """
    offsets = np.zeros(len(order) + 1, np.int64)
    chunks = -(-len(order) // _CHUNK)
    with threads_for(8 * len(order)):
        _search_chunks(chunks, *blocks, places, order, own, r, offsets, np.empty(0, np.int32), False)
        np.cumsum(offsets, out=offsets)
        neighbours = np.empty(offsets[-1], np.int32)
        _search_chunks(chunks, *blocks, places, order, own, r, offsets, neighbours, True)
    return offsets, neighbours


@rows
def _search_chunks(first, last, points, nodes, levels, places, order, own, r, offsets, neighbours, write):
    square = r * r
    room = len(points) // 48 + WIDTH
    found, spare = np.empty(room, np.int32), np.empty(room, np.int32)
    i = first * _CHUNK
    stop = min(len(order), last * _CHUNK)
    while i < stop:
        count, lx, ly, lz, hx, hy, hz = gather_group(places, order, i, min(stop, i + _GROUP), 2.0 * r)
        collected = collect(nodes, levels, lx, ly, lz, hx, hy, hz, square, found, spare)
        for j in range(i, i + count):
            row = order[j]
            x, y, z = places[row, 0], places[row, 1], places[row, 2]
            self_row = row if own else -1
            begin = offsets[j] if write else -1
            total = _visit(points, found, collected, x, y, z, self_row, square, begin, neighbours)
            if not write:
                offsets[j + 1] = total
        i += count


@inlined
def _visit(points, found, collected, x, y, z, own, square, begin, neighbours):
    """Count the candidates within reach, and write them from ``begin`` on where that is not negative."""
    total = 0
    for k in range(collected):
        start = found[k] * BLOCK
        for row in range(start, start + BLOCK):
            dx, dy, dz = points[3 * row] - x, points[3 * row + 1] - y, points[3 * row + 2] - z
            if (dx * dx + dy * dy) + dz * dz <= square and row != own:
                if begin >= 0:
                    neighbours[begin + total] = row
                total += 1
    return total
