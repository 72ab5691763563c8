"""Peers on Booleans: the same pairs of solids through manifold3d and trimesh, and inside tests through libigl."""

from __future__ import annotations

import importlib
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

import surfel
from benchmarks.clouds import generator
from benchmarks.judge_cases import Solid, known_solid, places_of
from benchmarks.shapes import DATA, NoDataError
from benchmarks.tables import busy, made_on, percent, seconds, table
from surfel.core.affine import rotation, translation

SURFELS = 100_000
PAIRS = (("spot", "fertility"), ("armadillo", "rocker-arm"), ("horse", "torus mesh"), ("box", "csg"))
"""Solids of about unit size; the second is turned and shifted."""

SMOOTH = {"box": False, "csg": False}
OPERATIONS = ("union", "intersection", "difference")
_MANIFOLD = {"union": "__add__", "intersection": "__xor__", "difference": "__sub__"}
_PLACES = 50_000


@dataclass(frozen=True)
class Row:
    """What one method made of one pair: relative errors, and seconds to prepare and to work."""

    pair: str
    operation: str
    method: str
    area: float
    volume: float
    prepare: float
    work: float


@dataclass(frozen=True)
class Inside:
    """What one method says of places near a solid: percent wrong, and seconds to prepare and to ask."""

    solid: str
    method: str
    wrong: float
    prepare: float
    ask: float


def run(quick: bool = False) -> tuple[list[Row], list[Inside], list[str]]:
    """Return the Booleans, the inside tests, and what became of the scan that is open."""
    n = SURFELS // 10 if quick else SURFELS
    rows: list[Row] = []
    for names in (PAIRS[-1:] if quick else PAIRS) if find_spec("manifold3d") else ():
        try:
            one, two = known_solid(names[0]), moved(known_solid(names[1]))
        except NoDataError as error:
            print(error)
            continue
        for row in booleans(names, one, two, n, 2):
            print(f"{row.pair:24s} {row.operation:13s} {row.method:22s} area {percent(row.area)} %", flush=True)
            rows.append(row)
    print("inside or outside, and the scan that is open", flush=True)
    inside = [found for name in ("box",) if quick for found in sides(known_solid(name), n)]
    if not quick:
        for name in ("spot", "csg"):
            try:
                inside += sides(known_solid(name), n)
            except NoDataError as error:
                print(error)
    return rows, inside, [] if quick else open_scan()


def moved(solid: Solid) -> Solid:
    """Return a solid turned and shifted, so that it crosses one in the middle."""
    pose = translation([0.22, 0.1, 0.13]) @ rotation([1.0, 0.4, 0.2], 40.0)
    return Solid(solid.name, solid.vertices @ pose[:3, :3].T + pose[:3, 3], solid.triangles)


def booleans(names: tuple[str, str], one: Solid, two: Solid, n: int, repeats: int) -> list[Row]:
    """Ask every method for every operation; the Boolean of the exact meshes by manifold3d is the truth."""
    rng = generator("peers", *names)
    drawn = [solid.draw(n, rng, SMOOTH.get(solid.name, True)) for solid in (one, two)]
    rows, pair = [], " and ".join(names)
    for operation in OPERATIONS:
        prepare, solids = _timed(lambda: [_manifold(solid) for solid in (one, two)], repeats)
        work, exact = _timed(lambda: _operated(solids, operation), repeats)  # noqa: B023
        area, volume = float(exact.surface_area()), float(exact.volume())
        rows.append(Row(pair, operation, "manifold3d, meshes", 0.0, 0.0, prepare, work))
        if find_spec("trimesh"):
            spent, mesh = _timed(lambda: _by_trimesh(one, two, operation), repeats)  # noqa: B023
            rows.append(Row(pair, operation, "trimesh, meshes", abs(mesh.area / area - 1.0),
                            abs(mesh.volume / volume - 1.0), 0.0, spent))  # fmt: skip

        def cold() -> Any:
            clouds = [surfel.Surfels(points, normals=normals) for points, normals in drawn]
            return surfel.combine(_tree(clouds, operation))  # noqa: B023

        spent, result = _timed(cold, repeats)
        measure, told = _timed(lambda: surfel.measure(result.surfels), 1)  # noqa: B023
        rows.append(Row(pair, operation, f"surfel, {n:,} points each", abs(float(told.area) / area - 1.0),
                        abs(float(told.volume) / volume - 1.0), measure, spent))  # fmt: skip
    return rows


def sides(solid: Solid, n: int) -> list[Inside]:
    """Tell which places near the surface are inside, from the same cloud."""
    rng = generator("peers inside", solid.name)
    points, normals = solid.draw(n, rng, SMOOTH.get(solid.name, True))
    spacing = float(np.sqrt(solid.mesh.area / n))
    near = places_of("near", solid, _PLACES, spacing, rng)
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    places = np.concatenate([near, low + (high - low) * rng.random((_PLACES, 3))])
    truth = solid.mesh.contains(places)
    cloud = surfel.Surfels(points, normals=normals)
    prepare, space = _timed(lambda: surfel.Classifier(surfel.Surfels(points, normals=normals)), 3)
    ask, found = _timed(lambda: space.classify(places).inside, 3)
    rows = [Inside(solid.name, "surfel.Classifier", _wrong(found, truth), prepare, ask)]
    if find_spec("igl") is not None:
        igl = importlib.import_module("igl")
        areas = np.full(n, solid.mesh.area / n) if cloud.normals is None else _areas(cloud)
        ask, number = _timed(lambda: igl.fast_winding_number(points, normals, areas, places), 1)
        rows.append(Inside(solid.name, "libigl, fast winding number, points", _wrong(number > 0.5, truth), 0.0, ask))
        faces = np.ascontiguousarray(solid.triangles)
        ask, number = _timed(lambda: igl.fast_winding_number(solid.vertices, faces, places), 1)
        rows.append(Inside(solid.name, "libigl, fast winding number, mesh", _wrong(number > 0.5, truth), 0.0, ask))
    return rows


