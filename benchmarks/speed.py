"""How long things take, beside what was aimed at and beside a peer in the same run."""

from __future__ import annotations

import math
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.clouds import random_cloud, vertex_cloud
from benchmarks.estimates import area_of
from benchmarks.shapes import DATA, MESHES, NoDataError, read_mesh
from benchmarks.tables import busy, made_on, seconds, table

ROOT = Path(__file__).resolve().parents[1]
LARGE = 500_000
HUGE = 5_000_000
LINES = 1_000_000


@dataclass(frozen=True)
class Timing:
    """One line of the table; texts, ready to print."""

    what: str
    target: str
    reached: str
    met: str
    cpu: str = ""
    peer: str = ""
    ratio: str = ""


class Spent(NamedTuple):
    """Seconds on the clock, and of all cores together."""

    wall: float
    cpu: float

    def each(self, items: int) -> Spent:
        return Spent(self.wall / items, self.cpu / items)


NOTHING = Spent(math.nan, math.nan)


def median_time(work: Callable[[], object], repeats: int) -> Spent:
    """Return the medians of several runs, after one that does not count."""
    work()
    return _median([_clocked(work) for _ in range(repeats)])


def _median(spent: list[Spent]) -> Spent:
    return Spent(*(statistics.median(column) for column in zip(*spent, strict=True)))


def _clocked(work: Callable[[], object]) -> Spent:
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return Spent(time.perf_counter() - wall, time.process_time() - cpu)


def area_in_memory(name: str, n: int | None, target: float, repeats: int) -> Timing:
    """Time area and error bar from points in memory."""
    cloud = vertex_cloud(name) if n is None else random_cloud(name, n)
    spent = median_time(lambda: area_of(cloud.points, cloud.normals), repeats)
    what = f"{name}, {'vertices' if n is None else f'{n:,} samples'} ({len(cloud.points):,}): area and error bar"
    return _timing(what, target, spent)


