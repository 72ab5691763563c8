"""The rows of the accuracy table: which clouds of which shapes, with and without normals, and what is to be reached."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from benchmarks.clouds import Cloud, blue_cloud, noisy_cloud, random_cloud, uneven_cloud, vertex_cloud
from benchmarks.shapes import ANALYTIC, HARD, JUDGING, MESHES, OPEN, SCANNED, SHARP, TUNING
from benchmarks.structured import CLEAN, clean

Target = tuple[float, float]
"""Median and worst |error| in percent; infinite where nothing was set."""

FREE = math.inf
SMOOTH = tuple(name for name in JUDGING if name not in SHARP)


@dataclass(frozen=True)
class Row:
    """One kind of cloud.

    Parameters
    ----------
    name : str
        As in the table and for ``--only``.
    shapes : tuple of str
        What it is made of; ``swap`` says whether ``--set tuning`` and ``--set hard`` put other shapes in their place.
    make : callable
        ``make(shape, seed)`` gives a :class:`Cloud`.
    given, none : Target or None
        What is to be reached with and without normals; None where the row is not run so.
    seeds : int
        How many clouds of each shape.
    swap : bool
        See ``shapes``.
    solid : bool
        Whether the row is about volume and centroid; its targets are then of the volume.
    drawn : bool
        Whether another seed gives another cloud.
    """

    name: str
    shapes: tuple[str, ...]
    make: Callable[[str, int], Cloud]
    given: Target | None = (FREE, FREE)
    none: Target | None = (FREE, FREE)
    seeds: int = 1
    swap: bool = True
    solid: bool = False
    drawn: bool = True

    def target(self, normals: str) -> Target | None:
        """Return what is to be reached with normals "given" or "none"."""
        return self.given if normals == "given" else self.none


ROWS = (
    Row("random 5k", JUDGING, lambda name, seed: random_cloud(name, 5_000, seed)),
    Row("random 20k", JUDGING, lambda name, seed: random_cloud(name, 20_000, seed), (0.1, 0.9), (0.15, 1.3)),
    Row("random 100k", JUDGING, lambda name, seed: random_cloud(name, 100_000, seed), (0.05, 0.2), (0.1, 0.5)),
    Row("blue noise 5k", JUDGING, lambda name, seed: blue_cloud(name, 5_000, seed)),
    Row("blue noise 20k", JUDGING, lambda name, seed: blue_cloud(name, 20_000, seed)),
    Row("uneven 16x 20k", JUDGING, lambda name, seed: uneven_cloud(name, 20_000, seed)),
    Row("clean sets", tuple(CLEAN), lambda name, _: clean(name), (0.02, 0.02), (0.1, 0.1), swap=False, drawn=False),
    Row(
        "open shapes", OPEN, lambda name, seed: random_cloud(name, 20_000, seed), (0.1, 0.1), (0.1, 0.1), seeds=3,
        swap=False,
    ),
    Row(
        "bunny vertices", ("bunny",), lambda name, _: vertex_cloud(name), (0.5, 0.5), (0.5, 0.5), swap=False,
        drawn=False,
    ),
    Row("scan vertices", SCANNED, lambda name, _: vertex_cloud(name), swap=False, drawn=False),
    Row("noise 0.1 h", SMOOTH, lambda name, seed: noisy_cloud(name, 20_000, seed, spacings=0.1), None, (0.3, FREE)),
    Row("noise 0.2 %", SMOOTH, lambda name, seed: noisy_cloud(name, 20_000, seed, diagonal=0.002), None, (0.5, FREE)),
    Row("noise 0.5 h", SMOOTH, lambda name, seed: noisy_cloud(name, 20_000, seed, spacings=0.5), None),
    Row("noise 1 %", SMOOTH, lambda name, seed: noisy_cloud(name, 20_000, seed, diagonal=0.01), None),
    Row(
        "noise 0.1 h sharp", ("fandisk", "112932"),
        lambda name, seed: noisy_cloud(name, 20_000, seed, spacings=0.1), None, swap=False,
    ),
    Row("two sheets", ("two sheets",), lambda name, seed: random_cloud(name, 20_000, seed), seeds=3, swap=False),
    Row(
        "solids: clean sets", tuple(CLEAN), lambda name, _: clean(name), (FREE, 0.05), (FREE, 0.05), swap=False,
        drawn=False, solid=True,
    ),
    Row(
        "solids: random 100k", JUDGING, lambda name, seed: random_cloud(name, 100_000, seed), (FREE, 0.05),
        (FREE, 0.05), solid=True,
    ),
)  # fmt: skip

CENTROID_TARGET = 5e-4
"""Of half the diagonal of the box, for the rows about solids."""

SETS = {"judging": JUDGING, "tuning": TUNING, "hard": HARD}


@dataclass(frozen=True)
class Case:
    """One cloud to be made and measured; made where it is measured, so that it travels as four words."""

    row: str
    shape: str
    normals: str
    seed: int

    def cloud(self) -> Cloud:
        found = row_of(self.row).make(self.shape, self.seed)
        return found if self.normals == "given" else found.bare()


def row_of(name: str) -> Row:
    return next(row for row in ROWS if row.name == name)


def cases(
    only: str = "", shape: str = "", normals: str = "both", which: str = "judging", seeds: int | None = None
) -> Iterator[Case]:
    """Yield the cases that filters leave.

    Parameters
    ----------
    only, shape : str
        Names or parts of names, several separated by commas; empty for all.
    normals : {"both", "given", "none"}
        With, without, or each in turn.
    which : {"judging", "tuning", "hard"}
        The shapes of rows that are not about special ones.
    seeds : int, optional
        Clouds of each shape, instead of the row's own number, where they are random.
    """
    for row in ROWS:
        if not _chosen(row.name, only, ROW_NAMES):
            continue
        for name in _shapes_of(row, which):
            if not _chosen(name, shape, SHAPE_NAMES):
                continue
            for kind in ("given", "none"):
                if normals in ("both", kind) and row.target(kind) is not None:
                    for seed in range(row.seeds if seeds is None or not row.drawn else seeds):
                        yield Case(row.name, name, kind, seed)


def _shapes_of(row: Row, which: str) -> tuple[str, ...]:
    if not row.swap:
        return row.shapes
    return tuple(name for name in SETS[which] if row.shapes != SMOOTH or name not in SHARP)


def _chosen(name: str, wanted: str, names: frozenset[str]) -> bool:
    """Tell whether a name is asked for: a full name means itself, anything else every name that holds it."""
    parts = [part.strip() for part in wanted.split(",") if part.strip()]
    return not parts or any(part == name or (part in name and part not in names) for part in parts)


ROW_NAMES = frozenset(row.name for row in ROWS)
SHAPE_NAMES = frozenset(ANALYTIC) | frozenset(MESHES)
