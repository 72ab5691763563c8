"""Judges: the share of wrong answers of each, case by case, beside what the first prototypes reached; and times."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.clouds import generator
from benchmarks.judge_cases import CLOUDS, PLACES, Case, cases_of, known_solid, places_of
from benchmarks.shapes import NoDataError
from benchmarks.tables import busy, made_on, table
from surfel.core.cast import Floats
from surfel.inside.judges import choose, named
from surfel.inside.operand import Operand

FACTOR = 1.5
"""The published judges shall not be worse than the prototypes by more than this."""

COLUMNS = ("nearest", "two-nearest", "imls", "mls", "two-cluster", "winding", "indicator")

PROTOTYPE: dict[tuple[str, str], tuple[float, ...]] = {
    ("bunny", "all"): (0.024, 0.016, 0.040, 0.056, 0.038, 0.054),
    ("bunny", "near"): (0.71, 0.68, 0.92, 1.0, 0.87, 1.1),
    ("box", "edge"): (7.1, 2.5, 9.7, 9.0, 0.15, 8.4),
    ("concave CSG", "edge"): (7.5, 2.7, 9.6, 8.6, 0.40, 7.9),
    ("thin plate", "near"): (0.24, 0.08, 0.28, 0.48, 0.012, 6.5),
    ("uneven 1:30", "all"): (0.070, 0.072, 0.11, 0.16, 0.088, 0.18),
    ("noise .5 % + 10 degrees", "all"): (3.1, 2.7, 0.99, 3.8, 1.0, 1.5, 0.33),
    ("20 % of the normals flipped", "all"): (20.0, 20.0, 2.2, 4.9, 20.0, 1.2, 0.23),
    ("a 12 % patch flipped", "all"): (5.9, 5.9, 5.9, 5.9, 5.9, 4.3),
}
"""Percent wrong: columns in the order of ``COLUMNS``."""


PATCH = "a 12 % patch flipped"
"""How many places a patch spoils depends on where it lies: there judges are compared by their ratio to the nearest."""


@dataclass(frozen=True)
class Score:
    """The shares of wrong answers for one case, in percent, and which judge would have been chosen."""

    cloud: str
    places: str
    count: int
    wrong: dict[str, float]
    chosen: str


def run(quick: bool) -> list[Score]:
    """Judge all cases by all judges; every cloud is drawn several times, and the means are reported."""
    scores = []
    for cloud in CLOUDS[:9] if quick else CLOUDS:
        draws = 1 if quick else cloud.draws
        try:
            found = [score(case) for draw in range(draws) for case in cases_of(cloud, 5000 if quick else PLACES, draw)]
        except NoDataError as error:
            print(error)
            continue
        for kind in cloud.places:
            scores.append(_mean([one for one in found if one.places == kind]))
    return scores


def score(case: Case) -> Score:
    wrong = {name: percent_wrong(case, name) for name in COLUMNS}
    return Score(case.cloud, case.places, len(case.queries), wrong, choose(case.operand).name)


def percent_wrong(case: Case, name: str, **parameters: Any) -> float:
    return 100.0 * float(np.mean(named(name)(case.operand, case.queries, **parameters).inside != case.inside))


def _mean(scores: list[Score]) -> Score:
    wrong = {name: float(np.mean([one.wrong[name] for one in scores])) for name in COLUMNS}
    return Score(
        scores[0].cloud, scores[0].places, sum(one.count for one in scores), wrong,
        " or ".join(sorted({one.chosen for one in scores})),
    )  # fmt: skip


def beside_prototype(score: Score, name: str) -> int:
    """Return 1 where a judge is worse than its prototype by more than the factor, -1 where better, and 0 else.

    Shares near zero are a few places each: three standard deviations of both counts are allowed for.
    """
    published = dict(zip(COLUMNS, PROTOTYPE.get((score.cloud, score.places), ()), strict=False))
    if name not in published:
        return 0
    scale = score.wrong["nearest"] / published["nearest"] if score.cloud == PATCH else 1.0
    share, prototype = score.wrong[name] / 100.0, scale * published[name] / 100.0
    chance = 3.0 * np.sqrt(FACTOR * prototype * (1.0 / score.count + 0.5 / PLACES))
    return int(share > FACTOR * prototype + chance) - int(share < prototype / FACTOR - chance)


@dataclass(frozen=True)
class Timing:
    """Microseconds a place, near the surface and all over the box: on a clock, and of one thread's work."""

    name: str
    near: float
    everywhere: float
    work: float


