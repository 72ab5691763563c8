"""The figures of Liu et al. (2006), drawn again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.liu2006_counts import Spread
from benchmarks.liu2006_sets import PointSet
from benchmarks.pieces import Floats

_COLORS = ("#2a5db5", "#b5562a", "#3d8b4f", "#7d3c98", "#8a6d1d")
_EYE = np.array([0.8, -1.7, 0.9])
_DPI = 110

Curve = tuple[Floats, Floats, Floats]


def _pyplot() -> Any:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    return plt


def save_clouds(path: Path, sets: Sequence[tuple[str, PointSet]]) -> None:
    """Draw point sets, seen from one side and shaded by their normals; points that face away are left out."""
    plt = _pyplot()
    figure, axes = plt.subplots(1, len(sets), figsize=(3.4 * len(sets), 3.6), squeeze=False)
    for ax, (title, known) in zip(axes[0], sets, strict=True):
        up = np.array([0.0, 1.0, 0.0]) if title.startswith(("Fig. 11",)) else np.array([0.0, 0.0, 1.0])
        eye = np.array([0.5, 0.35, 1.7]) if up[1] else _EYE
        back = eye / np.linalg.norm(eye)
        right = np.cross(up, back)
        right /= np.linalg.norm(right)
        frame = np.stack([right, np.cross(back, right), back])
        place, facing = known.points @ frame.T, known.normals @ back
        shown = np.flatnonzero((facing > 0.0) | title.startswith("Fig. 12"))
        shown = shown[np.argsort(place[shown, 2], kind="stable")]
        shade = 0.25 + 0.6 * np.abs(facing[shown])
        ax.scatter(*place[shown, :2].T, s=60.0 / np.sqrt(len(shown)), c=1.0 - shade, cmap="Blues", vmin=0, vmax=1, lw=0)
        ax.set_aspect("equal")
        ax.axis("off")
        ax.set_title(title, fontsize=9)
    _finish(figure, path)


def save_errors(path: Path, curves: Sequence[tuple[str, Curve]]) -> None:
    """Draw errors over numbers of lines (Fig. 7): one run dashed, as in the paper, the RMS of shifted runs solid."""
    plt = _pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(10, 7.6))
    for ax, (title, (lines, plain, rms)) in zip(axes.ravel(), curves, strict=True):
        ax.loglog(lines, plain, "--", color=_COLORS[0], lw=1.0, label="one run")
        ax.loglog(lines, rms, color=_COLORS[0], lw=1.8, label="RMS of shifted runs")
        for power, style in ((-0.5, ":"), (-2.0 / 3.0, "-.")):
            ax.loglog(lines, lines**power, style, color="#888888", lw=0.9, label=f"N^{power:.2g}")
        ax.set_title(title, fontsize=10)
        _dress(ax, "lines", "relative error")
    _finish(figure, path)


def save_times(path: Path, curves: Sequence[tuple[str, Floats, Floats]]) -> None:
    """Draw times over numbers of lines (Fig. 8)."""
    plt = _pyplot()
    figure, ax = plt.subplots(figsize=(6, 4.2))
    for (name, lines, times), color in zip(curves, _COLORS, strict=False):
        ax.loglog(lines, times, "o-", ms=3, color=color, label=name)
    ax.set_title("Fig. 8: time over the number of lines", fontsize=10)
    _dress(ax, "lines", "seconds")
    _finish(figure, path)


def save_densities(path: Path, panels: Sequence[tuple[str, list[tuple[float, int, Spread]]]]) -> None:
    """Draw errors over sampling radii (Fig. 9)."""
    plt = _pyplot()
    figure, axes = plt.subplots(1, len(panels), figsize=(10, 4.0))
    for ax, (title, rows) in zip(axes, panels, strict=True):
        radii = [radius for radius, _, _ in rows]
        ax.loglog(radii, [abs(found.plain) for _, _, found in rows], "o--", ms=3, color=_COLORS[0], label="one run")
        ax.loglog(radii, [found.rms for _, _, found in rows], "o-", ms=3, color=_COLORS[1], label="RMS of shifted runs")
        ax.set_title(title, fontsize=10)
        _dress(ax, "sampling radius", "relative error at 5,000 lines")
    _finish(figure, path)


def _dress(ax: Any, across: str, up: str) -> None:
    ax.set_xlabel(across, fontsize=9)
    ax.set_ylabel(up, fontsize=9)
    ax.grid(True, which="major", lw=0.4, color="#dddddd")
    ax.legend(fontsize=8, frameon=False)
    ax.tick_params(labelsize=8)


def _finish(figure: Any, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, dpi=_DPI)
    _pyplot().close(figure)
