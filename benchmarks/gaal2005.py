"""Gaal, *Boolean Operations on Point-Sampled Geometry*: its tables and frame rates, run again.

Times are milliseconds of processor time, the least of some runs, because other work may share the machine; figures of
the paper are of its own machine, which it does not name.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

import numpy as np

import surfel
from benchmarks.gaal2005_structures import structures
from benchmarks.space_times import Cost, cost, ready, scan, turned
from benchmarks.tables import busy, made_on, percent, table
from surfel.inside.classify import Classifier
from surfel.inside.judges import named
from surfel.inside.octree import build_octree
from surfel.inside.octree_classify import OctreeClassifier
from surfel.inside.octree_colour import colour_by_flood, colour_per_level
from surfel.inside.operand import Operand

PAPER = {40_000: (128, 112), 62_000: (187, 161), 134_000: (243, 202)}
"""Table 3: milliseconds to build and colour per level and by flood fill."""

FRAMES = {3_000: 9.0, 100_000: 4.0}
"""Frames a second that the paper reached, drawing included."""

BRUTE = 4.0
"""How many times slower brute force was with 3,000 surfels."""

DEPTHS = (4, 5, 6, 7)


def run(out: str, quick: bool = False) -> str:
    """Run all parts and return them as Markdown."""
    parts = [table_1(quick), structures(quick), table_3(quick), frames(quick), drawn(quick), depths(quick)]
    return "\n".join(["# Gaal (2005), again\n", f"{made_on()} {busy()}\n", __doc__ or "", *parts])


def table_1(quick: bool) -> str:
    """Combine two balls by each row of Table 1 and compare with closed forms."""
    n = 5_000 if quick else 40_000
    rng = np.random.default_rng(0)

    def ball(x: float) -> surfel.Surfels:
        normals = rng.standard_normal((n, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return surfel.Surfels(normals + [x, 0.0, 0.0], normals=normals)

    one, two = ball(0.0), ball(1.0)
    lens, whole = 5.0 * np.pi / 12.0, 4.0 * np.pi / 3.0
    cases: list[tuple[str, Callable[[], surfel.Combination], float, float]] = [
        ("S1 or S2", lambda: surfel.combine(one | two), 6.0 * np.pi, 2.0 * whole - lens),
        ("S1 and S2", lambda: surfel.combine(one & two), 2.0 * np.pi, lens),
        ("S1 less S2", lambda: surfel.combine(one - two), 4.0 * np.pi, whole - lens),
        ("S2 less S1", lambda: surfel.combine(two - one), 4.0 * np.pi, whole - lens),
    ]
    rows = []
    for name, make, area, volume in cases:
        result = make()
        measured = surfel.measure(result.surfels)
        told = measured.volume
        assert told is not None
        rows.append(
            [name, f"{result.kept[0]:,} + {result.kept[1]:,}", f"{result.cut:,}",
             percent(abs(float(measured.area) / area - 1.0)), percent(abs(float(told) / volume - 1.0))]
        )  # fmt: skip
    head = ["row", "kept of each", "cut", "area off, %", "volume off, %"]
    return (
        f"## Table 1: the operations\n\nTwo unit balls of {n:,} random surfels, their centres 1 apart, against closed "
        "forms. The paper prints the third row twice; the fourth is the other difference, and the kept part of what is "
        "taken away turns its normals. The rows themselves are tests: `tests/booleans/test_gaal_table1.py`.\n\n"
        + table(head, rows)
    )


def table_3(quick: bool) -> str:
    """Build and colour octrees of depth 4 and 5, and the grid, for as many surfels as the paper."""
    rows = []
    for n, (level, flood) in list(PAPER.items())[: 1 if quick else None]:
        operand = ready(n)
        for depth in (4, 5):
            build = cost(lambda operand=operand, depth=depth: build_octree(operand, depth), 5).work  # type: ignore[misc]
            tree = build_octree(operand, depth)
            one = build + cost(lambda tree=tree, operand=operand: colour_per_level(tree, operand), 5).work  # type: ignore[misc]
            two = build + cost(lambda tree=tree, operand=operand: colour_by_flood(tree, operand), 5).work  # type: ignore[misc]
            grid = cost(lambda operand=operand: Classifier(operand, "sheets"), 3).work  # type: ignore[misc]
            rows.append(
                [f"{n:,}", str(depth), f"{one:.1f} ({level})", f"{two:.1f} ({flood})",
                 f"{100.0 * (one / two - 1.0):.0f} % ({100.0 * (level / flood - 1.0):.0f} %)", f"{grid:.1f}"]
            )  # fmt: skip
    head = ["surfels", "depth", "per level, ms (paper)", "flood fill, ms (paper)", "gain (paper)", "our grid, ms"]
    return (
        "## Table 3: building and colouring\n\nThe bunny. The gain is counted as the paper does: what per level takes "
        "over what the flood fill takes, less one. The paper does not say how deep its trees were; points are sorted "
        "beforehand, for all three.\nBoth colourings look for the nearest surfel among those of the neighbouring leaf "
        "alone, so it costs little, and most of the gain goes with it.\nThe grid's time includes the votes, the repair "
        "of leaks and guarded slabs.\n\n" + table(head, rows)
    )


def frames(quick: bool) -> str:
    """Classify both clouds by each other after a move, by octrees, the grid, and brute force."""
    rows = []
    for n, paper in list(FRAMES.items())[: 1 if quick else None]:
        one, two = ready(n), ready(n, 1)
        depth = 4 if n < 100_000 else 5
        octree = _both_by_octrees(one, two, depth)
        grid = _both_by_grids(one, two)
        brute = _both_by_brute_force(one, two)
        rows.append(
            [f"{n:,}", f"{octree:.2f}", f"{1e3 / octree:,.0f}", f"{grid:.2f}", f"{1e3 / grid:,.0f}", f"{paper:g}",
             f"{brute:,.0f}", f"{brute / octree:,.0f}" + (f" ({BRUTE:g})" if n == 3_000 else ""),
             f"{brute / grid:,.0f}"]
        )  # fmt: skip
    head = ["surfels each", "octrees, ms", "a second", "our grid, ms", "a second", "paper, a second", "brute force, ms",
            "over octrees (paper)", "over the grid"]  # fmt: skip
    return (
        "## Frame rates\n\nTwo bunnies, one moved anew for each frame: which surfels of either lie in the other. The "
        "paper's frames hold drawing, too; ours are of classification alone, on one or two threads, counted in "
        "processor time. To reach the paper's rate takes no more than 1000 / rate ms.\n\n" + table(head, rows)
    )


def drawn(quick: bool) -> str:
    """Draw the union of both clouds after a move: classification, drawing, and shading in one frame."""
    rows = []
    for n, paper in list(FRAMES.items())[: 1 if quick else None]:
        one, two = (surfel.Surfels(points, normals=normals) for points, normals in (scan(n), scan(n, 1)))
        quads, blend = (_frame(one, two, method) for method in ("quads", "blend"))
        rows.append(
            [f"{n:,}", str(quads), f"{1e3 / quads.clock:,.1f}", str(blend), f"{1e3 / blend.clock:,.1f}", f"{paper:g}"]
        )
    head = ["surfels each", "as published, ms", "a second", "default, ms", "a second", "paper, a second"]
    return (
        "## Frame rates, drawing included\n\nThe union of two bunnies, 640 x 480, one moved anew for each frame by "
        "`transformed`, which hands on its disks, its colours and its index: the paper's quads in two passes, and the "
        "default, which decides the cut once a pixel. Median and best on the clock, and least processor time.\n\n"
        + table(head, rows)
    )


def _frame(one: surfel.Surfels, two: surfel.Surfels, method: str) -> Cost:
    camera = surfel.Camera.fitted((one | two).bounds, (640, 480))
    steps = count()

    def frame() -> None:
        surfel.render(one | two.transformed(turned(next(steps))), camera, (640, 480), method=method)

    return cost(frame, 5)


def _both_by_octrees(one: Operand, two: Operand, depth: int) -> float:
    first, second = (OctreeClassifier(each, depth, "flood") for each in (one, two))
    trees = [build_octree(each, depth) for each in (one, two)]
    pose = turned()
    back = np.linalg.inv(pose)

    def frame() -> None:
        first.classify_nodes(trees[1], two, pose)
        second.classify_nodes(trees[0], one, back)

    return cost(frame, 5).work


def _both_by_grids(one: Operand, two: Operand) -> float:
    first, second = Classifier(one), Classifier(two)
    pose = turned()
    back = np.linalg.inv(pose)

    def frame() -> None:
        first.classify(two, pose=pose)
        second.classify(one, pose=back)

    return cost(frame, 9).work


def _both_by_brute_force(one: Operand, two: Operand) -> float:
    """Return what brute force takes, from a share of the places where there are many."""
    brute = named("brute")
    share = max(1, len(one) // 2_000)
    pose = turned()
    places = (two.points[::share] + two.origin) @ pose[:3, :3].T + pose[:3, 3]
    return 2.0 * share * cost(lambda: brute(one, places), 3).work


def depths(quick: bool) -> str:
    """Return what a frame and a rebuild take at each depth."""
    rows = []
    for n in (3_000, 40_000, 134_000)[: 1 if quick else None]:
        one, two = ready(n), ready(n, 1)
        found = [_both_by_octrees(one, two, depth) for depth in DEPTHS]
        best = DEPTHS[int(np.argmin(found))]
        rows.append([f"{n:,}", *(f"{value:.2f}" for value in found), str(best)])
    head = ["surfels each", *(f"depth {depth}, ms" for depth in DEPTHS), "fastest"]
    return (
        "## Depth 4 to 7\n\nA frame of classification by octrees. The paper finds 4 the fastest, and 5 worth a thought "
        "above 100,000 surfels; with the nearest surfel of a border leaf looked up by an index, deeper trees cost less "
        "than its brute-force search made them.\n\n" + table(head, rows)
    )
