"""How often the nominal 95 % intervals of random trees hold the truth, runs stopped by a tolerance included.

The truth of a tree is a run with many more elements and lines, whose own error is far below what is judged; where it is
not, the case is left out and counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import surfel
from benchmarks.random_trees import random_tree
from benchmarks.tables import busy, made_on, table
from surfel.core.estimate import Estimate

TREES = 200
SEEDS = 4
TRUTH = 1 << 20
LINES = 8192
TOLERANCE = 0.01
_SHARP = 0.25  # of a judged error, which the truth's must not exceed
_LEAST_VOLUME = 1e-3


class Case(NamedTuple):
    """One interval: of what, its tree, whether it held the truth, and how far off in its own errors."""

    kind: str
    tree: int
    held: bool
    off: float


def cases(trees: int, seeds: int, truth: int = TRUTH) -> Iterator[Case]:
    """Yield every interval of the first so many trees that are not empty."""
    number = done = 0
    while done < trees:
        tree = random_tree(number)
        known = surfel.measure(tree, lines=truth, seed=10_000)
        number += 1
        if known.volume is None or not float(known.volume.value) > _LEAST_VOLUME:
            continue
        done += 1
        for seed in range(seeds):
            plain = surfel.measure(tree, lines=LINES, seed=seed)
            lined = surfel.measure(tree, lines=LINES, seed=seed, method="lines")
            stopped = surfel.measure(tree, lines=1024, seed=seed, tolerance=TOLERANCE)
            stopped_lines = surfel.measure(tree, lines=1024, seed=seed, tolerance=TOLERANCE, method="lines")
            yield from _judged("area by patches", number, plain.area, known.area)
            yield from _judged("area by lines", number, lined.area, known.area)
            yield from _judged("volume", number, plain.volume, known.volume)
            yield from _judged("area by patches, tolerance", number, stopped.area, known.area)
            yield from _judged("area by lines, tolerance", number, stopped_lines.area, known.area)
            yield from _judged("volume, tolerance", number, stopped.volume, known.volume)


def _judged(kind: str, tree: int, found: Estimate | None, truth: Estimate) -> Iterator[Case]:
    assert found is not None
    error = float(found.standard_error)
    if float(truth.standard_error) > _SHARP * error and float(truth.standard_error) > 1e-12 * float(truth.value):
        return
    slack = 1e-12 * float(truth.value)
    low, high = found.interval(0.95)
    off = (float(found.value) - float(truth.value)) / max(error, slack)
    yield Case(kind, tree, low - slack <= float(truth.value) <= high + slack, off)


def report(found: list[Case], trees: int, seeds: int) -> str:
    """Return the table, with what was aimed at."""
    rows = []
    for kind in dict.fromkeys(case.kind for case in found):
        own = [case for case in found if case.kind == kind]
        share = np.mean([case.held for case in own])
        off = np.array([case.off for case in own])
        rows.append((kind, len(own), f"{100 * share:.1f}", "yes" if 0.92 <= share <= 0.98 else "no",
                     f"{np.median(np.abs(off)):.2f}", f"{np.mean(np.abs(off) > 4.0) * 100:.1f}"))  # fmt: skip
    whole = np.mean([case.held for case in found])
    rows.append(("all", len(found), f"{100 * whole:.1f}", "yes" if 0.92 <= whole <= 0.98 else "no", "", ""))
    head = ["interval", "cases", "held the truth, %", "92 to 98", "median abs(error) in its own", "beyond 4, %"]
    return "\n".join(
        [
            "# Coverage of intervals: random trees",
            "",
            f"{made_on()} {busy()}",
            "",
            f"{trees} random trees of one to eight exact leaves, {seeds} seeds each; nominal 95 %. {LINES:,} elements",
            f"or lines, or as many as a tolerance of {TOLERANCE:g} asks for. Normal errors have a median of",
            "0.67 of their own. Cases whose truth is not four times as sharp are left out.",
            "",
            table(head, rows),
        ]
    )


def run(quick: bool) -> str:
    """Measure and report."""
    trees, seeds, truth = (10, 2, 1 << 17) if quick else (TREES, SEEDS, TRUTH)
    return report(list(cases(trees, seeds, truth)), trees, seeds)
