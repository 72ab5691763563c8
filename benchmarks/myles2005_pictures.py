"""Pictures like those of Myles and Peters, by the numbers of their figures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import surfel
from benchmarks import myles2005_counts
from benchmarks.heights import balls, bunny
from benchmarks.shapes import NoDataError

_DPI = 100
_LIGHT = np.array([-0.45, 0.35, 0.82])
_FINE = 500


def _plane_cloud(seed: int = 0) -> np.ndarray:
    """Return a hundred points scattered over a bent ellipse in the plane."""
    rng = np.random.default_rng(seed)
    angle, radius = rng.uniform(0.0, 2.0 * np.pi, 100), np.sqrt(rng.random(100))
    x, y = 1.6 * radius * np.cos(angle), radius * np.sin(angle)
    return np.column_stack([x, y + 0.3 * x * x])


def _curve(points: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the curve above points (x, y) with n coefficients, as places along it."""
    from surfel.bounding.enclosure import extended
    from surfel.bounding.scattered import scattered_surrogate

    x, y = points.T
    low, width = float(x.min()), float(np.ptp(x))
    fit = scattered_surrogate((x - low) / width * (n - 1), y, n)
    t = np.linspace(0.0, n - 1.0, _FINE)
    return low + t / (n - 1) * width, _along(extended(fit.b), t)


def _along(b: np.ndarray, t: np.ndarray) -> np.ndarray:
    from scipy.interpolate import BSpline

    return BSpline(np.arange(-3.0, len(b) + 1.0), b, 3)(t)


def fig_1(figure: Any) -> None:
    """Draw a cloud in the plane, bounded from four directions."""
    cloud = _plane_cloud()
    axes = figure.subplots()
    axes.plot(*cloud.T, ".", color="0.3", ms=4)
    for angle in np.radians([20.0, 110.0, 200.0, 290.0]):
        turn = np.array([[np.sin(angle), -np.cos(angle)], [np.cos(angle), np.sin(angle)]])  # rows: across, along
        curve = np.column_stack(_curve(cloud @ turn.T, 20)) @ turn
        (line,) = axes.plot(*curve.T, lw=1.2)
        axes.plot(*np.array([cloud.mean(axis=0), cloud.mean(axis=0) + turn[1]]).T, color=line.get_color())
    axes.set_aspect("equal")


def fig_2(figure: Any) -> None:
    """Draw the same cloud and direction with 16, 24 and 32 coefficients."""
    cloud = _plane_cloud()
    for axes, n in zip(figure.subplots(1, 3, sharey=True), (16, 24, 32), strict=True):
        axes.plot(*cloud.T, ".", color="0.3", ms=4)
        axes.plot(*_curve(cloud, n), color="tab:red", lw=1.2)
        axes.set_title(f"{n} coefficients", fontsize=9)


def fig_4(figure: Any) -> None:
    """Draw a broken line with 0, 1, 2 and 3 free break points, where energy takes over."""
    from surfel.bounding.broken_line import broken_line_surrogate
    from surfel.bounding.enclosure import extended

    heights = np.array([0.0, 1.0, 0.4, 1.6, 2.4, 0.6, 1.1, 0.2, 1.4, 0.5])
    t = np.linspace(0.0, 9.0, _FINE)
    for axes, count in zip(figure.subplots(1, 4, sharey=True), range(4), strict=True):
        free = np.zeros(10, bool)
        free[4 : 4 + count] = True
        fit = broken_line_surrogate(heights, free)
        axes.plot(np.flatnonzero(~free), heights[~free], "o-", color="0.4", ms=4, lw=0.8)
        axes.plot(t, _along(extended(fit.b), t), color="tab:red", lw=1.2)
        axes.set_title(f"{count} free", fontsize=9)


