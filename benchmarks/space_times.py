"""What building, colouring and asking cost: the grid, and octrees of several depths as published."""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import NamedTuple

import numpy as np

from benchmarks.clouds import generator
from benchmarks.judge_cases import Solid, known_solid
from benchmarks.shapes import NoDataError
from benchmarks.tables import table
from surfel.core.affine import rotation, translation
from surfel.core.cast import Floats
from surfel.inside.both_ways import both_ways
from surfel.inside.classify import Classifier
from surfel.inside.decision import SHEETS
from surfel.inside.octree import build_octree
from surfel.inside.octree_classify import COLOURINGS, OctreeClassifier, two_plane_slabs
from surfel.inside.octree_colour import colour_by_flood, colour_per_level
from surfel.inside.operand import Operand

SIZES = {40_000: (12.0, 112.0), 62_000: (18.0, 161.0), 134_000: (40.0, 202.0), 1_000_000: (350.0, None)}
"""Surfels, with the aim for build and colour in ms, and what Gaal gives for the flood fill."""

MOVES = {100_000: 4.0, 1_000_000: 15.0}
"""Surfels of each of two clouds, with the aim in ms for both directions after a move."""

DEPTHS = (4, 5, 6, 7)


class Cost(NamedTuple):
    """Milliseconds: the median on the clock, the best on the clock, and the least of the processor's time."""

    clock: float
    best: float
    work: float

    def __str__(self) -> str:
        return f"{self.clock:.1f} / {self.best:.1f} / {self.work:.1f}"


class OctreeCost(NamedTuple):
    """What an octree costs in all its parts, in ms, what it gets wrong, and what node against node settles."""

    build: Cost
    colour: Cost
    slabs: Cost
    query: Cost
    nodes: Cost
    wrong: float
    whole: float


def cost(work: Callable[[], object], repeats: int = 7) -> Cost:
    """Return what a call costs, after one that does not count."""
    work()
    clock, spent = [], []
    for _ in range(repeats):
        start, worked = time.perf_counter(), time.process_time()
        work()
        clock.append(1e3 * (time.perf_counter() - start))
        spent.append(1e3 * (time.process_time() - worked))
    return Cost(median(clock), min(clock), min(spent))


def scan(n: int, seed: int = 0) -> tuple[Floats, Floats]:
    """Return n surfels of the bunny, or of a box where there is none."""
    return _solid().draw(n, generator("spaces", n, seed), smooth=True)


def _solid() -> Solid:
    try:
        return known_solid("bunny")
    except NoDataError:
        return known_solid("box")


def turned(step: int = 1) -> Floats:
    """Return a pose of the moving cloud, (4, 4)."""
    return translation([0.15, 0.05, 0.1]) @ rotation([1.0, 0.4, 0.2], 23.0 * step)


def ready(n: int, seed: int = 0) -> Operand:
    """Return an operand that knows its areas, as those of a measured cloud do."""
    operand = Operand.of(*scan(n, seed))
    assert len(operand.areas) == n
    return operand


def grid_cost(operand: Operand, repeats: int = 7) -> Cost:
    """Return what it costs to build and colour the grid of an operand that is sorted and knows its spacings."""
    return cost(lambda: Classifier(operand, SHEETS), repeats)


class MovingCost(NamedTuple):
    """What both directions after a move cost: by two calls, one after the other, and by one call for both."""

    apart: Cost
    together: Cost


def moving_cost(one: Operand, other: Operand, repeats: int = 15) -> MovingCost:
    """Return what it costs to classify both clouds, one by the other, after a move; poses differ from call to call."""
    first, second = Classifier(one), Classifier(other)
    poses = [turned(step) for step in range(1, 5)]

    def two_calls(pose: Floats) -> None:
        first.classify(second.operand, pose=pose)
        second.classify(first.operand, pose=np.linalg.inv(pose))

    def moved(work: Callable[[Floats], object]) -> Cost:
        step = iter(range(10**9))
        return cost(lambda: work(poses[next(step) % len(poses)]), repeats)

    return MovingCost(moved(two_calls), moved(lambda pose: both_ways(first, second, pose)))


