"""The Bezier form of a spline's cells: what each cell is bounded by."""

from __future__ import annotations

import numpy as np

from surfel._numba import kernel
from surfel.bounding.lanes import larger
from surfel.core.cast import Floats

ROUNDING = 32.0 * float(np.finfo(np.float64).eps)
"""How far a value that was computed from the coefficients may be off, as a share of the largest of them."""

_TO_BEZIER = np.array([[1.0, 4.0, 1.0, 0.0], [0.0, 4.0, 2.0, 0.0], [0.0, 2.0, 4.0, 0.0], [0.0, 1.0, 4.0, 1.0]]) / 6.0
"""Four coefficients of a uniform cubic B-spline to the four Bezier coefficients of the cell between the middle two."""


def bezier_nets(coefficients: Floats) -> Floats:
    """Return the bicubic Bezier coefficients of every cell.

    Parameters
    ----------
    coefficients : Floats, shape (n + 2, m + 2)
        Of a uniform bicubic B-spline; cell (h, k) belongs to the rows h to h + 3 and the columns k to k + 3.

    Returns
    -------
    Floats, shape (n - 1, m - 1, 4, 4)
        Values of the spline in a cell lie between the least and the largest of its net.

    Examples
    --------
    >>> import numpy as np
    >>> nets = bezier_nets(np.full((6, 5), 2.0))
    >>> nets.shape, bool(np.allclose(nets, 2.0))
    ((3, 2, 4, 4), True)
    """
    windows = np.lib.stride_tricks.sliding_window_view(coefficients, (4, 4))
    return np.ascontiguousarray(_TO_BEZIER @ windows @ _TO_BEZIER.T)


def cell_planes(coefficients: Floats) -> Floats:
    """Return for each cell a plane, and how far the spline lies at most below and above it, rounding included.

    Parameters
    ----------
    coefficients : Floats, shape (n + 2, m + 2)
        Of a uniform bicubic B-spline.

    Returns
    -------
    Floats, shape (n - 1, m - 1, 5)
        p, q, r, low, high: over the local coordinates (a, b) the value less ``p + q a + r b`` lies between low and
        high. A cell that is nearly flat is bounded much better so than by two heights.

    Examples
    --------
    >>> import numpy as np
    >>> planes = cell_planes(np.add.outer(np.arange(5.0), 2.0 * np.arange(5.0)))
    >>> bool(np.allclose(planes[0, 0], [3.0, 1.0, 2.0, 0.0, 0.0]))
    True
    """
    nets = bezier_nets(coefficients)
    p = nets[..., 0, 0]
    q = 0.5 * (nets[..., 3, 0] + nets[..., 3, 3] - p - nets[..., 0, 3])
    r = 0.5 * (nets[..., 0, 3] + nets[..., 3, 3] - p - nets[..., 3, 0])
    thirds = np.arange(4) / 3.0
    flat = p[..., None, None] + q[..., None, None] * thirds[:, None] + r[..., None, None] * thirds
    off = nets - flat
    windows = np.lib.stride_tricks.sliding_window_view(np.abs(coefficients), (4, 4))
    slack = 4.0 * ROUNDING * windows.max(axis=(2, 3))
    return np.stack([p, q, r, off.min(axis=(2, 3)) - slack, off.max(axis=(2, 3)) + slack], axis=-1)


def cell_bounds(coefficients: Floats) -> tuple[Floats, Floats]:
    """Return what no value of the spline in a cell lies below and above, rounding included.

    Parameters
    ----------
    coefficients : Floats, shape (n + 2, m + 2)
        Of a uniform bicubic B-spline.

    Returns
    -------
    low, high : Floats, shape (n - 1, m - 1)
        For each cell.

    Examples
    --------
    >>> import numpy as np
    >>> low, high = cell_bounds(np.arange(25.0).reshape(5, 5))
    >>> bool(low[0, 0] < 6.0 < 12.0 < high[0, 0] < 12.1)
    True
    """
    n, m = coefficients.shape
    low, high = np.empty((n - 3, m - 3)), np.empty((n - 3, m - 3))
    _cell_bounds(np.ascontiguousarray(coefficients), low, high)
    return low, high


def largest_of_cells(per_coefficient: Floats) -> Floats:
    """Return the largest of the 16 numbers of each cell."""
    return over_windows(per_coefficient, 4)


def over_windows(grid: Floats, size: int, step: int = 1) -> Floats:
    """Return the largest number in windows of a size that begin at every step-th place in both directions."""
    n, m = ((side - size) // step + 1 for side in grid.shape)
    out, half = np.empty((n, m)), np.empty((n, grid.shape[1]))
    _over_windows(np.ascontiguousarray(grid), np.int64(size), np.int64(step), half, out)
    return out


def framed(grid: Floats, wide: int, value: float) -> Floats:
    """Return a grid with more places on all sides that hold a value."""
    out = np.full((grid.shape[0] + 2 * wide, grid.shape[1] + 2 * wide), value)
    out[wide:-wide, wide:-wide] = grid
    return out


@kernel
def _over_windows(grid, size, step, half, out):
    for i in range(half.shape[0]):
        half[i] = grid[i * step]
        for more in range(1, size):
            for j in range(half.shape[1]):
                half[i, j] = larger(half[i, j], grid[i * step + more, j])
        for j in range(out.shape[1]):
            out[i, j] = half[i, j * step]
        for more in range(1, size):
            for j in range(out.shape[1]):
                out[i, j] = larger(out[i, j], half[i, j * step + more])


@kernel
def _cell_bounds(b, low, high):
    # row by row, first along u for all columns, then along v for all cells
    cells, wide = low.shape[1], b.shape[1]
    along, size = np.empty((4, wide)), np.empty(wide)
    for h in range(low.shape[0]):
        for j in range(wide):
            b0, b1, b2, b3 = b[h, j], b[h + 1, j], b[h + 2, j], b[h + 3, j]
            size[j] = larger(larger(abs(b0), abs(b1)), larger(abs(b2), abs(b3)))
        for j in range(wide):
            b0, b1, b2, b3 = b[h, j], b[h + 1, j], b[h + 2, j], b[h + 3, j]
            along[0, j] = (b0 + 4.0 * b1 + b2) / 6.0
            along[1, j] = (2.0 * b1 + b2) / 3.0
            along[2, j] = (b1 + 2.0 * b2) / 3.0
            along[3, j] = (b1 + 4.0 * b2 + b3) / 6.0
        low[h], high[h] = np.inf, -np.inf
        for i in range(4):
            for k in range(cells):
                b0, b1, b2, b3 = along[i, k], along[i, k + 1], along[i, k + 2], along[i, k + 3]
                p0, p1 = (b0 + 4.0 * b1 + b2) / 6.0, (2.0 * b1 + b2) / 3.0
                p2, p3 = (b1 + 2.0 * b2) / 3.0, (b1 + 4.0 * b2 + b3) / 6.0
                high[h, k] = larger(high[h, k], larger(larger(p0, p1), larger(p2, p3)))
                low[h, k] = -larger(-low[h, k], larger(larger(-p0, -p1), larger(-p2, -p3)))
        for k in range(cells):
            slack = ROUNDING * larger(larger(size[k], size[k + 1]), larger(size[k + 2], size[k + 3]))
            low[h, k], high[h, k] = low[h, k] - slack, high[h, k] + slack
