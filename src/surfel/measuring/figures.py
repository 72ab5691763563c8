"""Figures of a measurement: its intervals, drawn by matplotlib (extra ``plot``)."""

from __future__ import annotations

import math
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


def plot_measurement(result: Measurement, units: str) -> Any:
    """Return the figure of :meth:`Measurement.plot`."""
    figure = new_figure(5.0, 2.6)
    draw_intervals(figure.subplots(), result, units)
    return figure
