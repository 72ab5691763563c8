"""The runs behind the tables of Liu et al. (2006): areas, spreads, times, and the readings of the text."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from benchmarks.liu2006_sets import PointSet, cylinder, scan, sphere
from benchmarks.pieces import Floats
from benchmarks.shapes import read_mesh
from surfel.lines.enclosing import smallest_ball
from surfel.lines.models import line_block
from surfel.lines.sequences import shifts
from surfel.shapes.clusters import CELLS, HALVES, Reading
from surfel.shapes.lpsi import Lpsi

LINES = 5000
RUNS = 16
OURS = Reading()
_MANY = 65_536


@dataclass(frozen=True)
class Spread:
    """Relative errors: of the sequence as it stands, and mean and deviation of randomly shifted runs."""

    plain: float
    mean: float
    deviation: float

    @property
    def rms(self) -> float:
        return float(np.hypot(self.mean, self.deviation))


def error(
    known: PointSet,
    lines: int = LINES,
    shift: Floats | None = None,
    counter: Lpsi | None = None,
    model: str = "tangent",
) -> float:
    """Return the relative error of one run."""
    ready = counter or prepared(known)
    ball = smallest_ball(known.points).grown(ready.radius)
    total = 0.0
    for first in range(0, lines, _MANY):
        last = min(first + _MANY, lines)
        total += float(ready.counts(line_block("niederreiter", model, ball, first, last - first, lines, shift)).sum())
    return total * ball.surface / (2.0 * lines) / known.area - 1.0


def prepared(known: PointSet, **options: object) -> Lpsi:
    """Return the octree and radius of a set, with the paper's lambda unless another is given."""
    settings: dict[str, object] = {"radius_factor": known.factor} | options
    return Lpsi.of(known.points, known.normals, **settings)  # type: ignore[arg-type]


def spread(known: PointSet, lines: int = LINES, runs: int = RUNS, model: str = "tangent", **options: object) -> Spread:
    """Return the errors of one set under one reading."""
    counter = prepared(known, **options)
    found = [error(known, lines, row, counter, model) for row in shifts(0, runs)]
    return Spread(error(known, lines, None, counter, model), float(np.mean(found)), float(np.std(found)))


def by_readings(sets: Iterable[PointSet], runs: int) -> dict[tuple[Reading, str], Spread]:
    """Return the errors of every set under every reading of section 3."""
    readings = [Reading(*both) for both in product(CELLS, HALVES)]
    return {(r, known.name): spread(known, runs=runs, reading=r) for known in sets for r in readings}


def search_for_the_bunny(runs: int) -> list[tuple[str, Spread]]:
    """Return the bunny's error under what the text could mean beyond the readings of section 3."""
    used, every = scan("bunny"), with_unused_vertices()
    half = float(prepared(used).gap) * 0.5
    radii = np.full(len(used.points), half)
    tries: list[tuple[str, PointSet, dict[str, object]]] = [
        ("as here: used vertices, lambda 3, depth 4", used, {}),
        ("all vertices of the file; those without a triangle with the normal (0, 0, 1)", every, {}),
        ("lambda 1.5, as for the other sets", used, {"radius_factor": 1.5}),
        ("lambda 1", used, {"radius_factor": 1.0}),
        ("mean radius: half the distance to the nearest neighbour, lambda 3", used, {"halved": True}),
        ("octree of depth 5", used, {"depth": 5}),
        ("octree of depth 6", used, {"depth": 6}),
        ("uneven cylinder", used, {"cylinder": "uneven"}),
        ("cells of the cylinder", used, {"reading": Reading("cylinder", OURS.halves)}),
        ("case 4 always counts two", used, {"reading": Reading(OURS.cells, "two")}),
        ("chord model", used, {"model": "chord"}),
    ]
    found = []
    for name, known, options in tries:
        given = dict(options)
        model = str(given.pop("model", "tangent"))
        if given.pop("halved", False):
            given["radii"] = radii
        found.append((name, spread(known, runs=runs, model=model, **given)))
    return found


def with_unused_vertices() -> PointSet:
    """Return the bunny with the 1,113 vertices that no triangle uses; the normals of these are made up."""
    used, mesh = scan("bunny"), read_mesh("bunny")
    rest = np.setdiff1d(np.arange(len(mesh.vertices)), np.unique(mesh.triangles))
    points = np.concatenate([used.points, mesh.vertices[rest]])
    return replace(
        used, points=points, normals=np.concatenate([used.normals, np.tile([0.0, 0.0, 1.0], (len(rest), 1))])
    )


def noise_readings(runs: int) -> list[tuple[str, dict[str, Spread]]]:
    """Return the errors with noise of a "variance of 0.001 %", by what the percents may be of."""
    found = []
    for name, sigma in (
        ("none", lambda known: 0.0),
        ("deviation 0.001 % of a unit", lambda known: 1e-5),
        ("variance 0.001 % of the squared radius of the enclosing ball", _of_radius),
        ("variance 0.001 % of a squared unit", lambda known: 1e-5**0.5),
    ):
        sets = [known.noisy(sigma(known)) for known in (cylinder(), sphere())]
        found.append((name, {known.name: spread(known, runs=runs) for known in sets}))
    return found


def _of_radius(known: PointSet) -> float:
    return 1e-5**0.5 * float(smallest_ball(known.points).radius)


def curve(known: PointSet, numbers: Iterable[int], runs: int) -> tuple[Floats, Floats, Floats]:
    """Return numbers of lines, errors of the plain sequence, and RMS errors of shifted ones up to 65,536 lines."""
    counter = prepared(known)
    rows = shifts(0, max(runs, 1))[:runs]
    plain, rms = [], []
    chosen = np.array(list(numbers))
    for number in chosen:
        plain.append(abs(error(known, int(number), None, counter)))
        several = [error(known, int(number), row, counter) for row in (rows if number <= _MANY else ())]
        rms.append(float(np.sqrt(np.mean(np.square(several)))) if several else np.nan)
    return chosen, np.array(plain), np.array(rms)


def thinned_curve(make: Callable[[float], PointSet], spacings: Iterable[float]) -> list[tuple[float, int, Spread]]:
    """Return sampling radius, number of points and errors of a set laid with several spacings (Fig. 9)."""
    found = []
    for spacing in spacings:
        known = make(spacing)
        found.append((spacing / np.sqrt(2.0), len(known.points), spread(known, runs=8)))
    return found


def mixed_signs(known: PointSet) -> PointSet:
    """Return the set with random signs on its normals."""
    signs = np.where(np.random.default_rng(0).random((len(known.points), 1)) < 0.5, -1.0, 1.0)
    return replace(known, normals=known.normals * signs)
