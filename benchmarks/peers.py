"""Peers: the area of the same clouds by reconstruction, with the recipes of their own documentation.

Open3D's ball pivoting takes radii of 1.5, 3, 6 and 12 mean distances to the nearest point, the ratios of its tutorial
on the bunny. Its Poisson reconstruction runs at depth 9: alone, with the 1 % of vertices of least density removed as
in the tutorial, and with everything farther than 3 mean distances from all points removed. Clouds without normals get
Open3D's own, of 30 neighbours, oriented consistently; that time counts. pymeshlab and CGAL's bindings (both GPL) are
never installed by this project; where somebody has them, they join.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.clouds import Cloud, noisy_cloud, random_cloud, vertex_cloud
from benchmarks.estimates import Z95, area_of
from benchmarks.shapes import JUDGING, SHARP, NoDataError
from benchmarks.tables import busy, made_on, percent, seconds, table

BALLS = (1.5, 3.0, 6.0, 12.0)
DEPTH = 9
SPARSE = 0.01
NEAR = 3.0
NORMALS_FROM, ORIENTED_BY = 30, 30


@dataclass(frozen=True)
class Reading:
    """What one method said about one cloud; the error is relative, and NaN where the method failed."""

    case: str
    method: str
    points: int
    error: float
    half_width: float
    seconds: float
    note: str = ""


def by_surfel(cloud: Cloud) -> tuple[float, float]:
    """Return area and half-width of the 95 % interval."""
    area, error, _ = area_of(cloud.points, cloud.normals)
    return area, Z95 * error


def _open3d_cloud(cloud: Cloud) -> tuple[Any, float]:
    """Return the cloud with oriented normals and its mean distance to the nearest point."""
    import open3d as o3d

    points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points))
    if cloud.normals is not None and cloud.normals.any(axis=1).all():
        points.normals = o3d.utility.Vector3dVector(cloud.normals)
    else:
        points.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NORMALS_FROM))
        points.orient_normals_consistent_tangent_plane(ORIENTED_BY)
    return points, float(np.mean(points.compute_nearest_neighbor_distance()))


def by_ball_pivoting(cloud: Cloud) -> tuple[float, float]:
    import open3d as o3d

    points, apart = _open3d_cloud(cloud)
    radii = o3d.utility.DoubleVector([ratio * apart for ratio in BALLS])
    mesh = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(points, radii)
    return mesh.get_surface_area(), math.nan


def by_poisson(cloud: Cloud, cut: str = "") -> tuple[float, float]:
    """Return the area of the Poisson surface: whole, or cut by "density" or by distance ("near")."""
    import open3d as o3d

    points, apart = _open3d_cloud(cloud)
    mesh, density = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(points, depth=DEPTH)
    if cut == "density":
        known = np.asarray(density)
        mesh.remove_vertices_by_mask(known < np.quantile(known, SPARSE))
    elif cut == "near":
        far = np.asarray(o3d.geometry.PointCloud(mesh.vertices).compute_point_cloud_distance(points))
        mesh.remove_vertices_by_mask(far > NEAR * apart)
    return mesh.get_surface_area(), math.nan


def by_meshlab(cloud: Cloud, filter_name: str) -> tuple[float, float]:
    """Return the area by a filter of pymeshlab with its defaults, on normals as given or as it finds them."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    if cloud.normals is None:
        meshes.add_mesh(pymeshlab.Mesh(cloud.points))
        meshes.compute_normal_for_point_clouds()
    else:
        meshes.add_mesh(pymeshlab.Mesh(cloud.points, v_normals_matrix=cloud.normals))
    getattr(meshes, filter_name)()
    return float(meshes.get_geometric_measures()["surface_area"]), math.nan


