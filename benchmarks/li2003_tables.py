"""Tables 1 to 3 of Li et al. (2003): times and errors of lines, marching cubes and recursive subdivision."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.li2003_curves import Curve, copies
from benchmarks.li2003_solids import L_RADIUS, SKELETON, SPHERE_20, Known, L
from surfel.lines.enclosing import Ball
from surfel.lines.models import line_block
from surfel.measuring.baselines import Reading, marching_cubes, random_lines, subdivision

LEVELS = (8.0, 4.0, 2.0, 1.0, 0.5, 0.25)
TIMED = (SPHERE_20, SKELETON, L)

PAPER_1 = {"random": (1.439, 10_000, 1.6615), "niederreiter": (1.450, 10_000, 0.7674), "cubes": (98.21, 29_212, 2.5766)}
PAPER_2 = {
    8.0: (0.0686281, 0.0897207, 0.0852837),
    4.0: (0.0985547, 0.408693, 0.0942379),
    2.0: (0.517069, 0.859189, 0.0969864),
    1.0: (0.539595, 1.11492, 0.0989368),
    0.5: (1.91135, 2.21722, 0.099912),
    0.25: (2.05938, 3.55824, 0.180743),
}
PAPER_3 = {
    8.0: (0.010600, 0.029900, 0.029000),
    4.0: (0.042400, 0.080800, 0.094800),
    2.0: (0.074650, 0.130150, 0.161900),
    1.0: (0.106600, 0.181550, 0.228300),
    0.5: (0.138700, 0.234000, 0.293900),
    0.25: (0.169700, 0.334700, 0.359600),
}

_FINER = 1.2  # efforts of subdivision are refined by this factor
_COARSEST, _FINEST = 0.4, 60.0


@dataclass(frozen=True)
class Timing:
    """How long it took to come as near as asked; ``elements``: lines or facets; ``least``: no coarser run was tried."""

    seconds: float
    elements: int
    least: bool = False


def table_1(repeats: int) -> dict[str, tuple[float, int, float]]:
    """Return seconds, elements and the relative error in percent of three methods on the L: 10^4 lines, 10^6 cubes."""
    shape = L.make()
    ball = L.ball(shape)
    found = {}
    for sequence in ("random", "niederreiter"):
        runs = [
            random_lines(shape, 10_000, sequence=sequence, ball=ball, **copy) for copy in copies(sequence, 10_000, 1)
        ]
        rms = float(np.sqrt(np.mean([(run.area / L.area - 1.0) ** 2 for run in runs])))
        found[sequence] = (statistics.median(run.seconds for run in runs), 10_000, 100.0 * rms)
    cubes = [marching_cubes(shape, 100) for _ in range(repeats)]
    seconds = statistics.median(run.seconds for run in cubes)
    found["cubes"] = (seconds, cubes[0].elements, 100.0 * abs(cubes[0].area / L.area - 1.0))
    return found


def table_2(known: Known, repeats: int) -> dict[float, Timing]:
    """Return what recursive subdivision takes to each level.

    As in the paper the limit is refined until two areas are found, one less accurate than wanted and one more, and the
    time is interpolated linearly between them.
    """
    shape = known.make()
    found: dict[float, Timing] = {}
    before: tuple[float, float] | None = None
    effort = _COARSEST
    while effort < _FINEST and len(found) < len(LEVELS):
        reading = _timed(partial(subdivision, shape, effort), repeats)
        error = 100.0 * abs(reading.area / known.area - 1.0)
        for level in LEVELS:
            if level in found or error > level:
                continue
            if before is None:
                found[level] = Timing(reading.seconds, reading.elements, least=True)
            else:
                share = (before[0] - level) / (before[0] - error)
                found[level] = Timing(before[1] + share * (reading.seconds - before[1]), reading.elements)
        before = (error, reading.seconds)
        effort *= _FINER
    return found


def table_3(known: Known, one: Curve, repeats: int) -> dict[float, Timing]:
    """Return what Niederreiter's lines take to each level: the fewest of a curve whose RMS error is that small."""
    shape = known.make()
    ball = known.ball(shape)
    found = {}
    for level in LEVELS:
        enough = np.flatnonzero(100.0 * one.rms <= level)
        if len(enough):
            number = int(one.lines[enough[0]])
            run = _timed(partial(random_lines, shape, number, sequence="niederreiter", ball=ball), repeats)
            found[level] = Timing(run.seconds, number, least=bool(enough[0] == 0))
    return found


def model_times(repeats: int, lines: int = 1 << 18) -> dict[str, tuple[float, float]]:
    """Return, for each model, nanoseconds a line to make it, and to make it and cross the L with it."""
    shape = L.make()
    ball = Ball(np.asarray(shape.bounds).mean(axis=0), L_RADIUS)
    found = {}
    for model in ("chord", "tangent"):
        making = _median(partial(line_block, "niederreiter", model, ball, 0, lines, lines), repeats)
        counting = partial(random_lines, shape, lines, sequence="niederreiter", model=model, ball=ball)
        whole = _median(counting, repeats)
        found[model] = (1e9 * making / lines, 1e9 * whole / lines)
    return found


def _timed(run: Callable[[], Reading], repeats: int) -> Reading:
    readings = [run() for _ in range(repeats)]
    return readings[0]._replace(seconds=min(reading.seconds for reading in readings))


def _median(run: Callable[[], object], repeats: int) -> float:
    spent = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        run()
        spent.append(time.perf_counter() - start)
    return statistics.median(spent[1:])
