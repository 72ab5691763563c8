"""How often the nominal 95 % intervals of clouds hold the truth, on shapes that the intervals were not fitted to.

Every shape gives the same number of clouds: of 5,000, 20,000 and 100,000 points, at random, evenly apart, along scan
lines or 16 or 30 times as dense at one end, with normals or none, clean or with noise of up to half a spacing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.clouds import APART, Cloud, generator
from benchmarks.coverage_shapes import CALIBRATING, FRESH, shape
from benchmarks.pieces import Floats
from benchmarks.shapes import KnownShape, NoDataError
from benchmarks.tables import busy, made_on, percent, table
from surfel.core.estimate import Estimate

SIZES = (5_000, 20_000, 100_000)
SAMPLINGS = ("random", "even", "scan lines", "16x", "30x")
NOISES = (0.0, 0.02, 0.1, 0.25, 0.5)
CLOUDS = 16
"""Clouds of each shape."""

STRETCH = 3.0
"""How much nearer than across points lie along a scan line."""

LINES = 8192
"""For the volume; the area of a cloud needs none."""

LEAST_STRATUM = 0.88
"""No stratum shall hold the truth less often than this."""


@dataclass(frozen=True)
class Case:
    """One cloud to be made and measured."""

    shape: str
    size: int
    sampling: str
    noise: float
    normals: bool
    seed: int

    def cloud(self) -> Cloud:
        """Make the cloud; noise is Gaussian in all directions, in spacings of an even cloud of as many points."""
        known, random = shape(self.shape), generator("coverage", self.shape, self.size, self.sampling, self.seed)
        points, normals = _DRAWN[self.sampling](known, self.size, random)
        if self.noise:
            sigma = self.noise * math.sqrt(known.area / len(points))
            points = points + sigma * random.standard_normal(points.shape)
        return Cloud(self.shape, points, normals if self.normals else None, known)


@dataclass(frozen=True)
class Answer:
    """What surfel said about a case; errors are relative to the truth."""

    case: Case
    error: float
    half_width: float
    reliable: bool
    reason: str
    seconds: float
    volume_error: float = math.nan
    volume_half_width: float = math.nan

    @property
    def held(self) -> bool:
        """Whether the interval holds the truth."""
        return abs(self.error) <= self.half_width


def cases_of(name: str, clouds: int = CLOUDS) -> Iterator[Case]:
    """Yield the cases of a shape: every value of every stratum comes about equally often, whatever the shape.

    Half of the clouds are clean. Noisy ones have no normals in three of four cases.
    """
    random = generator("cases of coverage", name)
    sizes, samplings = _dealt((*SIZES[:2] * 3, SIZES[2]), clouds, random), _dealt(SAMPLINGS, clouds, random)
    noises = _dealt((0.0, 0.0, 0.0, 0.0, *NOISES[1:]), clouds, random)
    for seed, (size, sampling, noise) in enumerate(zip(sizes, samplings, noises, strict=True)):
        given = bool(random.random() < (0.5 if noise == 0.0 else 0.25))
        yield Case(name, size, sampling, noise, given, seed)


def _dealt(values: tuple, count: int, random: np.random.Generator) -> list:
    """Return ``count`` values in random order, each as often as its share of ``values``."""
    pack = [values[k % len(values)] for k in range(count)]
    return [pack[k] for k in random.permutation(count)]


def answered(case: Case) -> Answer:
    """Make one cloud and measure it."""
    import surfel

    cloud = case.cloud()
    start = time.perf_counter()
    found = surfel.measure(surfel.Surfels(cloud.points, cloud.normals), lines=LINES, seed=0)
    seconds = time.perf_counter() - start
    error, half = _compared(found.area, cloud.shape.area)
    volume, reliable = (math.nan, math.nan), found.area.reliable
    if cloud.shape.volume is not None and found.volume is not None and found.volume.reliable:
        volume = _compared(found.volume, cloud.shape.volume)
    return Answer(case, error, half, reliable, found.area.reason, seconds, *volume)


def _compared(found: Estimate, truth: float) -> tuple[float, float]:
    low, high = found.interval(0.95)
    return float(found.value) / truth - 1.0, 0.5 * (high - low) / truth


def _random(known: KnownShape, n: int, random: np.random.Generator) -> tuple[Floats, Floats]:
    return known.draw(n, random)


def _even(known: KnownShape, n: int, random: np.random.Generator) -> tuple[Floats, Floats]:
    points, normals = known.draw(5 * n, random)
    rows = _darts(points, normals, APART * math.sqrt(known.area / n), 1.0, random)
    return points[rows], normals[rows]


def _scan_lines(known: KnownShape, n: int, random: np.random.Generator) -> tuple[Floats, Floats]:
    """Darts whose distance is longer along the lines: where the surface crosses planes through a random axis."""
    points, normals = known.draw(5 * n, random)
    axis = random.standard_normal(3)
    along = np.cross(normals, axis / np.linalg.norm(axis))
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-12
    rows = _darts(points, along, APART * math.sqrt(known.area / n), STRETCH, random)
    return points[rows], normals[rows]


def _darts(
    points: Floats, along: Floats, apart: float, stretch: float, random: np.random.Generator
) -> NDArray[np.int64]:
    """Take points in random order; each keeps away later ones, the farther across its direction the more stretch."""
    from scipy.spatial import cKDTree

    order = random.permutation(len(points))
    place, way = points[order], along[order]
    pairs = cKDTree(place).query_pairs(apart * math.sqrt(stretch), output_type="ndarray")
    offset = place[pairs[:, 1]] - place[pairs[:, 0]]
    on_line = np.einsum("ij,ij->i", offset, way[pairs[:, 0]]) ** 2
    off_line = np.einsum("ij,ij->i", offset, offset) - on_line
    pairs = np.sort(pairs[on_line * stretch + off_line / stretch < apart * apart], axis=1)
    earlier, later = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].T
    starts = np.searchsorted(earlier, np.arange(len(points) + 1))
    alive = np.ones(len(points), bool)
    for i in range(len(points)):
        if alive[i]:
            alive[later[starts[i] : starts[i + 1]]] = False
    return order[alive]


def _uneven(ratio: float) -> Callable[[KnownShape, int, np.random.Generator], tuple[Floats, Floats]]:
    def draw(known: KnownShape, n: int, random: np.random.Generator) -> tuple[Floats, Floats]:
        points, normals = known.draw(int(8 * n * math.sqrt(ratio / 16.0) * 1.5), random)
        axis = int(np.argmax(np.ptp(points, axis=0)))
        height = (points[:, axis] - points[:, axis].min()) / np.ptp(points[:, axis])
        rows = np.flatnonzero(random.random(len(points)) < ratio ** (height - 1.0))[:n]
        return points[rows], normals[rows]

    return draw


_DRAWN: dict[str, Callable[[KnownShape, int, np.random.Generator], tuple[Floats, Floats]]] = {
    "random": _random,
    "even": _even,
    "scan lines": _scan_lines,
    "16x": _uneven(16.0),
    "30x": _uneven(30.0),
}


def run(quick: bool, family: str = "fresh", told: Callable[[str], None] = print) -> list[Answer]:
    """Measure the clouds of every shape of a family."""
    names = CALIBRATING if family == "calibrating" else FRESH
    answers = []
    for name in names[:: 6 if quick else 1]:
        try:
            mine = [answered(case) for case in cases_of(name, 6 if quick else CLOUDS)]
        except NoDataError as absent:
            told(f"{name}: left out, {absent}")
            continue
        answers += mine
        told(f"{name}: {sum(a.held for a in mine)} of {len(mine)}")
    return answers


def report(answers: list[Answer], family: str = "fresh") -> str:
    """Return the tables, with what was aimed at."""
    strata: list[tuple[str, list[Answer]]] = [("all", answers)]
    for kind, value_of in _STRATA.items():
        for value in dict.fromkeys(sorted(value_of(a.case) for a in answers)):
            strata.append((f"{kind}: {value}", [a for a in answers if value_of(a.case) == value]))
    by_shape = [
        (name, [a for a in answers if a.case.shape == name]) for name in dict.fromkeys(a.case.shape for a in answers)
    ]
    refused_clean = sum(not a.reliable for a in answers if a.case.noise == 0.0)
    head = ["clouds", "cases", "refused", "held, %", "aim", "met", "median half-width, %", "median abs(error), %"]
    return f"""# Coverage of intervals: clouds

