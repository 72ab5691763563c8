"""The error curves of Li et al. (2003): random and Niederreiter lines, chord and tangent, and marching cubes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.li2003_solids import Known
from surfel.core.cast import Floats
from surfel.lines.sequences import shifts
from surfel.measuring.baselines import marching_cubes
from surfel.measuring.baselines.random_lines import crossing_counts

RUNS = 16
SEQUENCES = ("random", "niederreiter")


@dataclass(frozen=True, eq=False)
class Curve:
    """Errors over a number of lines.

    Parameters
    ----------
    lines : Floats, shape (n,)
        How many lines.
    rms : Floats, shape (n,)
        The root mean square of the relative errors of sixteen runs: random shifts of Niederreiter's sequence, or
        independent pseudo-random numbers.
    single : Floats, shape (n,)
        The error of the first of these runs: what one experiment shows, as in the paper's figures.
    """

    solid: str
    model: str
    sequence: str
    lines: Floats
    rms: Floats
    single: Floats

    @property
    def order(self) -> float:
        """The power of the number of lines with which the error falls, fitted from 1,000 lines on."""
        far = self.lines >= 1000
        return float(np.polyfit(np.log(self.lines[far]), np.log(self.rms[far]), 1)[0])

    def at(self, lines: float) -> float:
        """Return the RMS error at the nearest number of lines of the curve."""
        return float(self.rms[np.abs(np.log(self.lines / lines)).argmin()])


def curve(known: Known, model: str, sequence: str, most: int, seed: int = 0) -> Curve:
    """Cast sixteen runs of ``most`` lines and look at the error on the way."""
    shape = known.make()
    ball = known.ball(shape)
    steps = np.unique(np.round(np.geomspace(64, most, 2 * round(np.log2(most / 64)) + 1)).astype(int))
    errors = np.empty((RUNS, len(steps)))
    for run, copy in enumerate(copies(sequence, most, seed)):
        total = np.cumsum(crossing_counts(shape, most, sequence, model, ball, **copy))[steps - 1]
        errors[run] = total * (0.5 * ball.surface) / steps / known.area - 1.0
    rms = np.sqrt(np.square(errors).mean(axis=0))
    return Curve(known.name, model, sequence, steps.astype(float), rms, np.abs(errors[0]))


def copies(sequence: str, lines: int, seed: int = 0) -> list[dict[str, Any]]:
    """Return what makes sixteen runs of a sequence differ: another part of the random numbers, or another shift."""
    if sequence == "random":
        return [{"start": (seed * RUNS + run) * lines} for run in range(RUNS)]
    return [{"shift": shift} for shift in shifts(seed, RUNS, 4)]


def curves(
    solids: Iterable[Known], models: Iterable[str], most: int, sequences: Iterable[str] = SEQUENCES
) -> dict[tuple[str, str, str], Curve]:
    """Return the curves of all solids, models and sequences, by these three names."""
    found = {}
    for known in solids:
        for model in models:
            for sequence in sequences:
                one = curve(known, model, sequence, most)
                found[known.name, model, sequence] = one
                print(
                    f"{known.name:14s} {model:8s} {sequence:13s} N^{one.order:.2f}, {one.rms[-1]:.2e} at {most}",
                    flush=True,
                )
    return found


def cube_curve(known: Known, sides: Iterable[int]) -> tuple[Floats, Floats, Floats]:
    """Return cubes along a side, triangles and relative errors of marching cubes."""
    shape = known.make()
    readings = [(side, marching_cubes(shape, side)) for side in sides]
    return (
        np.array([side for side, _ in readings], float),
        np.array([reading.elements for _, reading in readings], float),
        np.array([abs(reading.area / known.area - 1.0) for _, reading in readings]),
    )
