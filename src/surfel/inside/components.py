"""Components: free cells that hang together by their faces, found brick by brick with bits, then joined."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, inner, kernel, rows, threads_for

_FIRST_COLUMN = np.uint64(0x0101010101010101)  # z = 0
_LAST_COLUMN = np.uint64(0x8080808080808080)  # z = 7
_NOT_FIRST = np.uint64(0xFEFEFEFEFEFEFEFE)
_NOT_LAST = np.uint64(0x7F7F7F7F7F7F7F7F)
_FIRST_ROW = np.uint64(0xFF)  # y = 0
_NONE = np.uint64(0)
_FULL = np.uint64(0xFFFFFFFFFFFFFFFF)


class Components(NamedTuple):
    """The parts of each brick's free cells, and which component of space each belongs to.

    Parameters
    ----------
    start : NDArray[np.int32], shape (bricks + 1,)
        Parts ``start[b] .. start[b + 1]`` belong to brick b.
    parts : NDArray[np.uint64], shape (parts, 8)
        Their cells, as bits.
    of_part : NDArray[np.int32], shape (parts,)
        The component of each part.
    of_brick : NDArray[np.int32], shape (x, y, z)
        The component of each brick that no disk comes near; -1 for the others.
    number : int
        How many components there are; 0 is the one round everything.
    """

    start: NDArray[np.int32]
    parts: NDArray[np.uint64]
    of_part: NDArray[np.int32]
    of_brick: NDArray[np.int32]
    number: int


def connect(table: NDArray[np.int32], border: NDArray[np.uint64]) -> Components:
    """Find the components of the free cells; the one that holds the first cell, if that is free, is number 0."""
    bricks = len(border)
    start = np.zeros(bricks + 1, np.int32)
    nothing = np.empty((0, 8), np.uint64)
    with threads_for(16 * bricks):
        _split(bricks, border, start, nothing, False)
        np.cumsum(start, out=start)
        parts = np.empty((start[-1], 8), np.uint64)
        _split(bricks, border, start, parts, True)
    of_part, of_brick, count = _join(table, start, parts)
    return Components(start, parts, of_part, of_brick, int(count))


@rows
def _split(first, last, border, start, parts, write):
    """Count the connected parts of each brick's free cells, and then write them."""
    free, part = np.empty(8, np.uint64), np.empty(8, np.uint64)
    for brick in range(first, last):
        for x in range(8):
            free[x] = ~border[brick, x]
        found = 0
        x = 0
        while x < 8:
            if free[x] == _NONE:
                x += 1
                continue
            part[:] = _NONE
            part[x] = free[x] & (~free[x] + np.uint64(1))  # its lowest bit
            _grow(free, part)
            if write:
                for layer in range(8):
                    parts[start[brick] + found, layer] = part[layer]
            for layer in range(8):
                free[layer] &= ~part[layer]
            found += 1
        if not write:
            start[brick + 1] = found


@inner
def _grow(free, part):
    """Grow a part over the free cells that touch it, up and down the layers until nothing is added."""
    changed = True
    while changed:
        changed = False
        for turn in range(16):
            x = turn if turn < 8 else 15 - turn
            before = part[x]
            word = before
            if x > 0:
                word |= part[x - 1]
            if x < 7:
                word |= part[x + 1]
            word &= free[x]
            grown = word
            while True:
                grown = _step(word) & free[x]
                if grown == word:
                    break
                word = grown
            if word != before:
                part[x] = word
                changed = True


@inlined
def _step(word):
    """Add the cells of a layer that touch a cell of the word."""
    eight, one = np.uint64(8), np.uint64(1)
    along = word | ((word & _NOT_LAST) << one) | ((word & _NOT_FIRST) >> one)
    return along | (word << eight) | (word >> eight)


@kernel
def _join(table, start, parts):
    """Join parts and empty bricks over shared faces; number the components, the one of the first cell being 0."""
    nx, ny, nz = table.shape
    node = np.empty(table.shape, np.int32)
    count = len(parts)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                node[i, j, k] = -1
                if table[i, j, k] < 0:
                    node[i, j, k] = count
                    count += 1
    parent = np.arange(count).astype(np.int32)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if i + 1 < nx:
                    _join_pair(table, start, parts, node, parent, i, j, k, i + 1, j, k, 0)
                if j + 1 < ny:
                    _join_pair(table, start, parts, node, parent, i, j, k, i, j + 1, k, 1)
                if k + 1 < nz:
                    _join_pair(table, start, parts, node, parent, i, j, k, i, j, k + 1, 2)
    number = np.full(count, -1, np.int32)
    corner = node[0, 0, 0]
    if corner < 0:
        for part in range(start[table[0, 0, 0]], start[table[0, 0, 0] + 1]):
            if parts[part, 0] & np.uint64(1):
                corner = part
    components = 0
    if corner >= 0:
        number[_root(parent, corner)] = 0
        components = 1
    for n in range(count):
        root = _root(parent, n)
        if number[root] < 0:
            number[root] = components
            components += 1
    of_part = np.empty(len(parts), np.int32)
    for n in range(len(parts)):
        of_part[n] = number[_root(parent, n)]
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if node[i, j, k] >= 0:
                    node[i, j, k] = number[_root(parent, node[i, j, k])]
    return of_part, node, components


@inner
def _join_pair(table, start, parts, node, parent, i, j, k, u, v, w, axis):
    """Join what touches across the face between two bricks, the second one after the first along an axis."""
    a, b = table[i, j, k], table[u, v, w]
    if a < 0 and b < 0:
        _unite(parent, node[i, j, k], node[u, v, w])
    elif a < 0:
        for q in range(start[b], start[b + 1]):
            if touches(parts, q, axis, False):
                _unite(parent, node[i, j, k], q)
    elif b < 0:
        for p in range(start[a], start[a + 1]):
            if touches(parts, p, axis, True):
                _unite(parent, p, node[u, v, w])
    else:
        for p in range(start[a], start[a + 1]):
            for q in range(start[b], start[b + 1]):
                if meet(parts, p, parts, q, axis):
                    _unite(parent, p, q)


@inner
def touches(parts, p, axis, end):
    """Tell whether a part reaches the last (``end``) or the first face of its brick along an axis."""
    if axis == 0:
        return parts[p, 7 if end else 0] != _NONE
    mask = (
        (_LAST_COLUMN if end else _FIRST_COLUMN) if axis == 2 else (_FIRST_ROW << np.uint64(56) if end else _FIRST_ROW)
    )
    some = _NONE
    for layer in range(8):
        some |= parts[p, layer] & mask
    return some != _NONE


@inner
def meet(parts, p, others, q, axis):
    """Tell whether a part and a part of the next brick along an axis have cells face to face."""
    if axis == 0:
        return parts[p, 7] & others[q, 0] != _NONE
    for layer in range(8):
        if axis == 1:
            if (parts[p, layer] >> np.uint64(56)) & others[q, layer] & _FIRST_ROW:
                return True
        elif (parts[p, layer] >> np.uint64(7)) & others[q, layer] & _FIRST_COLUMN:
            return True
    return False


@inlined
def _root(parent, n):
    while parent[n] != n:
        parent[n] = parent[parent[n]]
        n = parent[n]
    return n


@inlined
def _unite(parent, a, b):
    """Join two trees; the smaller number stays the root."""
    a, b = _root(parent, a), _root(parent, b)
    if a < b:
        parent[b] = a
    elif b < a:
        parent[a] = b
