"""Figures of a measurement: how it converges, and its intervals, drawn by matplotlib (extra ``plot``)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from surfel.core.figure import new_figure

if TYPE_CHECKING:
    from surfel.measuring.measurement import Measurement


def draw_intervals(axes: Any, result: Measurement, units: str) -> None:
    """Draw each scalar's 95 % interval as percents of its value."""
    drawn = []
    for name, estimate, power in (("area", result.area, 2), ("volume", result.volume, 3)):
        if estimate is None:
            continue
        value, (low, high) = float(estimate.value), estimate.interval(0.95)
        if value > 0.0 and math.isfinite(high - low):
            label = f"{name}\n{estimate}" + (f" {units}^{power}" if units else "")
            drawn.append((label, 100.0 * (high - low) / 2.0 / value))
    for row, (label, half) in enumerate(drawn):
        axes.errorbar([0.0], [-row], xerr=[half], fmt="o", color="0.2", capsize=4)
        axes.text(0.0, -row + 0.12, label, ha="center", va="bottom", fontsize=8, parse_math=False)
    axes.set_ylim(-max(1, len(drawn)) + 0.5, 0.7)
    axes.set_yticks([])
    axes.tick_params(labelsize=8)
    axes.set_xlabel("percent of the value", fontsize=8)
    axes.set_title("95 % intervals" if drawn else "no interval is known", fontsize=9)


def draw_convergence(axes: Any, name: str, results: Sequence[Measurement], unit: str) -> None:
    """Draw one of the scalars over the number of lines: its 95 % interval as a band, and the last value as a line."""
    told = [(result.lines, getattr(result, name)) for result in results]
    lines = [count for count, estimate in told if estimate is not None]
    estimates = [estimate for _, estimate in told if estimate is not None]
    values = [float(estimate.value) for estimate in estimates]
    bands = [estimate.interval(0.95) for estimate in estimates]
    known = [all(math.isfinite(float(end)) for end in band) for band in bands]
    low = [float(band[0]) if good else value for band, good, value in zip(bands, known, values, strict=True)]
    high = [float(band[1]) if good else value for band, good, value in zip(bands, known, values, strict=True)]
    axes.fill_between(lines, low, high, color="0.85", linewidth=0.0)
    axes.axhline(values[-1], color="0.6", linewidth=0.8)
    axes.plot(lines, values, "o-", color="0.2", markersize=3, linewidth=1.0)
    axes.set_xscale("log", base=2)
    axes.tick_params(labelsize=8)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.set_xlabel("lines", fontsize=8)
    note = "" if len(set(values)) > 1 else " (from the points, whatever the lines)"
    axes.set_title(f"{name} {estimates[-1]}{unit}{note}", fontsize=9, parse_math=False)


def plot_measurement(result: Measurement, units: str) -> Any:
    """Return the figure of :meth:`Measurement.plot`."""
    results = () if result._again is None else result.convergence()
    drawn = [
        (name, f" {units}^{power}" if units else "")
        for name, power in (("area", 2), ("volume", 3))
        if getattr(result, name) is not None and math.isfinite(float(getattr(result, name).value))
    ]
    if len(results) < 2 or not drawn:
        figure = new_figure(5.0, 2.6)
        draw_intervals(figure.subplots(), result, units)
        return figure
    figure = new_figure(4.6 * len(drawn), 3.2)
    for axes, (name, unit) in zip(figure.subplots(1, len(drawn), squeeze=False)[0], drawn, strict=True):
        draw_convergence(axes, name, results, unit)
    return figure
