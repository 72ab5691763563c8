"""The Bezier form of a spline's cells: what each cell is bounded by."""

from __future__ import annotations

import numpy as np

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
    slack = ROUNDING * largest_of_cells(np.abs(coefficients))
    net = _joint_net(coefficients)
    return -over_windows(-net, 4, 3) - slack, over_windows(net, 4, 3) + slack


def largest_of_cells(per_coefficient: Floats) -> Floats:
    """Return the largest of the 16 numbers of each cell."""
    return over_windows(per_coefficient, 4)


def _joint_net(coefficients: Floats) -> Floats:
    """Return the Bezier coefficients of all cells as one grid, (3 n - 2, 3 m - 2): neighbours share an edge."""
    grid = coefficients
    for _ in range(2):
        c = grid.T
        grid = np.empty((3 * len(c) - 8, c.shape[1]))
        grid[0::3] = (c[:-2] + 4.0 * c[1:-1] + c[2:]) / 6.0
        grid[1::3] = (2.0 * c[1:-2] + c[2:-1]) / 3.0
        grid[2::3] = (c[1:-2] + 2.0 * c[2:-1]) / 3.0
    return grid


def over_windows(grid: Floats, size: int, step: int = 1) -> Floats:
    """Return the largest number in windows of a size that begin at every step-th place in both directions."""
    for _ in range(2):
        count = (len(grid) - size) // step + 1
        rows = [grid[i : i + step * (count - 1) + 1 : step] for i in range(size)]
        grid = np.maximum.reduce(rows).T
    return np.ascontiguousarray(grid)