def by_advancing_front(cloud: Cloud) -> tuple[float, float, float]:
    """Return the area by CGAL's advancing front with its defaults (it needs no normals), and its own time."""
    from CGAL.CGAL_Advancing_front_surface_reconstruction import advancing_front_surface_reconstruction
    from CGAL.CGAL_Kernel import Point_3
    from CGAL.CGAL_Point_set_3 import Point_set_3
    from CGAL.CGAL_Polyhedron_3 import Polyhedron_3

    points, surface = Point_set_3(), Polyhedron_3()
    for place in cloud.points.tolist():
        points.insert(Point_3(*place))
    start = time.perf_counter()
    advancing_front_surface_reconstruction(points, surface)
    spent = time.perf_counter() - start  # handing points over one by one in Python is not its fault
    area = 0.0
    for facet in surface.facets():
        edge = facet.halfedge()
        a, b, c = (
            np.array([v.x(), v.y(), v.z()])
            for v in (edge.vertex().point(), edge.next().vertex().point(), edge.next().next().vertex().point())
        )
        area += 0.5 * float(np.linalg.norm(np.cross(b - a, c - a)))
    return area, math.nan, spent


Method = Callable[[Cloud], tuple[float, ...]]
"""Gives area, half-width of the 95 % interval or NaN, and the time where it is not that of the whole call."""

METHODS: dict[str, tuple[str, Method]] = {
    "surfel": ("surfel", by_surfel),
    "Open3D ball pivoting": ("open3d", by_ball_pivoting),
    "Open3D Poisson": ("open3d", by_poisson),
    "Open3D Poisson, density cut": ("open3d", lambda cloud: by_poisson(cloud, "density")),
    "Open3D Poisson, near points": ("open3d", lambda cloud: by_poisson(cloud, "near")),
    "pymeshlab ball pivoting": (
        "pymeshlab", lambda cloud: by_meshlab(cloud, "generate_surface_reconstruction_ball_pivoting")
    ),
    "pymeshlab Poisson": (
        "pymeshlab", lambda cloud: by_meshlab(cloud, "generate_surface_reconstruction_screened_poisson")
    ),
    "CGAL advancing front": ("CGAL", by_advancing_front),
}  # fmt: skip


_MODULES = {"CGAL": "CGAL.CGAL_Advancing_front_surface_reconstruction"}


def installed() -> tuple[dict[str, Method], list[str]]:
    """Return the methods that can run here and a line for each package that is absent."""
    reasons = {package: _why_absent(package) for package, _ in METHODS.values()}
    there = {name: method for name, (package, method) in METHODS.items() if not reasons[package]}
    return there, [f"{package} {reason}: its methods are left out." for package, reason in reasons.items() if reason]


def _why_absent(package: str) -> str:
    try:
        import_module(_MODULES.get(package, package))
    except ModuleNotFoundError:
        return "is not installed"
    except ImportError as error:
        return f"cannot be loaded here ({str(error).partition(':')[0]})"
    return ""


def clouds(*, quick: bool = False, large: bool = True) -> Iterator[tuple[str, Callable[[], Cloud]]]:
    """Yield the cases: a label, and what makes its cloud."""
    if quick:
        yield "square, random 2k", lambda: random_cloud("square", 2_000)
        yield "crossing squares, random 4k", lambda: random_cloud("crossing squares", 4_000)
        yield "spot, random 5k", lambda: random_cloud("spot", 5_000)
        yield "spot, random 5k, no normals", lambda: random_cloud("spot", 5_000).bare()
        return
    yield "bunny vertices", lambda: vertex_cloud("bunny")
    yield "bunny vertices, no normals", lambda: vertex_cloud("bunny").bare()
    yield "bunny, random 36k", lambda: random_cloud("bunny", 36_000)
    yield "square, random 5k", lambda: random_cloud("square", 5_000)
    yield "crossing squares, random 10k", lambda: random_cloud("crossing squares", 10_000)
    yield "half-sphere, random 10k", lambda: random_cloud("half-sphere", 10_000)
    for name in JUDGING:
        yield f"{name}, random 20k", lambda name=name: random_cloud(name, 20_000)
    for name in ("armadillo", "fandisk"):
        yield f"{name}, random 20k, no normals", lambda name=name: random_cloud(name, 20_000).bare()
    for name in ("bunny", *(name for name in ("spot", "fertility") if name not in SHARP)):
        yield f"{name}, random 20k, noise 1 %, no normals", lambda name=name: noisy_cloud(name, 20_000, diagonal=0.01)
    if large:
        yield "bunny, random 500k", lambda: random_cloud("bunny", 500_000)


