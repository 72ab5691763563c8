"""Results as tables for people."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from surfel.cli.output import plain, shown

if TYPE_CHECKING:
    from surfel.core.estimate import Estimate
    from surfel.measuring.measurement import Measurement

_NAMES = 8


def measurement_table(result: Measurement, file: str, units: str) -> RenderableType:
    """Return what was measured, with its errors, and what was done to the data."""
    numbers = _table("", "value +- error", "95 % interval")
    _add_estimate(numbers, "area", result.area, units, 2)
    if result.volume is not None:
        _add_estimate(numbers, "volume", result.volume, units, 3)
    if result.centroid is not None:
        _add_vector(numbers, "centroid", result.centroid, units)
    if result.inertia is not None:
        _add_matrix(numbers, "inertia", result.inertia)
    if len(result.areas) > 1:
        for leaf, area in enumerate(result.areas):
            _add_estimate(numbers, f"area of leaf {leaf}", area, units, 2)

    facts = _table("", "")
    for name, value in _facts(result, units):
        facts.add_row(name, Text(value))
    return Group(Text(_headline(result, file), style="bold"), numbers, facts)


def fact_table(title: str, facts: Mapping[str, Any]) -> RenderableType:
    """Return any flat result as a table of two columns."""
    table = _table("", "")
    for name, value in facts.items():
        table.add_row(str(name), Text(_told(plain(value))))
    return Group(Text(title, style="bold"), table)


def comparison_table(title: str, rows: list[tuple[str, Estimate, float]]) -> RenderableType:
    """Return estimates beside the truth that is known for them."""
    table = _table("", "value +- error", "truth", "off by", "truth in the 95 % interval")
    for name, estimate, truth in rows:
        low, high = estimate.interval(0.95)
        off = (float(estimate.value) - truth) / truth
        table.add_row(name, Text(str(estimate)), f"{truth:.6g}", f"{off:+.3%}", "yes" if low <= truth <= high else "no")
    return Group(Text(title, style="bold"), table)


def _headline(result: Measurement, file: str) -> str:
    elements = f"{result.points:,} points, " if result.points else ""
    lines = f", {result.lines:,} lines, seed {result.seed}" if result.lines else ""
    return f"{shown(file)}: {elements}area by {result.method}{lines}"


def _facts(result: Measurement, units: str) -> list[tuple[str, str]]:
    """Return in words what was found out about the surface and what was done to the points."""
    length = f" {units}" if units else ""
    leak = "" if math.isnan(result.leak) else f" ({result.leak:.2%} of the lines that hit leak)"
    facts = [
        ("closed", ("yes" if result.closed else "no") + leak),
        ("sides", f"{result.sides}: the area counts each sheet {'once' if result.sides == 'one' else 'twice'}"),
    ]
    if not math.isnan(result.spacing):
        facts.append(("spacing", f"{result.spacing:.4g}{length} between neighbouring points"))
    if not math.isnan(result.noise):
        facts.append(("noise", f"{result.noise:.2g} spacings"))
    if result.points:
        counts = dict(result.cleaning)
        without, wrong = counts.pop("without_normal", 0), counts.pop("wrong_normals", 0)
        dropped = [f"{count:,} {name.replace('_', ' ')}" for name, count in counts.items() if count]
        facts.append(("dropped", ", ".join(dropped) if dropped else "nothing"))
        if without:
            facts.append(("normals", f"{without:,} unknown ones were fitted"))
        if wrong:
            facts.append(("normals", f"{wrong:,} differ from those of all neighbours, and were fitted"))
    compiling = f", and {result.compile_seconds:.1f} s compiling once" if result.compile_seconds >= 0.05 else ""
    facts.append(("time", f"{result.seconds:.2f} s{compiling}"))
    return facts


def _add_estimate(table: Table, name: str, estimate: Estimate, units: str, power: int) -> None:
    label = f" {units}^{power}" if units else ""
    low, high = estimate.interval(0.95)
    if not estimate.reliable and not math.isfinite(float(estimate.value)):
        table.add_row(name, Text("unknown", style="yellow"), Text(estimate.reason))
        return
    doubt = "" if estimate.reliable else f" (not reliable: {estimate.reason})"
    span = f"{_number(low)} to {_number(high)}" if math.isfinite(high - low) else "no interval"
    table.add_row(name, Text(f"{estimate}{label}"), Text(span + doubt))


def _add_vector(table: Table, name: str, estimate: Estimate, units: str) -> None:
    label = f" {units}" if units else ""
    doubt = "" if estimate.reliable else f"not reliable: {estimate.reason}"
    table.add_row(name, Text(f"{estimate}{label}"), Text(doubt))


def _add_matrix(table: Table, name: str, estimate: Estimate) -> None:
    doubt = "about the centroid, unit density" if estimate.reliable else f"not reliable: {estimate.reason}"
    for number, row in enumerate(plain(estimate.value)):
        cells = "  ".join("unknown" if cell is None else f"{cell:12.5g}" for cell in row)
        table.add_row(name if number == 0 else "", Text(cells), Text(doubt if number == 0 else ""))


def _number(value: float) -> str:
    return f"{value:.6g}"


def _told(value: Any) -> str:
    """Return a value of a report in words."""
    if value is None:
        return "unknown"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return ", ".join(f"{key}: {_told(item)}" for key, item in value.items()) or "none"
    if isinstance(value, list):
        if value and all(isinstance(item, list) for item in value):
            return "  to  ".join(_told(item) for item in value)
        return ", ".join(_told(item) for item in value) or "none"
    return str(value)


def _table(*headings: str) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 3, 0, 0), show_header=any(headings), header_style="dim")
    for number, heading in enumerate(headings):
        table.add_column(heading, overflow="fold", min_width=_NAMES if number == 0 else None)
    return table
