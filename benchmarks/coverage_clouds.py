"""How often the nominal 95 % intervals of clouds hold the truth, on shapes that the intervals were not fitted to.

Every shape gives the same number of clouds: of 5,000, 20,000 and 100,000 points, at random, evenly apart, along scan
lines or 16 or 30 times as dense at one end, with normals, some of them with one in a hundred that points anywhere, or
none, clean or with noise of up to half a spacing.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.clouds import Cloud, generator
from benchmarks.coverage_shapes import CALIBRATING, JUDGING, shape
from benchmarks.samplings import SAMPLINGS
from benchmarks.shapes import NoDataError
from benchmarks.tables import busy, made_on, percent, table
from surfel.core.estimate import Estimate

SIZES = (5_000, 20_000, 100_000)
NOISES = (0.0, 0.007, 0.02, 0.1, 0.25, 0.5)
WRONG = 0.01
"""Share of the given normals, of one in four clouds that have any, that point anywhere."""

CLOUDS = 14
"""Clouds of each shape."""

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
    wrong: float = 0.0

    def cloud(self) -> Cloud:
        """Make the cloud; noise is Gaussian in all directions, in spacings of an even cloud of as many points."""
        known, random = shape(self.shape), generator("coverage", self.shape, self.size, self.sampling, self.seed)
        points, normals = SAMPLINGS[self.sampling](known, self.size, random)
        if self.noise:
            sigma = self.noise * math.sqrt(known.area / len(points))
            points = points + sigma * random.standard_normal(points.shape)
        if self.wrong:
            anywhere = random.standard_normal(normals.shape)
            anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
            normals = np.where(random.random((len(normals), 1)) < self.wrong, anywhere, normals)
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
    sizes, samplings = _dealt((*SIZES[:2] * 3, SIZES[2]), clouds, random), _dealt(tuple(SAMPLINGS), clouds, random)
    noises = _dealt((0.0, 0.0, 0.0, 0.0, *NOISES[1:]), clouds, random)
    for seed, (size, sampling, noise) in enumerate(zip(sizes, samplings, noises, strict=True)):
        given = bool(random.random() < (0.5 if noise == 0.0 else 0.25))
        wrong = WRONG if given and random.random() < 0.25 else 0.0
        yield Case(name, size, sampling, noise, given, seed, wrong)


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


def run(
    quick: bool,
    family: str = "judging",
    told: Callable[[str], None] = print,
    rows: str | None = None,
    minutes: float = math.inf,
) -> list[Answer]:
    """Measure the clouds of every shape of a family.

    Parameters
    ----------
    quick : bool
        A few clouds of a few shapes.
    family : {"judging", "calibrating"}
        Which shapes.
    told : callable
        Takes a line for each shape.
    rows : str, optional
        A file of answers, one JSON object a line. Those in it are not asked for again, and new ones are added, so that
        a run can be broken off and taken up.
    minutes : float
        Break off after so long; the answers so far are returned.
    """
    names = CALIBRATING if family == "calibrating" else JUDGING
    known, end = _saved(rows), time.monotonic() + 60.0 * minutes
    answers = []
    for name in names[:: 6 if quick else 1]:
        mine, left = [], list(cases_of(name, 6 if quick else CLOUDS))
        try:
            while left and (left[0] in known or time.monotonic() < end):
                case = left.pop(0)
                mine.append(known[case] if case in known else _kept(answered(case), rows))
        except NoDataError as absent:
            told(f"{name}: left out, {absent}")
            continue
        answers += mine
        told(f"{name}: {sum(a.held for a in mine)} of {len(mine)}{f', {len(left)} to do' if left else ''}")
    return answers


def _saved(rows: str | None) -> dict[Case, Answer]:
    """Return the answers in a file, by their cases."""
    if rows is None or not Path(rows).is_file():
        return {}
    read = (json.loads(line) for line in Path(rows).read_text(encoding="utf-8").splitlines())
    answers = [Answer(**{**row, "case": Case(**row["case"])}) for row in read]
    return {answer.case: answer for answer in answers}


def _kept(answer: Answer, rows: str | None) -> Answer:
    if rows is not None:
        with Path(rows).open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(answer)) + "\n")
    return answer


def report(answers: list[Answer], family: str = "judging") -> str:
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
{"These are other shapes, which were used for nothing else." if family == "judging" else "THESE ARE THE SAME SHAPES."}
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
    "normals": lambda case: (f"given, {case.wrong:.0%} wrong" if case.wrong else "given") if case.normals else "none",
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