def fig_7(figure: Any) -> None:
    """Draw cells with data, free grid points, and the trim along cells and diagonals."""
    rng = np.random.default_rng(3)
    angle = rng.uniform(0.0, 2.0 * np.pi, 1500)
    radius = np.sqrt(rng.random(1500))
    points = np.column_stack([np.cos(angle) * radius, 0.8 * np.sin(angle) * radius + 0.4 * np.cos(angle) * radius])
    fitted = surfel.bound(np.column_stack([points, np.zeros(1500)]), shape=(16, 16))
    uv, _ = fitted.to_domain(np.column_stack([points, np.zeros(1500)]))
    kept = fitted.trim > 0
    bound = np.zeros((16, 16), bool)
    for i in (0, 1):
        for j in (0, 1):
            bound[i : i + 15, j : j + 15] |= fitted.occupancy > 0
    left, right = figure.subplots(1, 2, sharey=True)
    for axes in (left, right):
        axes.plot(*uv.T, ".", color="0.55", ms=2)
        axes.set_xticks(range(16), minor=False)
        axes.set_yticks(range(16), minor=False)
        axes.grid(lw=0.4)
        axes.tick_params(labelsize=6)
        axes.set_aspect("equal")
    left.plot(*np.argwhere(bound).T, "o", color="tab:blue", ms=3)
    for place in np.argwhere(~bound):
        left.text(*place, "f", color="tab:red", ha="center", va="center", fontsize=8)
    left.set_title("grid points: bound (blue) and free (f)", fontsize=9)
    for polygon in fitted.trim_polygons():
        right.fill(*polygon.T, facecolor="tab:orange", alpha=0.25, edgecolor="tab:red", lw=1.5)
    right.set_title(f"trim: {int(kept.sum())} of {kept.size} cells", fontsize=9)


def fig_8(figure: Any) -> None:
    """Draw range data, the surface fitted from below, and the same trimmed."""
    points = bunny()
    fitted = surfel.bound(points, shape=(40, 40), side="below")
    data, whole, trimmed = figure.subplots(1, 3, sharex=True, sharey=True)
    uv, heights = fitted.to_domain(points)
    near, far = np.percentile(heights, [2.0, 98.0])
    data.scatter(*uv.T, s=0.3, c=heights, cmap="gray", vmin=near, vmax=far, lw=0)
    data.set_facecolor("0.85")
    data.set_title(f"{len(points):,} points", fontsize=9)
    _show_front(whole, fitted, trimmed=False)
    whole.set_title("surface below them", fontsize=9)
    _show_front(trimmed, fitted, trimmed=True)
    trimmed.set_title("trimmed", fontsize=9)
    data.set_aspect(float(fitted.frame.scale[0] / fitted.frame.scale[1]))


def _show_front(axes: Any, fitted: surfel.SafeSpline, *, trimmed: bool) -> None:
    """Draw a surface as seen along its direction, lit."""
    u, v = (np.linspace(0.0, cells, _FINE) for cells in fitted.frame.cells)
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    normals = fitted.normal(uv, trimmed=trimmed)
    shade = np.abs(normals @ (_LIGHT @ fitted.frame.rotation)).reshape(_FINE, _FINE)
    box = (0.0, float(fitted.frame.cells[0]), 0.0, float(fitted.frame.cells[1]))
    axes.imshow(shade.T, origin="lower", extent=box, cmap="gray", vmin=0.0, vmax=1.0)
    axes.set_aspect(float(fitted.frame.scale[0] / fitted.frame.scale[1]))


def fig_9(figure: Any) -> None:
    """Draw how many banded systems a line takes."""
    for axes, n in zip(figure.subplots(1, 2, sharey=True), myles2005_counts.SIZES, strict=True):
        scattered, _, _ = myles2005_counts.counts(n)
        most = max(20, *scattered)
        axes.bar(range(1, most + 1), [scattered[k] for k in range(1, most + 1)], color="0.4")
        axes.set_title(f"{n:,} points, n = {myles2005_counts.SIDE}", fontsize=9)
        axes.set_xticks(range(0, most + 1, 2))
        axes.set_xlabel("solves of a line", fontsize=8)


