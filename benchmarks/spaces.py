"""Space: what the coloured grid gets wrong and what it costs, beside the octrees of Adams and Dutre and of Gaal.

Wrong answers are counted against the parity of the mesh that a cloud was drawn from. What was tuned on is said.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.judge_cases import PLACES, Case, Cloud, cases_of
from benchmarks.shapes import NoDataError
from benchmarks.space_times import DEPTHS, builds, motions, octrees
from benchmarks.tables import busy, made_on, table
from surfel.inside.classify import Classifier
from surfel.inside.octree_classify import OctreeClassifier

DEPTH = 5
TUNED = ("fertility", "rocker-arm", "cow", "fandisk", "box", "csg", "plate")
"""Solids that the grid and its judges were tuned on."""

SMOOTH = {"all": 0.03, "near": 0.8}
EDGE = {"all": 0.03, "edge": 0.2}
THIN = {"all": 0.02, "near": 0.02}
NOISE, FLIPS, PATCH, UNEVEN = ({"all": percent} for percent in (0.4, 0.4, 0.3, 0.1))


def _noisy(name: str) -> Cloud:
    return Cloud(f"{name}, noise .5 % + 10 degrees", name, noise=0.0075, degrees=10.0)


KINDS: tuple[tuple[str, dict[str, float], tuple[Cloud, ...]], ...] = (
    ("smooth", SMOOTH, tuple(Cloud(n, n) for n in ("bunny", "armadillo", "horse", "igea", "dragon", "spot", "3holes",
                                                   "torus mesh", "fertility", "rocker-arm"))),
    ("edges", EDGE, tuple(Cloud(n, n, smooth=False, places=("all", "edge")) for n in ("112932", "88566", "box", "csg",
                                                                                      "fandisk"))),
    ("thin plate", THIN, (Cloud("plate", "plate", smooth=False), )),
    ("noise", NOISE, tuple(_noisy(n) for n in ("bunny", "horse", "igea", "armadillo", "fertility"))),
    ("flips", FLIPS, tuple(Cloud(f"{n}, 20 % flipped", n, flipped=0.2) for n in ("bunny", "horse", "spot",
                                                                               "fertility"))),
    ("patch", PATCH, tuple(Cloud(f"{n}, a 12 % patch flipped", n, patch=0.12, draws=3) for n in ("bunny", "igea",
                                                                                               "3holes"))),
    ("density", UNEVEN, tuple(Cloud(f"{n}, 1:30", n, uneven=30.0) for n in ("bunny", "horse", "igea", "spot",
                                                                           "rocker-arm"))),
)  # fmt: skip
"""Kinds of clouds, the percentages to keep to, and the clouds."""


@dataclass(frozen=True)
class Score:
    """Percent of wrong answers at some places of a cloud: ours, and by octrees of depth 5."""

    kind: str
    cloud: str
    places: str
    tuned: bool
    aim: float | None
    judge: str
    wrong: float
    per_level: float
    flood: float


def run(quick: bool) -> list[Score]:
    """Classify the places of all clouds; quick ones in the first cloud of each kind alone."""
    found = []
    for kind, aims, clouds in KINDS:
        for cloud in clouds[:1] if quick else clouds:
            try:
                found += list(scores(kind, aims, cloud, 5000 if quick else PLACES, 1 if quick else cloud.draws))
            except NoDataError as error:
                print(error)
    return found


def scores(kind: str, aims: dict[str, float], cloud: Cloud, count: int, draws: int) -> Iterator[Score]:
    """Yield the mean score of several draws of a cloud for each kind of places."""
    drawn = [list(cases_of(cloud, count, draw)) for draw in range(draws)]
    ours = [Classifier(cases[0].operand) for cases in drawn]
    level, flood = (
        [OctreeClassifier(cases[0].operand, DEPTH, how) for cases in drawn] for how in ("per-level", "flood-faces")
    )
    for n, places in enumerate(cloud.places):
        cases = [draw[n] for draw in drawn]
        wrong = np.mean(
            [_wrong(case, one.classify(case.queries).inside) for case, one in zip(cases, ours, strict=True)]
        )
        by_level, by_flood = (
            float(np.mean([_wrong(case, one.classify(case.queries)) for case, one in zip(cases, tree, strict=True)]))
            for tree in (level, flood)
        )
        yield Score(
            kind, cloud.name, places, cloud.solid in TUNED, aims.get(places), ours[0].decision.judge, float(wrong),
            by_level, by_flood,
        )  # fmt: skip


def _wrong(case: Case, inside: np.ndarray) -> float:
    return 100.0 * float(np.mean(inside != case.inside))


def report(found: list[Score], quick: bool) -> str:
    """Return the tables as Markdown; the times are taken here."""
    head = ["cloud, places", "wrong, %", "aim", "judge", f"octree {DEPTH}, per level", f"octree {DEPTH}, flood"]
    return "\n".join(
        [
            "# Space: the coloured grid and the octrees\n",
            __doc__ or "",
            "*All*: 50,000 surfels of a turned and shifted bunny; *near*: 25,000 places within 2 spacings of the "
            "surface; *edge*: at sharp edges, 0.7 spacings off. 62,000 random surfels each, and the default judge.\n",
            "## Solids that nothing was tuned on\n",
            table(head, [_row(one) for one in found if not one.tuned]),
            table(["kind, places", "mean of these, %", "aim"], _means([one for one in found if not one.tuned])),
            "## Solids that were tuned on\n",
            table(head, [_row(one) for one in found if one.tuned]),
            builds(quick),
            motions(quick),
            octrees(DEPTHS[:1] if quick else DEPTHS, quick),
            f"{made_on()} {busy()}\n",
        ]
    )


def _row(one: Score) -> list[str]:
    aim = "" if one.aim is None else f"<= {one.aim:g}"
    return [
        f"{one.cloud}, {one.places}", f"{one.wrong:.3f}", aim, one.judge, f"{one.per_level:.2f}", f"{one.flood:.2f}",
    ]  # fmt: skip


def _means(found: list[Score]) -> Iterator[list[str]]:
    for kind, aims, _ in KINDS:
        for places, aim in aims.items():
            wrong = [one.wrong for one in found if one.kind == kind and one.places == places]
            if wrong:
                yield [f"{kind}, {places}", f"{np.mean(wrong):.3f}", f"<= {aim:g}"]
