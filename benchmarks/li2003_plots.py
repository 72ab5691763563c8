"""The figures of Li et al. (2003), drawn again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.li2003_curves import Curve
from benchmarks.li2003_solids import GATE, SKELETON, L
from benchmarks.pictures import picture
from surfel.core.cast import Floats
from surfel.lines.sequences import unit_points

_COLOR = {"random": "#b5562a", "niederreiter": "#2a5db5", "marching cubes": "#3d8b4f"}
_TITLE = {"chord": "chord model", "tangent": "tangent model"}
_DPI = 110


def _pyplot() -> Any:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    return plt


def save_errors(path: Path, panels: Sequence[tuple[str, Curve, Curve]]) -> None:
    """Draw panels of (title, random, Niederreiter): RMS errors thick, single runs thin, the slopes -1/2 and -2/3."""
    plt = _pyplot()
    rows = -(-len(panels) // 2)
    figure, axes = plt.subplots(rows, 2, figsize=(10, 3.9 * rows), squeeze=False)
    for ax, (title, *both) in zip(axes.ravel(), panels, strict=False):
        for one in both:
            color = _COLOR[one.sequence]
            ax.loglog(one.lines, one.single, color=color, lw=0.7, alpha=0.6)
            ax.loglog(one.lines, one.rms, color=color, lw=1.8, label=f"{one.sequence}: N^{one.order:.2f}")
        _slopes(ax, both[0].lines, both[0].rms[0])
        ax.set_title(title, fontsize=10)
        _dress(ax, "lines", "relative error")
    _finish(figure, path)


def save_models(path: Path, title: str, chord: Curve, tangent: Curve) -> None:
    """Draw the chord against the tangent model."""
    plt = _pyplot()
    figure, ax = plt.subplots(figsize=(6, 4.2))
    for one, color in ((chord, "#7d3c98"), (tangent, "#2a5db5")):
        ax.loglog(one.lines, one.single, color=color, lw=0.7, alpha=0.6)
        ax.loglog(one.lines, one.rms, color=color, lw=1.8, label=f"{one.model}: N^{one.order:.2f}")
    _slopes(ax, chord.lines, chord.rms[0])
    ax.set_title(title, fontsize=10)
    _dress(ax, "lines", "relative error")
    _finish(figure, path)


def save_cubes(path: Path, title: str, sides: Floats, errors: Floats, lines: Curve) -> None:
    """Draw m^3 cubes against m^2 lines."""
    plt = _pyplot()
    figure, ax = plt.subplots(figsize=(6, 4.2))
    color = _COLOR["niederreiter"]
    ax.loglog(lines.lines, lines.single, color=color, lw=0.7, alpha=0.6)
    ax.loglog(lines.lines, lines.rms, color=color, lw=1.8, label="Niederreiter, 10^2k lines")
    ax.loglog(sides**2, errors, "o-", color=_COLOR["marching cubes"], ms=4, label="marching cubes, 10^3k cubes")
    ax.set_title(title, fontsize=10)
    _dress(ax, "10^2k", "relative error")
    _finish(figure, path)


def save_points(path: Path, number: int = 1000) -> None:
    """Draw points on a sphere, pseudo-random and Niederreiter's: a uniform height and a uniform longitude."""
    plt = _pyplot()
    figure, axes = plt.subplots(1, 2, figsize=(9, 4.7))
    for ax, sequence, title in zip(
        axes, ("random", "niederreiter"), ("Fig. 6: pseudo-random", "Fig. 7: Niederreiter"), strict=True
    ):
        u = unit_points(sequence, 0, number, 2)
        height, angle = 1.0 - 2.0 * u[:, 0], 2.0 * np.pi * u[:, 1]
        ring = np.sqrt(1.0 - height * height)
        x, y, z = ring * np.cos(angle), ring * np.sin(angle), height
        front, up = 0.9 * y + 0.436 * z, 0.9 * z - 0.436 * y
        near = front > 0.0
        ax.scatter(x[~near], up[~near], s=3, color="#cccccc")
        ax.scatter(x[near], up[near], s=5, color="#2a5db5")
        ax.add_patch(plt.Circle((0, 0), 1.0, fill=False, color="#555555", lw=0.8))
        ax.set_aspect("equal")
        ax.axis("off")
        ax.set_title(f"{title}, {number:,} points", fontsize=10)
    _finish(figure, path)


def save_pictures(path: Path, size: int = 360) -> None:
    """Draw the L, the skeleton and the gate."""
    plt = _pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(11, 4.0))
    seen = (("Fig. 12: L ± cylinder", L, (1.3, -1.6, 1.1)), ("Fig. 19: skeleton", SKELETON, (1.0, -1.7, 0.9)),
            ("Fig. 20: gate", GATE, (0.9, -1.7, 0.7)))  # fmt: skip
    for ax, (title, known, eye) in zip(axes, seen, strict=True):
        ax.imshow(picture(known.make(), eye, size))
        ax.axis("off")
        ax.set_title(title, fontsize=10)
    _finish(figure, path)


def _slopes(ax: Any, lines: Floats, start: float) -> None:
    for power, style in ((-0.5, ":"), (-2.0 / 3.0, "--")):
        label = "-(1/2)" if power == -0.5 else "-(2/3)"
        ax.loglog(lines, start * (lines / lines[0]) ** power, style, color="#888888", lw=0.9, label=label)


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
