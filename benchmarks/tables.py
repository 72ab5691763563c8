"""Markdown tables, and what they were made on, in words."""

from __future__ import annotations

import datetime
import math
import os
import platform
from collections.abc import Iterable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def table(head: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    """Return a Markdown table; the first column is text, the others are numbers and stand to the right."""
    rows = [[str(cell) for cell in line] for line in lines]
    widths = [max([len(str(name)), 3, *(len(row[i]) for row in rows)]) for i, name in enumerate(head)]

    def line(cells: Sequence[str]) -> str:
        padded = [cell.rjust(w) if i else cell.ljust(w) for i, (cell, w) in enumerate(zip(cells, widths, strict=True))]
        return "| " + " | ".join(padded) + " |"

    rule = ["-" * widths[0]] + ["-" * (w - 1) + ":" for w in widths[1:]]
    return "\n".join([line(list(head)), line(rule), *map(line, rows)]) + "\n"


def percent(value: float, *, signed: bool = False) -> str:
    """Return a share in percent with three significant digits, or a dash."""
    if not math.isfinite(value):
        return "-"
    scaled = 100.0 * value
    digits = 3 if abs(scaled) < 1.0 else 2 if abs(scaled) < 10.0 else 1
    return f"{scaled:{'+' if signed else ''}.{digits}f}"


def seconds(value: float) -> str:
    """Return a time in the unit that suits it."""
    if not math.isfinite(value):
        return "-"
    unit, factor = next((pair for pair in (("s", 1.0), ("ms", 1e3)) if value * pair[1] >= 1.0), ("us", 1e6))
    return f"{value * factor:.3g} {unit}"


def made_on(packages: Sequence[str] = ("surfel", "numpy", "scipy", "numba")) -> str:
    """Return one line: the day, the kind of machine, and the versions."""
    found = []
    for name in packages:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name} absent")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    kind = f"{cores} core{'s' if cores != 1 else ''}, {platform.machine()}, {platform.system()}"
    return f"{today}; {kind}; Python {platform.python_version()}, {', '.join(found)}."


def busy() -> str:
    """Return how busy the machine is: times are to be read with it."""
    if not hasattr(os, "getloadavg"):
        return ""
    return f"Load average while this ran: {os.getloadavg()[0]:.1f}."


def publish(text: str, out: str | None) -> None:
    """Print a result, and write it to a file where one is named."""
    print("\n" + text, flush=True)
    if out is not None:
        path = Path(out)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