def fig_10(figure: Any) -> None:
    """Draw two moving balls: the surface at four times, from the front and from the side."""
    for k, step in enumerate((1, 4, 6, 9)):
        points = balls(30_000, np.random.default_rng(step), step)
        fitted = surfel.bound(points)
        front = figure.add_subplot(2, 4, 1 + k)
        _show_front(front, fitted, trimmed=True)
        front.set_title(f"configuration {step + 1}", fontsize=9)
        _show_aslant(figure.add_subplot(2, 4, 5 + k, projection="3d"), fitted, points[::10], elev=8, azim=-70)


def _show_aslant(axes: Any, fitted: surfel.SafeSpline, points: np.ndarray, **view: float) -> None:
    """Draw a trimmed surface and points from the side."""
    from surfel.bounding.figures import draw_surfaces

    uv, heights = fitted.to_domain(points)
    draw_surfaces(axes, [fitted], uv, heights)
    axes.view_init(**view)
    axes.set_axis_off()
    axes.set_title("")


def fig_11(figure: Any) -> None:
    """Draw the bunny's range scan, bounded in front and behind."""
    points = bunny()
    for k, side in enumerate(("above", "below")):
        fitted = surfel.bound(points, shape=(40, 40), side=side)
        axes = figure.add_subplot(1, 4, 1 + 2 * k)
        _show_front(axes, fitted, trimmed=True)
        axes.set_title(
            ("front" if side == "above" else "back") + f", mean gap {fitted.report.gap_mean:.2g}", fontsize=9
        )
        _show_aslant(figure.add_subplot(1, 4, 2 + 2 * k, projection="3d"), fitted, points[::10], elev=65, azim=-80)


def fig_12(figure: Any) -> None:
    """Draw slices through the sandwich round the bunny's range scan."""
    from surfel.bounding.figures import draw_slice

    points = bunny()
    splines = list(surfel.sandwich(points, shape=(30, 30)))
    uv, heights = splines[0].to_domain(points)
    for axes, share in zip(figure.subplots(3, 1), (0.25, 0.5, 0.75), strict=True):
        draw_slice(axes, splines, uv, heights, share)


FIGURES: dict[str, tuple[Callable[[Any], None], tuple[float, float], str]] = {
    "fig1": (fig_1, (5, 5), "Fig. 1: a hundred points bounded from four directions, n = 20"),
    "fig2": (fig_2, (11, 3.2), "Fig. 2: 16, 24 and 32 coefficients"),
    "fig4": (fig_4, (11, 3), "Fig. 4: free break points"),
    "fig7": (fig_7, (10, 5), "Fig. 7: free grid points, and the trim"),
    "fig8": (fig_8, (11, 4), "Fig. 8: range data, the surface below them, trimmed"),
    "fig9": (fig_9, (9, 3), "Fig. 9: banded systems solved for a line"),
    "fig10": (fig_10, (12, 6), "Fig. 10: two moving balls"),
    "fig11": (fig_11, (13, 4), "Fig. 11: the bunny's range scan, front and back"),
    "fig12": (fig_12, (9, 7), "Fig. 12: slices through the sandwich"),
}


def draw_all(out: str) -> str:
    """Draw every figure beside the file of results, and return the Markdown that shows them."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    target = Path(out)
    target.parent.mkdir(parents=True, exist_ok=True)
    lines = ["## Pictures\n"]
    for name, (draw, size, title) in FIGURES.items():
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        try:
            draw(figure)
        except NoDataError as absent:
            lines.append(f"{title}: skipped, {absent}.\n")
            continue
        path = target.with_name(f"{target.stem}-{name}.png")
        figure.savefig(path, dpi=_DPI)
        print(path, flush=True)
        lines.append(f"![{title}]({path.name})\n\n*{title}.*\n")
    return "\n".join(lines)