{made_on()} {busy()}

Nominal 95 % intervals of the area, and how many of those that were given hold the truth. A refused answer is one that
surfel calls unreliable; those beyond a tenth of a line count as misses. Refused clean clouds: {refused_clean} (aim: 0).

The constants of the interval were fitted to clouds of these shapes: {", ".join(CALIBRATING)}.
{"These are other shapes, which were used for nothing else." if family == "fresh" else "THESE ARE THE SAME SHAPES."}
{len(answers)} clouds of {len(by_shape)} shapes.

{table(head, [_line(name, mine, name == "all") for name, mine in strata])}
{_volumes(answers)}
## By shape

{table(head, [_line(name, mine, None) for name, mine in by_shape])}"""


def _volumes(answers: list[Answer]) -> str:
    """Return one sentence on the volumes of those clouds that were found closed, and whose truth is known."""
    known = [a for a in answers if math.isfinite(a.volume_error)]
    if not known:
        return ""
    held = sum(abs(a.volume_error) <= a.volume_half_width for a in known)
    width, error = (
        float(np.median(np.abs(values)))
        for values in ([a.volume_half_width for a in known], [a.volume_error for a in known])
    )
    return (
        f"Volumes: {len(known)} clouds were found closed whose volume is known. Their intervals, of {LINES:,} lines, "
        f"held it in {100.0 * held / len(known):.1f} %; median half-width {percent(width)} %, median error "
        f"{percent(error)} %.\n"
    )


_STRATA: dict[str, Callable[[Case], str]] = {
    "points": lambda case: f"{case.size:7,}",
    "normals": lambda case: "given" if case.normals else "none",
    "noise": lambda case: f"{case.noise:g} spacings" if case.noise else "clean",
    "sampling": lambda case: case.sampling,
}


def _line(name: str, mine: list[Answer], whole: bool | None) -> list[str]:
    given = [a for a in mine if a.reliable]
    refused = len(mine) - len(given)
    counted = len(given) + max(0.0, refused - 0.1 * len(mine))
    share = sum(a.held for a in given) / counted if counted else math.nan
    widths, errors = [a.half_width for a in given] or [math.nan], [abs(a.error) for a in given] or [math.nan]
    aim = "" if whole is None else "93 to 97" if whole else f"{100 * LEAST_STRATUM:g}"
    met = "" if whole is None else "yes" if (0.93 <= share <= 0.97 if whole else share >= LEAST_STRATUM) else "no"
    return [
        name, str(len(mine)), str(refused), f"{100 * share:.1f}", aim, met, percent(float(np.median(widths))),
        percent(float(np.median(errors))),
    ]  # fmt: skip