def neighbours(repeats: int) -> list[Timing]:
    """Time all 16 nearest neighbours of 500,000 points, building included, against SciPy in the same run."""
    from scipy.spatial import cKDTree

    from surfel.index import simd
    from surfel.index.neighbours import PointIndex

    points = random_cloud("bunny", LARGE).points
    mine = median_time(lambda: PointIndex(points).knn(16), repeats)
    theirs = median_time(lambda: cKDTree(points).query(points, k=17, workers=-1), max(1, repeats // 2))
    vector = simd.compresses()
    what = f"16 nearest of {LARGE:,} points, {'with' if vector else 'without'} the vector filter"
    index = PointIndex(points)
    search = median_time(lambda: index.knn(16), repeats)
    return [
        _timing(what, 0.1 if vector else 0.25, mine, "SciPy cKDTree", theirs),
        _timing("the same, the search alone", math.inf, search),
    ]


def lines_through_patches(repeats: int) -> list[Timing]:
    """Time a weighted count of lines through the bunny's patches, against Embree's count on its mesh."""
    import surfel
    from surfel.lines.enclosing import smallest_ball
    from surfel.lines.models import lines_through_ball
    from surfel.lines.sequences import unit_points

    mesh = read_mesh("bunny")
    cloud = surfel.Surfels(*mesh.vertex_points())
    ball = smallest_ball(cloud.points)
    lines = lines_through_ball(unit_points("niederreiter", 0, LINES), ball.centre, ball.radius)
    surface = cloud.surface
    fans, tree, *_ = surface._once("fans", surface._crossable)
    origins = (lines.origins - surface.origin) / surface.scale
    spent = median_time(lambda: tree.weighted_count(origins, lines.directions, fans.weights), repeats).each(LINES)
    plain = median_time(lambda: mesh.bvh.count(lines.origins, lines.directions), repeats).each(LINES)
    embree = _embree(mesh, lines, 2.0 * ball.radius, repeats)
    peer = "Embree on the mesh" if math.isfinite(embree.wall) else "Open3D is absent"
    return [
        _timing(f"a line through the bunny's {len(fans.triangles):,} patches, of {LINES:,}", 5e-7, spent, peer, embree),
        _timing(f"the same through the mesh of {len(mesh):,} triangles", math.inf, plain, peer, embree),
    ]  # fmt: skip


def _embree(mesh, lines, reach: float, repeats: int) -> Spent:
    try:
        import open3d as o3d
    except ImportError:
        return NOTHING
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(np.asarray(mesh.vertices, np.float32)), o3d.core.Tensor(np.asarray(mesh.triangles, np.uint32))
    )
    rays = np.concatenate([lines.origins - reach * lines.directions, lines.directions], axis=1).astype(np.float32)
    tensor = o3d.core.Tensor(rays)
    return median_time(lambda: scene.count_intersections(tensor), repeats).each(LINES)


def two_threads(repeats: int) -> list[Timing]:
    """Compare one thread with two on 500,000 points, in turn, so that both see the same neighbours on the machine."""
    from surfel._numba import threads_for

    cloud = random_cloud("bunny", LARGE)
    spent: dict[int, list[float]] = {1: [], 2: []}
    for turn in range(repeats + 1):
        for threads in (1, 2):
            with threads_for(LARGE, threads):
                start = time.perf_counter()
                area_of(cloud.points, cloud.normals)
                if turn:
                    spent[threads].append(time.perf_counter() - start)
    one, two = statistics.median(spent[1]), statistics.median(spent[2])
    return [
        Timing(
            f"two threads against one, {LARGE:,} samples", ">= 1.6 x", f"{one / two:.2f} x", _yes(one / two >= 1.6), "",
            "one / two threads", f"{seconds(one)} / {seconds(two)}",
        )
    ]  # fmt: skip


def import_time(repeats: int) -> list[Timing]:
    """Time ``import surfel`` itself, in processes of its own."""
    code = "import time; t = time.perf_counter(); import surfel; print(time.perf_counter() - t)"
    spent = [float(_child([sys.executable, "-c", code])[1]) for _ in range(repeats + 1)][1:]
    return [_timing("import surfel", 0.3, Spent(statistics.median(spent), math.nan))]


def command_line(repeats: int) -> list[Timing]:
    """Time the whole process of ``surfel measure`` on the bunny, kernels cached."""
    path = DATA / "meshes" / MESHES["bunny"]
    if not path.is_file():
        raise NoDataError(f"{path.name} is not in the data folder (set SURFEL_DATA)")
    command = [sys.executable, "-m", "surfel", "measure", str(path), "--as", "points", "--json"]
    spent = [_child(command)[0] for _ in range(repeats + 1)][1:]
    return [_timing("surfel measure bun_zipper.ply --as points, whole process", 1.6, _median(spent))]


def cold_demo() -> list[Timing]:
    """Time the first ``surfel demo`` with an empty cache of kernels: to its result, and to its report."""
    import tempfile

    timings = []
    for what, more, reach in (("to the result", ["--no-report"], 25.0), ("with its report", [], math.inf)):
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/kernels"}
            command = [sys.executable, "-m", "surfel", "demo", f"{folder}/demo", *more]
            spent = _child(command, environment)[0]
            timings.append(_timing(f"first surfel demo, nothing compiled, {what}", reach, spent))
    return timings


def huge(noises: tuple[float, ...] = (0.0, 0.3)) -> list[Timing]:
    """Measure peak memory and time of 5M points in processes of their own, with and without noise."""
    found = []
    for noise in noises:
        small, _ = _grown(LARGE, noise)
        spent, peak = _grown(HUGE, noise)
        kind = "clean" if not noise else f"noise {noise:g} spacings"
        found += [
            Timing(f"{HUGE:,} points, {kind}: peak memory", "<= 3 GB", f"{peak / 1e9:.2f} GB", _yes(peak <= 3e9)),
            Timing(
                f"{HUGE:,} points, {kind}: time", f"<= 12 x {LARGE:,}", f"{spent / small:.1f} x",
                _yes(spent <= 12.0 * small), "", f"{HUGE:,} / {LARGE:,}", f"{seconds(spent)} / {seconds(small)}",
            ),
        ]  # fmt: skip
    return found


_GROWN = """
import resource, sys, time
from benchmarks.clouds import noisy_cloud, random_cloud
from benchmarks.estimates import area_of
n, noise = int(sys.argv[1]), float(sys.argv[2])
warm = noisy_cloud("torus", 60_000, spacings=noise) if noise else random_cloud("torus", 60_000)
area_of(warm.points, warm.normals)
cloud = noisy_cloud("torus", n, spacings=noise) if noise else random_cloud("torus", n)
points, normals = cloud.points, cloud.normals
del cloud, warm
start = time.perf_counter()
area_of(points, normals)
spent = time.perf_counter() - start
print(spent, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024))
"""


def _grown(n: int, noise: float) -> tuple[float, float]:
    """Return time of one area, and peak memory in bytes of the process, making the points included."""
    spent, peak = _child([sys.executable, "-c", _GROWN, str(n), str(noise)])[1].split()[-2:]
    return float(spent), float(peak)


def _child(command: list[str], environment: dict[str, str] | None = None) -> tuple[Spent, str]:
    """Run a process from the root of the repository; return its time and what it printed."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    spent = time.perf_counter() - start
    if done.returncode:
        raise RuntimeError(f"{' '.join(command[1:4])} ended with {done.returncode}: {done.stderr.strip()[-300:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Spent(spent, cpu), done.stdout


def _timing(what: str, target: float, spent: Spent, peer: str = "", theirs: Spent = NOTHING) -> Timing:
    aim = f"<= {seconds(target)}" if math.isfinite(target) else "-"
    met = _yes(spent.wall <= target) if math.isfinite(target) else ""
    told = f"{peer}: {seconds(theirs.wall)}" if math.isfinite(theirs.wall) else peer
    ratio = f"{theirs.wall / spent.wall:.2f} x" if math.isfinite(theirs.wall) else ""
    return Timing(what, aim, seconds(spent.wall), met, seconds(spent.cpu), told, ratio)


def _yes(met: bool) -> str:
    return "yes" if met else "no"


PARTS: dict[str, Callable[[int], list[Timing]]] = {
    "import": import_time,
    "area 36k": lambda repeats: [area_in_memory("bunny", None, 0.12, 3 * repeats)],
    "area 500k": lambda repeats: [area_in_memory("bunny", LARGE, 1.5, repeats)],
    "neighbours": neighbours,
    "lines": lines_through_patches,
    "command": command_line,
    "threads": two_threads,
    "demo": lambda _: cold_demo(),
    "5M": lambda _: huge(),
}
QUICK = ("import", "area 36k", "neighbours", "command")


def run(names: tuple[str, ...], repeats: int) -> list[Timing]:
    """Run the parts, printing each line as it is known."""
    found = []
    for name in names:
        try:
            timings = PARTS[name](repeats)
        except NoDataError as absent:
            print(f"{name} | skipped: {absent}", flush=True)
            continue
        except Exception as error:  # one part that fails shall be seen, and not take the others with it
            timings = [Timing(name, "-", "failed", "no", peer=f"{type(error).__name__}: {error}")]
        for timing in timings:
            print(
                f"{timing.what:64s} | {timing.target:>16s} | {timing.reached:>9s} | {timing.met:3s} | {timing.cpu:>8s}"
                f" | {timing.peer} {timing.ratio}",
                flush=True,
            )
        found += timings
    return found


def report(timings: list[Timing], repeats: int) -> str:
    """Return the result as Markdown."""
    lines = [(t.what, t.target, t.reached, t.met, t.cpu, t.peer, t.ratio) for t in timings]
    return f"""# Speed

{made_on(("surfel", "numpy", "scipy", "numba", "open3d"))} {busy()}

Medians of {repeats} or more runs after one that does not count; kernels are cached. Preparation is included:
neighbours count the building of the index, areas start from bare arrays. "Ratio" is the peer's time over surfel's in
the same run. "CPU time" is of all cores together: where it is no more than the time reached although there
are two threads (from 50,000 points on), the machine was busy with other work, and the time reached is too long.

{table(["what", "target", "reached", "met", "CPU time", "peer", "ratio"], lines)}"""
