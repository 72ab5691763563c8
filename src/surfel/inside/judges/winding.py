"""The generalised winding number: how often the surfels go round a place, added up by a tree of dipoles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import inlined, inner, kernel, rows, threads_for
from surfel.core.cast import Floats, as_positive
from surfel.core.errors import InputError
from surfel.index.blocks import BLOCK, WIDTH, gather_group
from surfel.index.hilbert import hilbert_order
from surfel.inside.holder import HasOperand, as_operand
from surfel.inside.judges.verdict import Verdict
from surfel.inside.operand import Operand

SOFT = 0.3
"""What is added to the squared distance from a surfel, in areas of it: a disk is no point."""

_GROUP = 16  # places that share a walk through the tree
_SIDE = 8.0  # spacings: the longest side of the box of such a group
_ROOM = 1024  # dipoles that are collected before they are added up
_STACK = 256
_PART = 1024  # places of a part of the work, which no group crosses; the same on any number of threads
_FAR = 1e60  # extents: places beyond are taken as there, where the winding number is 0 as well


class DipoleTree(NamedTuple):
    """Dipoles of surfels and of what is above them, in lengths of the cloud's extent, about its middle.

    Nodes are numbered level by level, from blocks of 16 surfels to the root; each has eight children.

    Parameters
    ----------
    surfels : Floats, shape (7, n)
        Place, area times normal, and what softens the distance.
    nodes : Floats, shape (8, m)
        The mean place by area, the summed dipole, the squared radius of a ball about that place that holds all, the
        area.
    levels : NDArray[np.int64], shape (levels + 1,)
        Where the nodes of each level start.
    middle : Floats, shape (3,)
        Subtracted from places first.
    scale : float
        Then multiplied.
    """

    surfels: Floats
    nodes: Floats
    levels: NDArray[np.int64]
    middle: Floats
    scale: float


def judge(cloud: Operand | HasOperand, queries: ArrayLike, *, beta: float = 2.0) -> Verdict:
    """Judge places by the winding number ``w(x) = sum a_i n_i . (p_i - x) / (4 pi |p_i - x|^3)``: inside above 1/2.

    It looks at all surfels, and so stands flipped normals and holes; it is rough within a spacing of the surface.

    Parameters
    ----------
    cloud : Operand or Surfels
        The cloud.
    queries : array_like, shape (q, 3)
        Places, in the coordinates of the cloud.
    beta : float
        A node of the tree is taken as one dipole from farther away than this many of its radii.

    Returns
    -------
    Verdict
        ``value`` is 1/2 - w; certain where w is not between 1/4 and 3/4.

    Raises
    ------
    InputError
        If the queries are not finite rows of three or ``beta`` is not at least 1.

    Notes
    -----
    Barill et al., *Fast winding numbers for soups and clouds*, 2018, eq. 2 (point clouds), by the tree of Barnes and
    Hut with one dipole a node.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.judges import winding
    >>> from surfel.inside.operand import Operand
    >>> p = np.random.default_rng(0).standard_normal((900, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> winding.judge(Operand.of(p, p), [[0.0, 0, 0.5], [0, 0, 1.5]]).inside.tolist()
    [True, False]
    """
    operand = as_operand(cloud)
    value = 0.5 - winding_numbers(operand, queries, beta=beta)
    return Verdict.of(value, np.abs(value) > 0.25)


def winding_numbers(operand: Operand, queries: ArrayLike, *, beta: float = 2.0) -> Floats:
    """Return the winding number of the surfels round each place, shape (q,): about 1 inside and 0 outside."""
    opening = as_positive(beta, "beta")
    if opening < 1.0:
        raise InputError(f"beta must be at least 1: a node cannot be seen as one dipole from within; got {opening:g}")
    places = operand.local(queries)
    if not len(operand) or not len(places):
        return np.zeros(len(places))
    tree = dipole_tree(operand)
    scaled = np.clip((places - tree.middle) * tree.scale, -_FAR, _FAR)
    number = np.empty(len(places))
    side = _SIDE * operand.spacing * tree.scale
    with threads_for(100 * len(places)):
        _add_up(
            -(-len(places) // _PART), tree.surfels, tree.nodes, tree.levels, scaled, hilbert_order(scaled), side,
            opening * opening, number,
        )  # fmt: skip
    return number


def dipole_tree(operand: Operand) -> DipoleTree:
    """Return the tree of an operand that has surfels; it is built once."""
    tree: DipoleTree = operand._once("dipoles", lambda: _build(operand))
    return tree


def _build(operand: Operand) -> DipoleTree:
    n = len(operand)
    low, high = operand.bounds
    extent = float((high * 0.5 - low * 0.5).max()) * 2.0
    scale = 1.0 / extent if extent > 0.0 else 1.0
    middle = low * 0.5 + high * 0.5
    counts = [-(-n // BLOCK)]
    while counts[-1] > 1:
        counts.append(-(-counts[-1] // WIDTH))
    levels = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    nodes = np.zeros((8, levels[-1]))
    surfels = np.empty((7, n))
    with threads_for(n):
        _sum_blocks(counts[0], operand.points, operand.normals, operand.areas, middle, scale, surfels, nodes)
    _sum_levels(nodes, levels)
    return DipoleTree(surfels, nodes, levels, middle, scale)


@rows
def _sum_blocks(first, last, points, normals, areas, middle, scale, surfels, nodes):
    for b in range(first, last):
        start, stop = b * BLOCK, min(surfels.shape[1], (b + 1) * BLOCK)
        for i in range(start, stop):
            area = areas[i] * scale * scale
            for x in range(3):
                surfels[x, i] = (points[i, x] - middle[x]) * scale
                surfels[3 + x, i] = normals[i, x] * area
            surfels[6, i] = SOFT * area
            weight = area + 1e-300
            nodes[7, b] += weight
            for x in range(3):
                nodes[x, b] += weight * surfels[x, i]
                nodes[3 + x, b] += surfels[3 + x, i]
        for x in range(3):
            nodes[x, b] /= nodes[7, b]
        for i in range(start, stop):
            dx, dy, dz = surfels[0, i] - nodes[0, b], surfels[1, i] - nodes[1, b], surfels[2, i] - nodes[2, b]
            nodes[6, b] = max(nodes[6, b], dx * dx + dy * dy + dz * dz)


@kernel
def _sum_levels(nodes, levels):
    for level in range(1, len(levels) - 1):
        for b in range(levels[level], levels[level + 1]):
            start = levels[level - 1] + (b - levels[level]) * WIDTH
            stop = min(levels[level], start + WIDTH)
            for c in range(start, stop):
                nodes[7, b] += nodes[7, c]
                for x in range(3):
                    nodes[x, b] += nodes[7, c] * nodes[x, c]
                    nodes[3 + x, b] += nodes[3 + x, c]
            for x in range(3):
                nodes[x, b] /= nodes[7, b]
            radius = 0.0
            for c in range(start, stop):
                dx, dy, dz = nodes[0, c] - nodes[0, b], nodes[1, c] - nodes[1, b], nodes[2, c] - nodes[2, b]
                radius = max(radius, math.sqrt(dx * dx + dy * dy + dz * dz) + math.sqrt(nodes[6, c]))
            nodes[6, b] = radius * radius


@rows
def _add_up(first, last, surfels, nodes, levels, places, order, side, opening, number):
    batch, terms = np.empty((7, _ROOM + BLOCK)), np.empty(_ROOM + BLOCK)
    stack = np.empty(_STACK, np.int64)
    stop = min(len(order), last * _PART)
    i = first * _PART
    while i < stop:
        end = min(stop, i - i % _GROUP + _GROUP)
        count, mx, my, mz, radius = _group(places, order, i, end, side)
        for j in range(i, i + count):
            number[order[j]] = 0.0
        held = 0
        stack[0], height = ((len(levels) - 2) << 40), 1  # the level, then the place in it
        while height > 0:
            height -= 1
            level, place = stack[height] >> 40, stack[height] & 0xFFFFFFFFFF
            node = levels[level] + place
            dx, dy, dz = nodes[0, node] - mx, nodes[1, node] - my, nodes[2, node] - mz
            gap = max(math.sqrt(dx * dx + dy * dy + dz * dz) - radius, 0.0)
            if gap * gap > opening * nodes[6, node]:
                for x in range(6):
                    batch[x, held] = nodes[x, node]
                batch[6, held] = 0.0
                held += 1
            elif level == 0:
                for s in range(place * BLOCK, min(surfels.shape[1], (place + 1) * BLOCK)):
                    for x in range(7):
                        batch[x, held] = surfels[x, s]
                    held += 1
            else:
                for c in range(place * WIDTH, min(levels[level] - levels[level - 1], (place + 1) * WIDTH)):
                    stack[height] = ((level - 1) << 40) | c
                    height += 1
            if held >= _ROOM or height == 0:
                for j in range(i, i + count):
                    row = order[j]
                    number[row] += sum_dipoles(batch, held, places[row, 0], places[row, 1], places[row, 2], terms)
                held = 0
        i += count


@inner
def _group(places, order, first, stop, side):
    """Return how many of the next places fit a box of this side, at least one, its middle and its half diagonal."""
    count, lx, ly, lz, hx, hy, hz = gather_group(places, order, first, stop, side)
    dx, dy, dz = hx - lx, hy - ly, hz - lz
    middle = 0.5 * (lx + hx), 0.5 * (ly + hy), 0.5 * (lz + hz)
    return count, middle[0], middle[1], middle[2], 0.5 * math.sqrt(dx * dx + dy * dy + dz * dz)


@inlined
def sum_dipoles(batch, count, x, y, z, terms):
    """Return the winding number of the collected dipoles: terms by whole vectors, then eight sums side by side."""
    xs, ys, zs, us, vs, ws, soft = batch[0], batch[1], batch[2], batch[3], batch[4], batch[5], batch[6]
    for t in range(count):
        dx, dy, dz = xs[t] - x, ys[t] - y, zs[t] - z
        square = max(dx * dx + dy * dy + dz * dz + soft[t], 1e-200)
        terms[t] = (us[t] * dx + vs[t] * dy + ws[t] * dz) / (square * math.sqrt(square))
    for t in range(count, -(-count // 8) * 8):
        terms[t] = 0.0
    a = b = c = d = e = f = g = h = 0.0
    for t in range(0, count, 8):
        a += terms[t]
        b += terms[t + 1]
        c += terms[t + 2]
        d += terms[t + 3]
        e += terms[t + 4]
        f += terms[t + 5]
        g += terms[t + 6]
        h += terms[t + 7]
    return (((a + b) + (c + d)) + ((e + f) + (g + h))) * (0.25 / math.pi)
