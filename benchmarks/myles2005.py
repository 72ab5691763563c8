"""Myles and Peters, *Fast Safe Spline Surrogates for Large Point Clouds*: its tables and figures, and our aims.

The times of the paper are those of a Pentium 4 of 2.4 GHz. Its clouds are not public: two moving balls of scattered
points are drawn as sec. 7 describes them, in ten configurations, each fitted twenty times.
"""

from __future__ import annotations

import re
import statistics
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import surfel
from benchmarks.clock import median_seconds, processor_seconds
from benchmarks.heights import CONFIGURATIONS, balls, bunny, smooth
from benchmarks.shapes import NoDataError
from benchmarks.tables import busy, made_on, seconds, table

MODES = ("paper", "fast", "tight")
FITS = 20
PATIENCE = 5.0
"""After so many seconds in a cell of a table each further configuration is fitted once."""
SIZES = {10_000: 14.5, 30_000: 42.5, 50_000: 71.0, 100_000: 141.0, 300_000: 445.0}
"""Table 1: points, and milliseconds of the paper."""
GRIDS = {10: 42.5, 20: 42.5, 30: 45.0, 40: 51.0, 50: 55.5, 60: 64.5}
"""Table 2: coefficients a side, and milliseconds of the paper at 30,000 points."""
AIMED_AT = {"paper": 20.0, "fast": 8.0, "tight": 60.0}
"""Milliseconds at 300,000 points."""
GROWTH = 1.5
BUNNY_MS = 58.0


def _fit_times(n: int, side: int, mode: str, fits: int) -> list[float]:
    """Return the milliseconds of each fit over all configurations of the two balls."""
    spent = []
    for step in range(CONFIGURATIONS):
        points = balls(n, np.random.default_rng(step), step)
        for _ in range(fits if sum(spent) < 1e3 * PATIENCE else 1):
            spent.append(1e3 * processor_seconds(lambda p=points: surfel.bound(p, shape=(side, side), mode=mode)))
    return spent


def table_1(quick: bool) -> str:
    """Time over the number of points."""
    rows = []
    for n, theirs in SIZES.items():
        means = [statistics.fmean(_fit_times(n, 20, mode, 2 if quick else FITS)) for mode in MODES]
        rows.append([f"{n:,}", f"{theirs:g}", *(f"{mean:.1f}" for mean in means)])
        print(" | ".join(rows[-1]), flush=True)
    last = dict(zip(MODES, map(float, rows[-1][2:]), strict=True))
    met = ", ".join(
        f"`{mode}` {last[mode]:.1f} (at most {most:g}: {'met' if last[mode] <= most else 'missed'})"
        for mode, most in AIMED_AT.items()
    )
    return f"""## Table 1: milliseconds for N points, 20 x 20 coefficients

Two moving balls, means over {CONFIGURATIONS} configurations x {2 if quick else FITS} fits; processor time
on one thread, projection and verification of every point included. Once a cell has taken {PATIENCE:g} s, the
configurations that are left are fitted once each.

{table(["N", "paper 2005", *MODES], rows)}
At 300,000 points: {met}.
"""


def table_2(quick: bool) -> str:
    """Time over the number of coefficients."""
    rows = []
    for side, theirs in GRIDS.items():
        means = [statistics.fmean(_fit_times(30_000, side, mode, 2 if quick else FITS)) for mode in MODES]
        rows.append([str(side), f"{theirs:g}", *(f"{mean:.1f}" for mean in means)])
        print(" | ".join(rows[-1]), flush=True)
    at = {row[0]: [float(cell) for cell in row[1:]] for row in rows}
    growth = [at["60"][k] / at["20"][k] for k in range(4)]
    told = ", ".join(
        f"`{mode}` {ratio:.2f} ({'met' if ratio <= GROWTH else 'missed'})"
        for mode, ratio in zip(MODES, growth[1:], strict=True)
    )
    return f"""## Table 2: milliseconds for n x n coefficients, 30,000 points

{table(["n", "paper 2005", *MODES], rows)}
From 20 x 20 to 60 x 60, aimed at a growth of at most {GROWTH:g} (the paper's own is {growth[0]:.2f}): {told}.
"""


def bunny_time(quick: bool) -> str:
    """Time of the range scan of Fig. 11, from both sides."""
    try:
        points = bunny()
    except NoDataError as absent:
        return f"## The bunny range scan\n\nSkipped: {absent}.\n"
    rows = []
    for mode in MODES:
        spent = [
            median_seconds(lambda m=mode, s=s: surfel.bound(points, side=s, mode=m), 9) for s in ("above", "below")
        ]
        rows.append([mode, *(f"{1e3 * each:.2f}" for each in spent)])
    return f"""## The bunny range scan: {len(points):,} points, 20 x 20 coefficients, milliseconds of processor time

The paper: {BUNNY_MS:g} in front, 59.5 behind.

{table(["mode", "front", "back"], rows)}"""