def open_scan() -> list[str]:
    """Say what each makes of the bunny as it was scanned, with its holes."""
    path = DATA / "meshes" / "bun_zipper.ply"
    if not path.is_file():
        return [f"{path.name} is not in the data folder (set SURFEL_DATA)"]
    mesh = surfel.read(path)
    assert isinstance(mesh, surfel.Mesh)
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    said = []
    if find_spec("manifold3d"):
        solid = _manifold(Solid("scan", mesh.vertices, mesh.triangles.astype(np.int64)))
        said.append(f"manifold3d: {solid.status().name}, {solid.num_tri():,} triangles taken")
    if find_spec("trimesh"):
        trimesh = importlib.import_module("trimesh")
        scan = trimesh.Trimesh(mesh.vertices, mesh.triangles)
        try:
            trimesh.boolean.difference([scan, trimesh.creation.icosphere(radius=0.04).apply_translation(middle)])
            said.append("trimesh: took it")
        except Exception as error:
            said.append(f"trimesh: {type(error).__name__}: {error}")
    cloud = surfel.read(path, as_="points")
    result = surfel.combine(cloud - surfel.Sphere(0.04).translated(middle))
    spent = result.seconds
    state = "leaky" if result.leaky else "closed"
    said.append(f"surfel: {len(result.surfels):,} surfels in {seconds(spent)}, {state}, conflict {result.conflict:.2%}")
    return said


def _areas(cloud: surfel.Surfels) -> Any:
    return np.ascontiguousarray(np.maximum(cloud.patches(1).areas, 0.0))


def _wrong(found: Any, truth: Any) -> float:
    return 100.0 * float(np.mean(np.asarray(found) != truth))


def _tree(clouds: list[surfel.Surfels], operation: str) -> Any:
    one, two = clouds
    return one | two if operation == "union" else one & two if operation == "intersection" else one - two


def _manifold(solid: Solid) -> Any:
    manifold = importlib.import_module("manifold3d")
    mesh = manifold.Mesh(solid.vertices.astype(np.float32), solid.triangles.astype(np.uint32))
    mesh.merge()
    return manifold.Manifold(mesh)


def _operated(solids: list[Any], operation: str) -> Any:
    made = getattr(solids[0], _MANIFOLD[operation])(solids[1])
    made.num_tri()  # it works when it is asked
    return made


def _by_trimesh(one: Solid, two: Solid, operation: str) -> Any:
    trimesh = importlib.import_module("trimesh")
    meshes = [trimesh.Trimesh(solid.vertices, solid.triangles) for solid in (one, two)]
    return getattr(trimesh.boolean, operation)(meshes)


def _timed(work: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Return the median time, after a run that does not count where there are several, and what came out."""
    if repeats > 1:
        work()
    spent, result = [], None
    for _ in range(repeats):
        start = time.perf_counter()
        result = work()
        spent.append(time.perf_counter() - start)
    return statistics.median(spent), result


def report(rows: list[Row], inside: list[Inside], scan: list[str]) -> str:
    """Return the result as Markdown."""
    peers = (("manifold3d", "manifold3d"), ("trimesh", "trimesh"), ("libigl", "igl"))
    absent = [name for name, module in peers if not find_spec(module)]
    lines = [
        [r.pair, r.operation, r.method, percent(r.area), percent(r.volume), seconds(r.prepare), seconds(r.work)]
        for r in rows
    ]
    head = ["pair", "operation", "method", "area off, %", "volume off, %", "construction or measuring", "Boolean"]
    places = [[i.solid, i.method, f"{i.wrong:.3f}", seconds(i.prepare), seconds(i.ask)] for i in inside]
    return f"""# Booleans, beside peers

{made_on(("surfel", "numpy", "numba", "manifold3d", "trimesh", "libigl"))} {busy()}

Pairs of closed meshes. manifold3d's Boolean of the meshes is the truth; trimesh calls the same kernel. surfel sees
random points with normals drawn from the meshes, and no triangles: its time is that of cold clouds to the result, and
its errors are of `surfel.measure` of that result, whose time stands in the column before. What it takes to make a
closed mesh of a scan is not counted. Clock times, after a first run that does not count.
{"Absent here: " + ", ".join(absent) + "." if absent else ""}

{table(head, lines)}
## Inside or outside

{_PLACES:,} places within two spacings of the surface and as many all over the box; the parity of the mesh is the truth.
The winding number of points is told the areas that surfel finds.

{table(["solid", "method", "wrong, %", "build", "ask"], places)}
## The bunny as it was scanned, less a ball

{chr(10).join("- " + text for text in scan) or "Left out in a quick run."}
"""
