"""Figures of Boolean operations by matplotlib: slices of colored cells or of an octree, and the curve of a cut."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats, as_count, as_number
from surfel.core.errors import InputError
from surfel.core.figure import new_figure
from surfel.inside.grid import ALL_IN, BORDER, IN, OUT, SIDE, Grid
from surfel.inside.octree import Octree, build_octree
from surfel.inside.octree_colour import colour_per_level
from surfel.inside.operand import Operand

if TYPE_CHECKING:
    from surfel.booleans.result import Combination
    from surfel.inside.classify import Classifier

_AXES = "xyz"
_COLORS = ("#f4f1ea", "#9db7cc", "#b5654a")  # outside, inside, border
_DEEPEST = 8  # levels
_MOST = 40_000  # points that are drawn


def slice_of(grid: Grid, axis: int, cell: int) -> NDArray[np.int8]:
    """Return what the cells of one layer are, over the other two axes in their order: outside, inside or border.

    Parameters
    ----------
    grid : Grid
        Colored space.
    axis : int
        Which axis the layer is across.
    cell : int
        Which layer, counted from the lowest corner.
    """
    table = np.take(grid.table, cell // SIDE, axis=axis)
    found = np.where(table == ALL_IN, IN, OUT).astype(np.int8)
    found = np.repeat(np.repeat(found, SIDE, axis=0), SIDE, axis=1)
    for p, q in np.argwhere(table >= 0):
        brick = table[p, q]
        inside, border = (np.take(_bits(words[brick]), cell % SIDE, axis=axis) for words in (grid.inside, grid.border))
        part = np.where(border, BORDER, np.where(inside, IN, OUT))
        found[SIDE * p : SIDE * (p + 1), SIDE * q : SIDE * (q + 1)] = part
    return found


def _bits(words: NDArray[np.uint64]) -> NDArray[np.uint8]:
    """Return the 8 x 8 x 8 bits of a brick, x first."""
    return np.unpackbits(words.astype("<u8").view(np.uint8).reshape(SIDE, SIDE, 1), axis=2, bitorder="little")


def plot_space(classifier: Classifier, axis: str, at: float | None, octree: int | None) -> Any:
    """Return the figure of :meth:`surfel.Classifier.plot`."""
    if axis not in tuple(_AXES):
        raise InputError(f"axis must be x, y or z; got {axis!r}")
    depth = None if octree is None else as_count(octree, "octree", 1, _DEEPEST)
    across, coloured, operand = _AXES.index(axis), classifier._coloured, classifier.operand
    figure = new_figure(5.6, 5.0)
    axes = figure.subplots()
    if coloured is None:
        axes.set_title("an empty cloud: all of space is outside", fontsize=9)
        return figure
    grid = coloured.grid
    tree = None if depth is None else build_octree(operand, depth)
    low = np.asarray(grid.low if tree is None else tree.low) + operand.origin
    high = low + (grid.step * SIDE * np.array(grid.table.shape) if tree is None else tree.size)
    points = operand.points + operand.origin
    place = float(np.median(points[:, across])) if at is None else as_number(at, "at")
    if not low[across] <= place < high[across]:
        raise InputError(f"space is colored between {axis} = {low[across]:g} and {high[across]:g}; got at={place:g}")
    one, other = (k for k in range(3) if k != across)
    if tree is None:
        step = grid.step
        cells = slice_of(grid, across, int((place - low[across]) / step))
        _draw_cells(axes, cells, (low[one], high[one], low[other], high[other]))
    else:
        step = tree.size / 2**tree.depth
        squares, colours = leaves_of(tree, operand, across, int((place - low[across]) / step))
        _draw_leaves(axes, low[[one, other]] + step * squares, colours)
    near = np.abs(points[:, across] - place) < step
    some = points[near][:: max(1, int(near.sum()) // _MOST)]
    axes.plot(some[:, one], some[:, other], ".", color="0.1", markersize=1.0)
    axes.set_xlabel(_AXES[one], fontsize=8)
    axes.set_ylabel(_AXES[other], fontsize=8)
    what = "cells" if tree is None else "octree"
    axes.set_title(f"{what} at {axis} = {place:g}: inside blue, border red", fontsize=9)
    return figure


def leaves_of(tree: Octree, operand: Operand, axis: int, cell: int) -> tuple[Floats, NDArray[np.int8]]:
    """Return the leaves that one layer of the finest cells passes: their corners, counted in these cells, and colors.

    Parameters
    ----------
    tree : Octree
        Divided space.
    operand : Operand
        What it was divided for; colored level by level, as published.
    axis : int
        Which axis the layer is across.
    cell : int
        Which layer, counted from the lowest corner.
    """
    wide = 2 ** (tree.depth - tree.level)
    met = np.flatnonzero((tree.child < 0) & (tree.cell[:, axis] == cell // wide))
    low = np.delete(tree.cell[met], axis, axis=1) * wide[met, None]
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    return low[:, None].astype(np.float64) + square * wide[met, None, None], colour_per_level(tree, operand)[met]


def _draw_leaves(axes: Any, squares: Floats, colours: NDArray[np.int8]) -> None:
    from matplotlib.collections import PolyCollection

    faces = [_COLORS[2] if c == BORDER else _COLORS[1] if c == IN else _COLORS[0] for c in colours]
    axes.add_collection(PolyCollection(list(squares), facecolors=faces, edgecolors="0.5", linewidths=0.3))
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.tick_params(labelsize=8)


def _draw_cells(axes: Any, cells: NDArray[np.int8], extent: tuple[float, ...]) -> None:
    from matplotlib.colors import ListedColormap

    axes.imshow(
        cells.T, cmap=ListedColormap(_COLORS), vmin=0, vmax=2, origin="lower", extent=extent, interpolation="nearest"
    )
    axes.tick_params(labelsize=8)


def plot_combination(result: Combination) -> Any:
    """Return the figure of :meth:`surfel.Combination.plot`."""
    points: Floats = result.surfels.points
    figure = new_figure(5.6, 5.2)
    axes = figure.add_subplot(projection="3d")
    some = points[:: max(1, len(points) // _MOST + 1)] if len(points) else points
    axes.plot(some[:, 0], some[:, 1], some[:, 2], ".", color="0.7", markersize=0.6, zorder=1)
    for line in result.curve:
        axes.plot(line[:, 0], line[:, 1], line[:, 2], color=_COLORS[2], linewidth=1.6, zorder=2)
    if len(points):
        axes.set_box_aspect(np.maximum(np.ptp(points, axis=0), 1e-12 + 1e-3 * np.ptp(points, axis=0).max()))
    axes.tick_params(labelsize=7)
    closed = sum(len(line) > 2 and bool((line[0] == line[-1]).all()) for line in result.curve)
    curves = f"{len(result.curve)} curve" + ("" if len(result.curve) == 1 else "s")
    axes.set_title(f"{len(points):,} surfels; the cut: {curves}, {closed} closed", fontsize=9)
    return figure