def timings(quick: bool) -> list[Timing]:
    """Time every judge, and SciPy's tree beside them, on 100,000 surfels of the bunny (or the box)."""
    from scipy.spatial import cKDTree

    try:
        solid = known_solid("bunny")
    except NoDataError:
        solid = known_solid("box")
    rng = generator("judges", "time")
    n = 10_000 if quick else 100_000
    points, normals = solid.draw(n, rng, smooth=True)
    operand = Operand.of(points, normals)
    near = places_of("near", solid, n, operand.spacing, rng)
    everywhere = places_of("all", solid, n // 2, operand.spacing, rng)
    tree = cKDTree(points)
    found = [_timing("SciPy cKDTree, nearest", partial(tree.query, workers=-1), near, everywhere)]
    found.append(_timing("SciPy cKDTree, 10 nearest", partial(tree.query, k=10, workers=-1), near, everywhere))
    for name in COLUMNS:
        found.append(_timing(name, partial(named(name), operand), near, everywhere))
    found.append(_timing("brute", partial(named("brute"), operand), near[: n // 50], everywhere[: n // 50]))
    return found


def _timing(name: str, judge: Callable[[Floats], Any], near: Floats, everywhere: Floats) -> Timing:
    judge(near), judge(everywhere)  # compiled, and what is derived from the cloud is there
    clock, work = zip(*(_spent(judge, near) for _ in range(5)), strict=True)
    far, _ = zip(*(_spent(judge, everywhere) for _ in range(5)), strict=True)
    return Timing(name, float(np.median(clock)), float(np.median(far)), float(np.median(work)))


def _spent(judge: Callable[[Floats], Any], places: Floats) -> tuple[float, float]:
    start, worked = time.perf_counter(), time.process_time()
    judge(places)
    scale = 1e6 / len(places)
    return scale * (time.perf_counter() - start), scale * (time.process_time() - worked)


def report(scores: list[Score], times: list[Timing]) -> str:
    """Return the tables as Markdown."""
    beside = [_row(one) for one in scores if (one.cloud, one.places) in PROTOTYPE]
    other = [_row(one) for one in scores if (one.cloud, one.places) not in PROTOTYPE]
    said = [(beside_prototype(one, name), f"{name} on {one.cloud}") for one in scores for name in COLUMNS]
    behind, ahead = ("; ".join(text for sign, text in said if sign == which) or "none" for which in (1, -1))
    head = ["case, places", *COLUMNS, "auto"]
    return "\n".join(
        [
            "# Judges: is a place inside a cloud?\n",
            __doc__ or "",
            "Percent of places judged wrongly against the parity of the mesh that the cloud was drawn from; in "
            "brackets the prototype's.\n"
            "*All*: the surfels of a turned and shifted bunny; *near*: within 2 spacings of the surface; *edge*: at "
            "sharp edges. Clouds have 62,000 random surfels unless said otherwise.\n"
            "How much a flipped patch spoils depends on where it lies: the mean over several patches is given, while "
            "the prototype's is one patch; the other judges are compared there by their ratio to the nearest surfel.\n",
            table(head, beside),
            f"Worse than {FACTOR} times the prototype, beyond chance: {behind}. Better by that factor: {ahead}.\n",
            "Where a fifth of the normals is flipped, the two nearest surfels often contradict each other. Distance "
            "skipping hands no such answer on to other places, so that far ones are judged better than one by one "
            "(20 % wrong).\n",
            "## Other clouds\n",
            table(head, other),
            "## Time\n",
            table(
                ["judge", "near, us a place", "all over, us a place", "near, us of work"],
                [(one.name, *(f"{t:.2f}" for t in (one.near, one.everywhere, one.work))) for one in times],
            ),
            f"{made_on()} {busy()}\n",
        ]
    )


def _row(score: Score) -> list[str]:
    published = dict(zip(COLUMNS, PROTOTYPE.get((score.cloud, score.places), ()), strict=False))
    cells = [_percent(score.wrong[n]) + (f" ({published[n]:g})" if n in published else "") for n in COLUMNS]
    return [f"{score.cloud}, {score.places}", *cells, score.chosen]


def _percent(value: float) -> str:
    return f"{value:.3f}" if value < 1.0 else f"{value:.2f}" if value < 10.0 else f"{value:.1f}"
