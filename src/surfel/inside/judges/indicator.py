"""A Poisson-like indicator: the function on a grid whose gradient fits all normals at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import kernel, rows, threads_for
from surfel.core.cast import Floats, as_count
from surfel.inside.holder import HasOperand, as_operand
from surfel.inside.judges.verdict import Verdict
from surfel.inside.operand import Operand

CELL = 1.6
"""Cells are at least so many spacings wide: narrower ones see single surfels."""

NOISY_CELL = 1.25
"""And at least so many standard deviations of the noise."""

FEWEST, MOST = 16, 128
"""Cells along the longest side of the cloud, where their number is chosen."""

ROOM = 1.5
"""The grid is so many times as large as the cloud, which its periodic copies shall not touch."""


class Indicator(NamedTuple):
    """The function on a cubic grid.

    Parameters
    ----------
    grid : Floats, shape (n, n, n)
        About 1 more inside than outside.
    low : Floats, shape (3,)
        The place of the first node, minus the operand's origin.
    cell : float
        How far apart the nodes are.
    level : float
        The value at the surfels: the surface lies there.
    """

    grid: Floats
    low: Floats
    cell: float
    level: float


def judge(cloud: Operand | HasOperand, queries: ArrayLike, *, cells: int | None = None) -> Verdict:
    """Judge places by an indicator function: of all functions on a grid the one whose gradient fits the normals best.

    Every surfel has its say everywhere, so that heavy noise and many flipped normals average out. Details and edges
    below the width of a cell are rounded off.

    Parameters
    ----------
    cloud : Operand or Surfels
        The cloud.
    queries : array_like, shape (q, 3)
        Places, in the coordinates of the cloud.
    cells : int, optional
        Cells along the longest side of the cloud, 4 to 512; by default as many as spacing and noise allow, up to 128.

    Returns
    -------
    Verdict
        ``value`` is the level of the surface minus the indicator, infinite beyond the grid; certain where it is
        larger than 0.15.

    Raises
    ------
    InputError
        If the queries are not finite rows of three or ``cells`` is out of range.

    Notes
    -----
    ``div grad chi = -div V``, where V is the field of area times outward normal, splatted on the grid (Kazhdan et al.,
    *Poisson surface reconstruction*, 2006, eq. 3), solved by the fast Fourier transform.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.judges import indicator
    >>> from surfel.inside.operand import Operand
    >>> p = np.random.default_rng(0).standard_normal((2000, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> flipped = p * np.where(np.arange(2000) % 5, 1.0, -1.0)[:, None]
    >>> indicator.judge(Operand.of(p, flipped), [[0.0, 0, 0.7], [0, 0, 1.3]]).inside.tolist()
    [True, False]
    """
    operand = as_operand(cloud)
    number = None if cells is None else as_count(cells, "cells", 4, 512)
    places = operand.local(queries)
    if not len(operand) or not len(places):
        return Verdict.outside(len(places))
    found = indicator(operand, number)
    value = found.level - _values(found, places)
    return Verdict.of(value, np.abs(value) > 0.15)


def indicator(operand: Operand, cells: int | None = None) -> Indicator:
    """Return the indicator of an operand that has surfels; it is solved for once."""
    number = cells or cells_for(operand)
    found: Indicator = operand._once(f"indicator {number}", lambda: _solve(operand, number))
    return found


def cells_for(operand: Operand) -> int:
    """Return how many cells along the longest side suit the spacing and the noise of a cloud."""
    low, high = operand.bounds
    extent = float((high - low).max())
    width = max(CELL, NOISY_CELL * operand.noise) * operand.spacing
    return int(np.clip(extent / width, FEWEST, MOST)) if width > 0.0 else FEWEST


def _solve(operand: Operand, cells: int) -> Indicator:
    from scipy import fft

    low, high = operand.bounds
    size = int(fft.next_fast_len(int(np.ceil(cells * ROOM)) + 4, real=True))
    cell = max(float((high - low).max()) / cells, 1e-150)
    corner = 0.5 * low + 0.5 * high - 0.5 * cell * (size - 1)
    at = (operand.points - corner) / cell
    spread = np.zeros((size, size, size // 2 + 1), np.complex128)
    square = np.zeros((size, size, size // 2 + 1))
    share = operand.areas / (cell * cell)
    with threads_for(size**3) as threads:
        for axis in range(3):
            field = np.zeros((size, size, size))
            _splat(at, np.ascontiguousarray(operand.normals[:, axis]) * share, field)
            wave = 2.0 * np.pi * (fft.rfftfreq(size) if axis == 2 else fft.fftfreq(size))
            along = wave.reshape([-1 if x == axis else 1 for x in range(3)])
            spread += 1j * along * fft.rfftn(field, workers=threads)
            square += along * along
        square[0, 0, 0] = 1.0
        spread /= square
        spread[0, 0, 0] = 0.0
        grid = np.ascontiguousarray(fft.irfftn(spread, s=(size, size, size), workers=threads))
    found = Indicator(grid, corner, cell, 0.0)
    return found._replace(level=float(np.median(_values(found, operand.points))))


def _values(found: Indicator, places: Floats) -> Floats:
    """Return the indicator at places minus the operand's origin; minus infinity beyond the grid."""
    value = np.empty(len(places))
    with threads_for(2 * len(places)):
        _interpolate(len(places), found.grid, (places - found.low) / found.cell, value)
    return value


@kernel
def _splat(at, amount, field):
    """Add each amount to the eight nodes round its place, in the order of the places."""
    for i in range(len(at)):
        x, y, z = int(at[i, 0]), int(at[i, 1]), int(at[i, 2])
        u, v, w = at[i, 0] - x, at[i, 1] - y, at[i, 2] - z
        for a in range(2):
            for b in range(2):
                share = amount[i] * (u if a else 1.0 - u) * (v if b else 1.0 - v)
                field[x + a, y + b, z] += share * (1.0 - w)
                field[x + a, y + b, z + 1] += share * w


@rows
def _interpolate(first, last, grid, at, value):
    most = len(grid) - 1
    for i in range(first, last):
        px, py, pz = at[i, 0], at[i, 1], at[i, 2]
        if not (0.0 <= px < most and 0.0 <= py < most and 0.0 <= pz < most):
            value[i] = -np.inf
            continue
        x, y, z = int(px), int(py), int(pz)
        u, v, w = px - x, py - y, pz - z
        total = 0.0
        for a in range(2):
            for b in range(2):
                row = (1.0 - w) * grid[x + a, y + b, z] + w * grid[x + a, y + b, z + 1]
                total += row * (u if a else 1.0 - u) * (v if b else 1.0 - v)
        value[i] = total
