"""Peers on exact solids: the same trees through manifold3d (facets) and scikit-image (marching cubes), in one run."""

from __future__ import annotations

import math
import operator
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from itertools import chain
from typing import Any

import numpy as np

import surfel
from benchmarks.li2003_solids import GATE, SKELETON, Known, L, depth_of_l
from benchmarks.tables import busy, made_on, percent, seconds, table
from surfel.measuring.baselines import marching_cubes, subdivision
from surfel.measuring.by_patches import measure_by_patches
from surfel.shapes.base import Shape
from surfel.shapes.placed import Placed
from surfel.shapes.tree import Tree, postorder

SEEDS = 16
GOAL = 1e-3
_ENOUGH = 1e-4  # finer facets than these need not be timed


@dataclass(frozen=True)
class Case:
    """A solid with its area and its volume."""

    name: str
    make: Callable[[], Shape]
    area: float
    volume: float

    @classmethod
    def of(cls, known: Known, volume: float) -> Case:
        """Take over a solid of the paper."""
        return cls(known.name, known.make, known.area, volume)


@dataclass(frozen=True)
class Row:
    """What one method with one setting reached; NaN where it tells nothing."""

    method: str
    setting: str
    area: float
    volume: float
    seconds: float


def _cheese() -> Shape:
    places = [(4.0 * x, 4.0 * y, 4.0 * z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    return surfel.Box(12) - surfel.Union(*(surfel.Sphere(1).translated(place) for place in places))


def _crossing() -> Shape:
    return surfel.Cylinder(1, 4) & surfel.Cylinder(1, 4).rotated((1, 0, 0), 90.0)


def _skeleton_volume() -> float:
    cap = math.pi * 3.0**2 * (3.0 * 13.0 - 3.0) / 3.0
    return 8000.0 - (4.0 / 3.0 * math.pi * 13.0**3 - 6.0 * cap)


def _l_volume() -> float:
    return 4.0 * (23.0 + 20.0 - 4.0) * depth_of_l() - math.pi * 3.5**2 * 4.0 + math.pi * 3.0**2 * 8.0


def _gate_volume() -> float:
    wall = 5.0 * (20.0 * 16.0 - 8.0 * 6.0 - 0.5 * math.pi * 4.0**2)
    return wall + 2.0 * math.pi * 2.0**2 * (5.0 + 3.0 / 3.0)


CASES = (
    Case.of(SKELETON, _skeleton_volume()),
    Case.of(L, _l_volume()),
    Case.of(GATE, _gate_volume()),
    Case("two crossing cylinders", _crossing, 16.0, 16.0 / 3.0),
    Case("box less 27 balls", _cheese, 864.0 + 27.0 * 4.0 * math.pi, 1728.0 - 27.0 * 4.0 / 3.0 * math.pi),
)


def run(quick: bool = False) -> list[tuple[Case, list[Row]]]:
    """Ask every method about every solid, printing each answer."""
    repeats = 2 if quick else 7
    _warm()
    found = []
    for case in CASES[:1] if quick else CASES:
        shape = case.make()
        rows = []
        for row in chain(
            _ours(case, shape, repeats, quick), _facets(case, shape, repeats, quick), _cubes(case, shape, quick)
        ):
            print(
                f"{case.name:24s} {row.method:40s} {row.setting:16s} area {percent(row.area):>7s} %"
                f"  volume {percent(row.volume):>7s} %  {seconds(row.seconds)}",
                flush=True,
            )
            rows.append(row)
        found.append((case, rows))
    return found


def _warm() -> None:
    """Load every kernel before a clock runs."""
    small = surfel.Box(2) - surfel.Sphere(1.3)
    for method in ("patches", "lines"):
        surfel.measure(small, method=method)
    subdivision(small, 1)
    if find_spec("skimage") is not None:
        marching_cubes(small, 10)


def _ours(case: Case, shape: Shape, repeats: int, quick: bool) -> Iterator[Row]:
    tree: Any = shape
    box = np.asarray(shape.bounds)
    for points in (4096, 16_384, 65_536) if quick else (1024, 4096, 16_384, 65_536, 262_144):
        areas = [float(measure_by_patches(tree, box, points, seed).area.value) for seed in range(SEEDS)]
        spent = _median(partial(measure_by_patches, tree, box, points, 0), repeats)
        yield Row("surfel, patches, area alone", f"{points:,} points", _rms(areas, case.area), math.nan, spent)
    for method in ("patches", "lines"):
        told = [surfel.measure(shape, method=method, seed=seed) for seed in range(SEEDS)]
        areas, volumes = [float(m.area.value) for m in told], [float(m.volume.value) for m in told if m.volume]
        spent = _median(partial(surfel.measure, shape, method=method), repeats)
        name = f"surfel.measure, {method}, all with errors"
        yield Row(name, "65,536", _rms(areas, case.area), _rms(volumes, case.volume), spent)
    for effort in (10,) if quick else (5, 10, 20):
        reading = subdivision(shape, effort)
        error = abs(reading.area / case.area - 1.0)
        yield Row("subdivision (baseline)", f"1/{effort} rad", error, math.nan, reading.seconds)


def _facets(case: Case, shape: Shape, repeats: int, quick: bool) -> Iterator[Row]:
    if find_spec("manifold3d") is None:
        return
    for edges in (64, 128) if quick else (32, 64, 128, 256, 512):
        solid = as_manifold(shape, edges)
        area, volume = float(solid.surface_area()) / case.area - 1.0, float(solid.volume()) / case.volume - 1.0
        spent = _median(partial(_area_by_manifold, shape, edges), repeats)
        yield Row("manifold3d", f"{edges} edges", abs(area), abs(volume), spent)
        if edges >= 128 and max(abs(area), abs(volume)) < _ENOUGH:
            return


def _area_by_manifold(shape: Shape, edges: int) -> float:
    return float(as_manifold(shape, edges).surface_area())


def _cubes(case: Case, shape: Shape, quick: bool) -> Iterator[Row]:
    if find_spec("skimage") is None:
        return
    for side in (50, 100) if quick else (50, 100, 200):
        readings = [marching_cubes(shape, side) for _ in range(2)]
        error, spent = abs(readings[0].area / case.area - 1.0), min(reading.seconds for reading in readings)
        yield Row("scikit-image, marching cubes", f"{side}^3 cubes", error, math.nan, spent)


def as_manifold(shape: Shape, edges: int) -> Any:
    """Return a manifold3d solid of a tree of boxes, spheres, cylinders and cones, its circles cut into ``edges``."""
    import manifold3d

    made: dict[int, Any] = {}
    for node in postorder(shape):
        if isinstance(node, Tree):
            first, *others = (made[id(child)] for child in node.children)
            for other in others:
                first = _OPERATIONS[node.operation](first, other)
            made[id(node)] = first
            continue
        own: Any = node.shape if isinstance(node, Placed) else node
        solid = _facetted(manifold3d.Manifold, own, edges)
        made[id(node)] = solid.transform(node.matrix[:3]) if isinstance(node, Placed) else solid
    return made[id(shape)]


_OPERATIONS: dict[str, Callable[[Any, Any], Any]] = {
    "union": operator.add,
    "intersection": operator.xor,  # what manifold3d writes for it
    "difference": operator.sub,
}


def _facetted(manifold: Any, own: Any, edges: int) -> Any:
    name = type(own).__name__
    if name == "Box":
        return manifold.cube(np.broadcast_to(np.asarray(own.size, float), 3).tolist(), True)
    if name == "Sphere":
        return manifold.sphere(own.radius, edges)
    if name == "Cylinder":
        return manifold.cylinder(own.height, own.radius, own.radius, edges, True)
    if name == "Cone":
        return manifold.cylinder(own.height, own.bottom, own.top, edges, True)
    raise ValueError(f"no facets for a {name}")


def _rms(values: list[float], truth: float) -> float:
    return float(np.sqrt(np.mean((np.array(values) / truth - 1.0) ** 2))) if values else math.nan


def _median(work: Callable[[], object], repeats: int) -> float:
    spent = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        work()
        spent.append(time.perf_counter() - start)
    return statistics.median(spent[1:])


def report(found: list[tuple[Case, list[Row]]]) -> str:
    """Return the result as Markdown: how soon each method is within 0.1 % for good, then all rows of each solid."""
    methods = list(dict.fromkeys(row.method for _, rows in found for row in rows))
    summary = [[name, *(_soonest([r for r in rows if r.method == name]) for _, rows in found)] for name in methods]
    head = ["method", "setting", "area error %", "volume error %", "time"]
    parts = []
    for case, rows in found:
        lines = [[r.method, r.setting, percent(r.area), percent(r.volume), seconds(r.seconds)] for r in rows]
        parts.append(f"## {case.name}\n\nArea {case.area:.6g}, volume {case.volume:.6g}.\n\n{table(head, lines)}")
    absent = [
        name for name, module in (("manifold3d", "manifold3d"), ("scikit-image", "skimage")) if not find_spec(module)
    ]
    return f"""# Exact solids, beside peers

{made_on(("surfel", "numpy", "numba", "manifold3d", "scikit-image"))} {busy()}

The same trees through every method, in one run and one process; kernels are compiled and caches are warm. Errors are
relative to closed forms. surfel's are the root mean square over {SEEDS} seeds, and its `measure` gives area, volume,
centroid and inertia with error bars in the time told; a peer's error is that of its facets, without a bar. manifold3d
cuts circles into so many edges; building the primitives, the Booleans and the area count. Marching cubes are
scikit-image's over the tree's first-order distance; our own kernel fills it in, and that time counts. Subdivision is
our own baseline (recursive subdivision, then faceting).
{"Absent here: " + ", ".join(absent) + "." if absent else ""}

## Time to an area within {GOAL:.1%} for good

The coarsest setting that is so near, all finer ones being so, too.

{table(["method", *(case.name for case, _ in found)], summary)}
{chr(10).join(parts)}"""


def _soonest(rows: list[Row]) -> str:
    """Return the time of the first setting from which on all are near enough."""
    good = None
    for row in reversed(rows):
        if not row.area <= GOAL:
            break
        good = row
    return "-" if good is None else f"{seconds(good.seconds)} ({percent(good.area)} %)"