class Run:
    """Points drawn chunk by chunk, the same ones on every pass, so that none need to be kept."""

    def __init__(self, n: int, chunk: int = 1_000_000) -> None:
        self._parts = [(seed, min(chunk, n - seed * chunk)) for seed in range(-(-n // chunk))]
        self._made = smooth(chunk, np.random.default_rng(0))

    def __iter__(self) -> Iterator[np.ndarray]:
        for seed, count in self._parts:
            part = self._made[:count]
            yield part if seed % 2 == 0 else part * np.array([1.0, 1.0, -1.0])


def large(quick: bool) -> str:
    """Time of large clouds, in memory and streamed, and what memory that takes."""
    import tracemalloc

    rows = []
    points = smooth(300_000 if quick else 3_000_000, np.random.default_rng(0))
    spent, most = median_seconds(lambda: surfel.bound(points), 5), 0.120
    rows.append([f"{len(points):,} in memory", seconds(most), seconds(spent), "yes" if spent <= most else "no", ""])
    for n in (3_000_000,) if quick else (3_000_000, 30_000_000):
        run = Run(n)
        start = time.perf_counter()
        surfel.bound(run)
        spent = time.perf_counter() - start
        tracemalloc.start()
        surfel.bound(run)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        aimed = 1.5 if n == 30_000_000 else float("nan")
        met = ("yes" if spent <= aimed else "no") if n == 30_000_000 else ""
        rows.append([f"{n:,} streamed", seconds(aimed), seconds(spent), met, f"{peak / 1e6:.0f} MB"])
    return f"""## Large clouds, mode `fast`, 20 x 20

In memory: processor time on one thread. Streamed, in chunks of a million: on the clock, on all threads, drawing the
chunks included; the memory is what the fit allocates at its peak,
without the chunk that it was given.

{table(["points", "aimed at", "reached", "met", "memory"], rows)}"""


def _histograms(quick: bool) -> str:
    from benchmarks import myles2005_counts

    return myles2005_counts.histograms(quick)


def _checks(quick: bool) -> str:
    from benchmarks import myles2005_checks

    return myles2005_checks.checks(quick)


def _rays(quick: bool) -> str:
    from benchmarks import myles2005_checks

    return myles2005_checks.rays(quick)


def _sandwiches(quick: bool) -> str:
    from benchmarks import myles2005_checks

    return myles2005_checks.sandwiches(quick)


def _pictures(quick: bool) -> str:
    return "## Pictures\n\nThey are drawn beside the file of results; name one by `--out`.\n"


PARTS: dict[str, Callable[[bool], str]] = {
    "table1": table_1, "table2": table_2, "bunny": bunny_time, "large": large, "histograms": _histograms,
    "rays": _rays, "sandwiches": _sandwiches, "checks": _checks, "pictures": _pictures,
}  # fmt: skip


def run(parts: list[str], out: str | None, *, quick: bool = False) -> str:
    """Return the parts as Markdown. In a file, the chosen parts are put in the place of older ones as they are done."""
    for mode in MODES:  # kernels are loaded before any clock runs
        surfel.bound(smooth(2_000, np.random.default_rng(0)), mode=mode)
    known = {} if out is None or not Path(out).exists() else _parts_of(Path(out).read_text(encoding="utf-8"))
    for part in parts:
        print(f"-- {part}", flush=True)
        if part == "pictures" and out is not None:
            from benchmarks import myles2005_pictures

            text = myles2005_pictures.draw_all(out)
        else:
            text = PARTS[part](quick)
        known[part] = f"{text.rstrip()}\n\n*{made_on()} {busy()}*\n"
        if out is not None:
            Path(out).write_text(_joined(known), encoding="utf-8")
    return _joined(known)


_TITLE = "# Myles and Peters: fast safe spline surrogates\n"


def _joined(known: dict[str, str]) -> str:
    sections = [f"<!-- part: {part} -->\n\n{known[part].strip()}\n" for part in PARTS if part in known]
    return "\n".join([_TITLE, *sections])


def _parts_of(text: str) -> dict[str, str]:
    """Return the sections of an older file by their parts."""
    pieces = re.split(r"^<!-- part: (\w+) -->$", text, flags=re.MULTILINE)
    return {part: section for part, section in zip(pieces[1::2], pieces[2::2], strict=True) if part in PARTS}