def octree_cost(operand: Operand, other: Operand, depth: int, colouring: str, repeats: int = 5) -> OctreeCost:
    """Return what a published octree costs and settles; ``other`` is classified by places and node against node."""
    tree = build_octree(operand, depth)
    if colouring == "per-level":
        colour = cost(lambda: colour_per_level(tree, operand), repeats)
    else:
        colour = cost(lambda: colour_by_flood(tree, operand, colouring == "flood-faces"), repeats)
    classifier = OctreeClassifier(operand, depth, colouring)
    theirs = build_octree(other, depth)
    pose = turned()
    places = (other.points + other.origin) @ pose[:3, :3].T + pose[:3, 3]
    nodes = classifier.classify_nodes(theirs, other, pose)
    truth = Classifier(operand).classify(places).inside
    return OctreeCost(
        cost(lambda: build_octree(operand, depth), repeats),
        colour,
        cost(lambda: two_plane_slabs(tree, operand), repeats),
        cost(lambda: classifier.classify(places), repeats),
        cost(lambda: classifier.classify_nodes(theirs, other, pose), repeats),
        100.0 * float(np.mean(classifier.classify(places) != truth)),
        100.0 * nodes.whole,
    )


def builds(quick: bool) -> str:
    """Return the times to build and colour, beside the aims, as Markdown."""
    from scipy.spatial import cKDTree

    rows = []
    for n, (aim, paper) in list(SIZES.items())[: 1 if quick else None]:
        points, normals = scan(n)
        operand = ready(n)
        cold = cost(lambda points=points, normals=normals: Operand.of(points, normals).areas, 5)  # type: ignore[misc]
        yard = cost(lambda points=points: cKDTree(points), 3)  # type: ignore[misc]
        rows.append([f"{n:,}", str(grid_cost(operand)), f"{aim:g}", "-" if paper is None else f"{paper:g}",
                     str(cold), str(yard)])  # fmt: skip
    head = ["surfels", "build + colour, ms", "aim", "paper", "sort, index, areas", "SciPy's tree alone"]
    return (
        "## Build and colour\n\nMilliseconds: median / best on the clock / least processor time. Before it, points are "
        "sorted and indexed once, and their areas found, unless the cloud knows them.\n\n" + table(head, rows)
    )


def motions(quick: bool) -> str:
    """Return the times after a move, beside the aims, as Markdown."""
    rows = []
    for n, aim in list(MOVES.items())[: 1 if quick else None]:
        one, other = ready(n), ready(n, 1)
        found = moving_cost(one, other)
        rows.append([f"{n:,}", str(found.apart), str(found.together), f"{aim:g}"])
    head = ["surfels each", "two calls, ms", "both ways in one call, ms", "aim"]
    return "## After a move\n\nTwo bunnies, the second turned and shifted anew each time.\n\n" + table(head, rows)


def octrees(depths: tuple[int, ...], quick: bool) -> str:
    """Return what the published octrees cost and get wrong, as Markdown."""
    n = 5000 if quick else 62_000
    one, other = ready(n), ready(n, 1)
    rows = []
    for depth in depths:
        for how in COLOURINGS:
            found = octree_cost(one, other, depth, how, 3)
            parts = [f"{part.work:.1f}" for part in found[:5]]
            rows.append([f"{depth}, {how}", *parts, f"{found.whole:.0f}", f"{found.wrong:.2f}"])
    head = ["depth, colouring", "build", "colour", "slabs", "query", "node tests", "settled whole, %", "differ, %"]
    return (
        f"## Octrees as published\n\nTwo bunnies of {n:,} surfels; processor milliseconds. *Differ*: places where the "
        "octree (with unguarded slabs) says otherwise than the grid.\n\n" + table(head, rows)
    )
