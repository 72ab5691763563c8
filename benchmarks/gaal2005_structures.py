"""Table 2 of Gaal: grid, kd-tree and octree, with its orders of growth measured, moving scenes included."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.space_times import cost, ready, turned
from benchmarks.tables import table
from surfel.core.cast import Floats
from surfel.inside.classify import Classifier
from surfel.inside.octree_classify import OctreeClassifier
from surfel.inside.operand import Operand

SIZES = (10_000, 40_000, 160_000)
DEPTH = 5
QUERIES = 4_000
EDITED = 0.01
"""Share of the surfels that move by themselves, in one place."""


def structures(quick: bool) -> str:
    """Return the table as Markdown."""
    sizes = SIZES[:2] if quick else SIZES
    found: dict[str, dict[str, list[float | None]]] = {}
    for n in sizes:
        for what, by_name in _costs(ready(n), ready(n, 1)).items():
            for name, value in by_name.items():
                found.setdefault(what, {}).setdefault(name, []).append(value)
    rows = [
        [what, *(_cell(by_name[name], sizes) for name in ("grid", "kd-tree", "octree"))]
        for what, by_name in found.items()
    ]
    head = [f"ms for {', '.join(f'{n // 1000}k' for n in sizes)} (order)", "grid", "kd-tree", "octree"]
    return f"""## Table 2: grid, kd-tree, octree

Paper: building O(n), O(n log n), O(n log n); finding O(n/m), O(log n), O(log n); k nearest O(k), O(n log n),
O(n log n); inside or outside: all three; moving scenes: yes, by restructuring, by restructuring.

Measured on bunnies. The grid is ours, coloured, with cells of about 2.2 spacings; the kd-tree is SciPy's; the octree is
the published one, depth {DEPTH}, per level. In brackets the power of n that the times grow with. Queries:
{QUERIES:,} random surfels of a second, turned bunny. *Found*: the nearest surfel, for the grid by our index. *Moved*:
both clouds by each other after a rigid motion, for which nothing is built anew. *Edited*: {EDITED:.0%} of the surfels
shifted by themselves, and the structure brought up to date. The kd-tree has nothing to answer whole nodes with, and no
colours: its inside is the sign at the nearest surfel.

{table(head, rows)}
What the table of the paper does not say: outside of border cells a search for neighbours in a grid may have no end near
by, so the grid is asked for colours alone, and an index for neighbours; an octree whose leaves are finer than 1.5
spacings leaks (`python -m benchmarks spaces`).
"""


def _costs(one: Operand, other: Operand) -> dict[str, dict[str, float | None]]:
    from scipy.spatial import cKDTree

    pose = turned()
    back = np.linalg.inv(pose)
    world = one.points + one.origin
    moved = (other.points + other.origin) @ pose[:3, :3].T + pose[:3, 3]
    places = np.ascontiguousarray(moved[:: max(1, len(moved) // QUERIES)])
    grid, tree, octree = Classifier(one), cKDTree(world), OctreeClassifier(one, DEPTH)
    grid_2, octree_2 = Classifier(other), OctreeClassifier(other, DEPTH)
    rows = np.argsort(((world - world[0]) ** 2).sum(axis=1))[: max(1, int(EDITED * len(one)))]
    shifted, upright = world[rows] + 0.2 * one.spacing * one.normals[rows], one.normals[rows]

    def edited() -> Floats:
        changed = world.copy()
        changed[rows] = shifted
        return changed

    def sign(at: Floats, points: Floats, normals: Floats, kd: Any) -> Floats:
        nearest = kd.query(at)[1]
        return np.einsum("ij,ij->i", at - points[nearest], normals[nearest])

    def both_by_tree() -> None:
        sign(moved, world, one.normals, tree)
        sign(world @ back[:3, :3].T + back[:3, 3], other.points + other.origin, other.normals, tree_2)

    def both_by_octrees() -> None:
        octree.classify_nodes(octree_2.tree, other, pose)
        octree_2.classify_nodes(octree.tree, one, back)

    def both_by_grids() -> None:
        grid.classify(other, pose=pose)
        grid_2.classify(one, pose=back)

    tree_2 = cKDTree(other.points + other.origin)
    given = one.order[rows]
    return {
        "building": _of(lambda: Classifier(one), lambda: cKDTree(world), lambda: OctreeClassifier(one, DEPTH)),
        "found": _of(lambda: one.index.knn_of(places, 1), lambda: tree.query(places), None),
        "10 nearest": _of(lambda: one.index.knn_of(places, 10), lambda: tree.query(places, k=10), None),
        "inside or outside": _of(
            lambda: grid.classify(places),
            lambda: sign(places, world, one.normals, tree),
            lambda: octree.classify(places),
        ),
        "moved, both by each other": _of(both_by_grids, both_by_tree, both_by_octrees),
        "edited": _of(
            lambda: grid.edited(given, shifted, upright),
            lambda: cKDTree(edited()),
            lambda: OctreeClassifier(Operand.of(edited(), one.normals), DEPTH),
        ),
    }


def _of(
    grid: Callable[[], object], tree: Callable[[], object], octree: Callable[[], object] | None
) -> dict[str, float | None]:
    return {
        "grid": cost(grid, 3).work,
        "kd-tree": cost(tree, 3).work,
        "octree": None if octree is None else cost(octree, 3).work,
    }


def _cell(values: list[float | None], sizes: tuple[int, ...]) -> str:
    """Return the times and the power of n that they grow with."""
    known = [value for value in values if value is not None]
    if len(known) < len(sizes):
        return "-"
    power = float(np.polyfit(np.log(sizes), np.log(np.maximum(known, 1e-6)), 1)[0])
    return ", ".join(f"{value:.3g}" for value in known) + f" ({power:.2f})"
