"""Figures of safe splines over their points, and slices through both (Myles and Peters, Figs. 11, 12)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from surfel.core.figure import new_figure

if TYPE_CHECKING:
    from surfel.bounding.spline import SafeSpline
    from surfel.core.cast import Floats

_ACROSS = 120  # grid lines of the drawn surface
_ALONG = 600  # places along a slice
SLICES = (0.25, 0.5, 0.75)
_THICK = 0.25  # of a cell: points so near to a slice are drawn in it
_COLORS = {"above": "tab:red", "below": "tab:blue"}
_VIEW = {"elev": 28, "azim": -60}


def draw_surfaces(axes: Any, splines: list[SafeSpline], uv: Floats, heights: Floats) -> None:
    """Draw the trimmed surfaces, see-through, and the points, in lengths across the direction."""
    import numpy as np

    frame = splines[0].frame
    place = uv / frame.scale
    axes.scatter(place[:, 0], place[:, 1], heights, s=1.0, c="0.25", lw=0, depthshade=False)
    u, v = (np.linspace(0.0, cells, _ACROSS) for cells in frame.cells)
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    for spline in splines:
        z = spline(grid.reshape(-1, 2)).reshape(grid.shape[:2])
        x, y = (grid[..., k] / frame.scale[k] for k in (0, 1))
        axes.plot_surface(x, y, z, color=_COLORS[spline.side], alpha=0.45, lw=0, rcount=_ACROSS, ccount=_ACROSS)
    axes.view_init(**_VIEW)
    spans = np.maximum(np.append(np.ptp(place, axis=0), np.ptp(heights)), 1e-300)
    axes.set_box_aspect(np.maximum(spans / spans.max(), 0.2))
    axes.tick_params(labelsize=7)
    axes.set_title(f"{len(uv):,} of the points", fontsize=9)


def draw_slice(axes: Any, splines: list[SafeSpline], uv: Floats, heights: Floats, share: float) -> None:
    """Draw a slice across u: the points near it, and what the surfaces do over the slice's thickness."""
    import numpy as np

    frame = splines[0].frame
    at = share * float(frame.cells[0])
    near = np.abs(uv[:, 0] - at) <= _THICK / 2.0
    axes.plot(uv[near, 1] / frame.scale[1], heights[near], ".", ms=2.0, color="0.25")
    v = np.linspace(0.0, float(frame.cells[1]), _ALONG)
    across = at + np.linspace(-0.5, 0.5, 5) * _THICK
    for spline in splines:
        rows = np.array([spline(np.column_stack([np.full(_ALONG, u), v])) for u in across])
        x = v / frame.scale[1]
        axes.fill_between(x, rows.min(axis=0), rows.max(axis=0), color=_COLORS[spline.side], alpha=0.3, lw=0)
        axes.plot(x, rows[2], lw=1.0, color=_COLORS[spline.side], label=f"{spline.side} the points")
    axes.tick_params(labelsize=7)
    axes.set_title(f"slice at u = {at:.3g} cells: points within {_THICK / 2.0:g} cells of it", fontsize=8)
    if share == SLICES[0]:
        axes.legend(fontsize=7, loc="best")


def plot_spline(spline: SafeSpline, points: Floats) -> Any:
    """Return the figure of :meth:`SafeSpline.plot`."""
    uv, heights = spline.to_domain(points)
    figure = new_figure(13.0, 6.0)
    picture, slices = figure.subfigures(1, 2)
    draw_surfaces(picture.add_subplot(projection="3d"), [spline], uv, heights)
    for axes, share in zip(slices.subplots(len(SLICES), 1), SLICES, strict=True):
        draw_slice(axes, [spline], uv, heights, share)
    return figure