def run(
    cases: Iterator[tuple[str, Callable[[], Cloud]]], methods: dict[str, Method], *, warm: bool = True
) -> list[Reading]:
    """Ask every method about every cloud, printing each answer."""
    if warm:  # kernels are loaded and libraries started before the clock runs
        small = random_cloud("sphere", 2_000)
        for method in methods.values():
            _timed("", "", small, method)
    found = []
    for label, make in cases:
        try:
            cloud = make()
        except NoDataError as absent:
            print(f"{label} | skipped: {absent}", flush=True)
            continue
        for name, method in methods.items():
            reading = _timed(label, name, cloud, method)
            told = f"+-{percent(reading.half_width)}" if math.isfinite(reading.half_width) else ""
            print(
                f"{label:42s} | {name:28s} | {percent(reading.error, signed=True):>7s} % {told:8s}"
                f" | {seconds(reading.seconds):>8s} | {reading.note}",
                flush=True,
            )
            found.append(reading)
    return found


def _timed(label: str, name: str, cloud: Cloud, method: Method) -> Reading:
    truth = cloud.shape.area
    start = time.perf_counter()
    area, half_width, own_time, note = math.nan, math.nan, [], ""
    try:
        area, half_width, *own_time = method(cloud)
    except Exception as error:  # a peer that fails on a cloud is a result
        note = f"failed: {type(error).__name__}: {str(error).splitlines()[0]}"
    spent = own_time[0] if own_time else time.perf_counter() - start
    return Reading(label, name, len(cloud.points), area / truth - 1.0, half_width / truth, spent, note)


def report(readings: list[Reading], absent: list[str]) -> str:
    """Return the result as Markdown: a summary of methods, errors side by side, times side by side."""
    methods = list(dict.fromkeys(r.method for r in readings))
    labels = list(dict.fromkeys(r.case for r in readings))
    at = {(r.case, r.method): r for r in readings}
    packages = ("surfel", "numpy", "scipy", "numba", *(p for p in ("open3d", "pymeshlab") if find_spec(p)))
    errors = [
        [f"{label} ({at[label, methods[0]].points:,})", *(_error(at[label, name]) for name in methods)]
        for label in labels
    ]
    times = [[label, *(seconds(at[label, name].seconds) for name in methods)] for label in labels]
    overall = [[name, *_overall([at[label, name] for label in labels])] for name in methods]
    balls = ", ".join(f"{ball:g}" for ball in BALLS)
    return f"""# Area, beside peers

{made_on(packages)} {busy()}

The same clouds through every method, in one run and one process; normals are the exact ones unless said otherwise.
Errors are relative to the area of the mesh or of the formula that the points were drawn from. surfel's time includes
its error bar; the peers give none. Recipes of Open3D: ball pivoting with radii of {balls} mean distances to the
nearest point; Poisson at depth {DEPTH}, whole, without the {SPARSE:.0%} of vertices of least density, and without
what is farther than {NEAR:g} mean distances from every point. Where there are no normals, it has its own, of
{NORMALS_FROM} neighbours, oriented consistently, and their time counts. The others run with their defaults.
{" ".join(absent)}

## Overall

{table(["method", "median error %", "worst error %", "failed", "total time"], overall)}
## Error, %

{table(["cloud (points)", *methods], errors)}
## Time

{table(["cloud", *methods], times)}"""


def _error(reading: Reading) -> str:
    if math.isnan(reading.error):
        return "failed"
    text = percent(reading.error, signed=True)
    return f"{text} ± {percent(reading.half_width)}" if math.isfinite(reading.half_width) else text


def _overall(mine: list[Reading]) -> list[str]:
    errors = np.abs([r.error for r in mine])
    failed = int(np.isnan(errors).sum())
    if failed == len(mine):
        return ["-", "-", str(failed), seconds(sum(r.seconds for r in mine))]
    return [
        percent(float(np.nanmedian(errors))), percent(float(np.nanmax(errors))), str(failed),
        seconds(sum(r.seconds for r in mine)),
    ]  # fmt: skip
