"""Sight: which free space lies before a surfel and which behind it, and whether another sheet lies between."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel, rows, threads_for
from surfel.core.cast import Booleans, Floats
from surfel.inside.grid import bit_of
from surfel.inside.operand import Operand
from surfel.inside.owners import owner_of
from surfel.inside.space import Space

_COHERENT = 0.3  # mean normals shorter than this say nothing
_OPPOSED = -0.2  # cosine, with the surfel's own cell, at which another sheet is taken to begin
_STRIDE = 0.35  # steps of the walk, in cells


class Sight(NamedTuple):
    """What some surfels see before (0) and behind (1) them.

    Parameters
    ----------
    chosen : NDArray[np.int32], shape (m,)
        Which surfels.
    guarded, seen : NDArray[np.int32], shape (m, 2)
        The first free component, -1 for none; ``guarded`` only where their own sheet alone lies before it.
    depth : Floats, shape (m, 2)
        How far off it is.
    cells : NDArray[np.int32], shape (m, 2, 3)
        The cell of it that is seen; the one looked at last where nothing is.
    """

    chosen: NDArray[np.int32]
    guarded: NDArray[np.int32]
    seen: NDArray[np.int32]
    depth: Floats
    cells: NDArray[np.int32]


def look(space: Space, operand: Operand, chosen: NDArray[np.int32]) -> Sight:
    """Let some surfels look before and behind them."""
    n = len(chosen)
    guarded, seen, depth = np.empty((n, 2), np.int32), np.empty((n, 2), np.int32), np.empty((n, 2))
    cells = np.empty((n, 2, 3), np.int32)
    frame = space.frame
    with threads_for(4 * n):
        _look(
            n, chosen, operand.points, operand.normals, frame.low, frame.step, *space.bricks[:2], *space.parts[:4],
            *space.owners, guarded, seen, depth, cells,
        )  # fmt: skip
    depth *= frame.step
    return Sight(chosen, guarded, seen, depth, cells)


def cells_seen(sight: Sight, side: int, of_components: Booleans) -> NDArray[np.int32]:
    """Return the cells of some components that surfels see before (0) or behind (1) them."""
    found: NDArray[np.int32] = _cells_seen(sight.guarded, sight.cells, np.int64(side), of_components)
    return found


@kernel
def _cells_seen(guarded, cells, side, of_components):
    found = np.empty((len(guarded), 3), np.int32)
    count = 0
    for n in range(len(guarded)):
        component = guarded[n, side]
        if component >= 0 and of_components[component]:
            for axis in range(3):
                found[count, axis] = cells[n, side, axis]
            count += 1
    return found[:count]


@rows
def _look(
    first, last, chosen, points, normals, low, step, table, border, start, parts, of_part, of_brick, base, owned,
    of_surfel, means, guarded, seen, depth, cells,
):  # fmt: skip
    """Write the first free component before and behind each surfel, how far off it is, and where its own sheet alone
    lies before it once more.

    A plane's border ends within (|dx| + |dy| + |dz|) cells along its normal. Nothing is seen farther than a stride
    beyond that. The walk is written out here: as a function it would count references to a dozen arrays at each call.
    """
    inverse = 1.0 / step
    nx, ny, nz = 8 * table.shape[0], 8 * table.shape[1], 8 * table.shape[2]
    for row in range(first, last):
        n = chosen[row]
        x, y, z = (
            (points[n, 0] - low[0]) * inverse,
            (points[n, 1] - low[1]) * inverse,
            (points[n, 2] - low[2]) * inverse,
        )
        own = of_surfel[n]
        mx, my, mz = means[own, 0], means[own, 1], means[own, 2]
        square = mx * mx + my * my + mz * mz
        far = abs(normals[n, 0]) + abs(normals[n, 1]) + abs(normals[n, 2]) + _STRIDE
        for side in range(2):
            sign = 1.0 if side == 0 else -1.0
            dx, dy, dz = sign * normals[n, 0], sign * normals[n, 1], sign * normals[n, 2]
            clear = square > _COHERENT * _COHERENT
            component = np.int64(-1)
            t = 0.0
            last_cell = np.int64(-1)
            i = j = k = np.int64(-1)
            while t < far and far > 0.5 and component < 0:
                t += _STRIDE
                i, j, k = np.int64(x + t * dx), np.int64(y + t * dy), np.int64(z + t * dz)
                cell = (i << 40) | (j << 20) | k
                if cell == last_cell:
                    continue
                last_cell = cell
                if min(min(i, j), k) < 0 or i >= nx or j >= ny or k >= nz:
                    component = 0
                    break
                brick = table[i >> 3, j >> 3, k >> 3]
                if brick < 0:
                    component = of_brick[i >> 3, j >> 3, k >> 3]
                    break
                bit = bit_of(j & 7, k & 7)
                if border[brick, i & 7] & bit == np.uint64(0):
                    for part in range(start[brick], start[brick + 1]):
                        if parts[part, i & 7] & bit:
                            component = of_part[part]
                            break
                    break
                other = owner_of(owned[brick, i & 7], base[brick, i & 7], bit)
                if other >= 0 and clear:
                    across = means[other, 0] * mx + means[other, 1] * my + means[other, 2] * mz
                    clear = across >= _OPPOSED * square
            seen[row, side] = component
            depth[row, side] = t
            cells[row, side, 0], cells[row, side, 1], cells[row, side, 2] = i, j, k
            guarded[row, side] = component if clear else -1
