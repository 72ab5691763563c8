"""Pictures: times of frames, edges of cuts against true curves, and pixels that differ from the reference."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import surfel
from benchmarks.shapes import DATA
from benchmarks.tables import busy, made_on, table

SIZE = (1024, 768)
CAMERA = surfel.Camera((2.2, -2.9, 1.7), (0, 0, 0), field=42)
BITE = (0.5, -0.7, 0.3)
CYLINDER, BOX = surfel.Cylinder(radius=0.5, height=1.8), surfel.Box(1.2)


def ball(n: int, radius: float = 1.0, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> surfel.Surfels:
    """Return even points of a sphere with their normals (a spherical Fibonacci set)."""
    i = np.arange(n) + 0.5
    z, angle = 1.0 - 2.0 * i / n, np.pi * (1.0 + np.sqrt(5.0)) * i
    ring = np.sqrt(1.0 - z * z)
    normals = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
    return surfel.Surfels(radius * normals + np.array(centre), normals=normals)


def cube(per_edge: int) -> surfel.Surfels:
    """Return a grid of points on each face of the cube from -1 to 1."""
    grid = (np.arange(per_edge) + 0.5) / per_edge * 2.0 - 1.0
    u, v = (part.ravel() for part in np.meshgrid(grid, grid))
    points, normals = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            place = np.empty((len(u), 3))
            place[:, axis], place[:, (axis + 1) % 3], place[:, (axis + 2) % 3] = sign, u, v
            points.append(place)
            normals.append(np.tile(sign * np.eye(3)[axis], (len(u), 1)))
    return surfel.Surfels(np.concatenate(points), normals=np.concatenate(normals))


def report(quick: bool) -> str:
    """Return all tables as Markdown."""
    return "\n".join(
        [
            "# Pictures\n",
            f"{made_on()} {busy()}\n",
            _times(quick),
            _edges(quick),
            _reference(quick),
            _outlines(quick),
            _drags(quick),
        ]
    )


def _drags(quick: bool) -> str:
    """Return the table of the page's drags, where the extra ``view`` is installed."""
    from importlib.util import find_spec

    if find_spec("viser") is None:
        return "Steps of a drag: not measured, for want of the extra `view`.\n"
    from benchmarks.view import drags

    return drags(quick)


class Times(NamedTuple):
    """What frames of a shape cost, in milliseconds."""

    first: float  # of a shape that nothing is known of
    whole: float  # of a later one, by the clock
    processor: float  # both threads together
    plain: float  # without smooth edges


def _frame_times(make: Callable[[], surfel.Surfels | surfel.Difference]) -> Times:
    """Return the times of the first frame of a shape, and the medians of later ones while the camera goes round."""
    cameras = list(CAMERA.turntable(8))
    shape, started = make(), time.perf_counter()
    surfel.render(shape, cameras[0], SIZE)
    first = time.perf_counter() - started
    found = []
    for smooth in (True, False):
        clock, processor = [], []
        for camera in cameras:
            started, spent = time.perf_counter(), time.process_time()
            surfel.render(shape, camera, SIZE, smooth=smooth)
            clock.append(time.perf_counter() - started)
            processor.append(time.process_time() - spent)
        found.append((statistics.median(clock), statistics.median(processor)))
    return Times(*(1e3 * value for value in (first, *found[0], found[1][0])))


def three_balls() -> surfel.Difference:
    """Return a ball less two others, of 100,000 points in all."""
    return ball(40_000) - ball(30_000, 0.7, BITE) - ball(30_000, 0.6, (-0.6, -0.6, 0.2))


def _times(quick: bool) -> str:
    cases: list[tuple[str, Callable[[], surfel.Surfels | surfel.Difference], int]] = [
        ("40k surfels", lambda: ball(40_000), 35),
        ("100k surfels", lambda: ball(100_000), 45),
        ("three operands of 100k surfels", three_balls, 80),
    ]
    if not quick:
        cases.append(("1M surfels", lambda: ball(1_000_000), 90))
    surfel.render(three_balls(), CAMERA, SIZE)  # loads or compiles all kernels
    lines = []
    for name, make, goal in cases:
        times = _frame_times(make)
        lines.append((name, f"<= {goal} ms", *(f"{value:.0f} ms" for value in times)))
    head = ("frame of", "reach", "later, clock", "processor", "edges not smooth")
    lines = [(name, goal, later, processor, plain, first) for name, goal, first, later, processor, plain in lines]
    return f"{SIZE[0]} x {SIZE[1]}, camera moving, all kernels cached.\n\n" + table((*head, "the first"), lines)


def _deviation(image: NDArray[np.int32], truth: NDArray[np.int32]) -> float:
    """Return the mean distance of two edges in pixels: the area between them over the length of the true one."""
    steps = np.count_nonzero(truth[:, 1:] != truth[:, :-1]) + np.count_nonzero(truth[1:] != truth[:-1])
    return float(np.count_nonzero(image != truth) / (steps / np.sqrt(2.0)))


def _edge_cases() -> Iterator[tuple[str, surfel.Difference, surfel.Difference, tuple[float, ...], int, float]]:
    hole = surfel.Cylinder(radius=0.5, height=4).rotated((1, 0, 0), 90)
    yield "cube less cylinder", cube(80) - hole, surfel.Box(2) - hole, (0.35355, -1.0, 0.35355), 30, 0.25
    curved = ball(40_000) - ball(30_000, 0.7, BITE)
    exact = surfel.Sphere(1) - surfel.Sphere(0.7).translated(BITE)
    whole = surfel.render(exact, CAMERA, SIZE, smooth=False)
    ys, xs = np.nonzero(whole.ids == 1)
    place = whole.point_at(int(xs[xs.argmax()]), int(ys[xs.argmax()]))
    assert place is not None
    for zoom, goal in ((1, 0.5), (6, 0.5), (40, 1.0)):
        yield "ball less ball", curved, exact, tuple(place), zoom, goal


def _edges(quick: bool) -> str:
    lines = []
    for name, cloud, exact, place, zoom, goal in _edge_cases():
        camera = surfel.Camera(CAMERA.eye, place, field=CAMERA.field).zoomed(zoom)  # type: ignore[arg-type]
        truth = surfel.render(exact, camera, SIZE, smooth=False).ids
        found = []
        for method in ("blend",) if quick else ("blend", "clip-buffer", "quads"):
            image = surfel.render(cloud, camera, SIZE, smooth=False, method=method)
            found.append(f"{_deviation(image.ids, truth):.2f}")
        lines.append((f"{name}, zoom {zoom}", f"<= {goal:g}", *found))
    head = ("edge of the cut, mean pixels off", "reach", "blend", *(() if quick else ("clip buffer", "quads")))
    return table(head, lines)


def _reference(quick: bool) -> str:
    size = (512, 384) if quick else SIZE
    trees: dict[str, Any] = {
        "ball less ball": (ball(40_000) - ball(30_000, 0.7, BITE), CAMERA),
        "ball less cylinder": (ball(40_000) - surfel.Cylinder(radius=0.4, height=4), CAMERA),
        "box less ball": (surfel.Box(1.6) - ball(40_000, 0.9, BITE), CAMERA),
    }
    cases = trees | {name: (surfel.read(path, as_="points"), None) for name, path in _scans()}
    lines = []
    for name, (shape, camera) in cases.items():
        image, truth = (surfel.render(shape, camera, size, reference=how) for how in (False, True))
        covered = np.count_nonzero(truth.ids >= 0)
        other = np.count_nonzero(image.ids != truth.ids) / covered
        visible = np.count_nonzero(np.abs(image.pixels.astype(int) - truth.pixels).max(axis=2) > 32) / covered
        lines.append((name, "<= 0.5 %", f"{100 * other:.3f} %", f"{100 * visible:.3f} %"))
    note = "Scans that lie in the folder `$SURFEL_DATA` are the vertices of meshes.\n"
    return (
        table(("pixels that differ from the reference", "reach", "another leaf", "color off by over 32"), lines) + note
    )


def random_torus(n: int, small: float) -> surfel.Surfels:
    """Return random points of a torus of radii 1 and ``small`` with their normals, even by area."""
    rng = np.random.default_rng(1)
    u, v = rng.uniform(0.0, 2.0 * np.pi, (2, 4 * n))
    even = rng.uniform(0.0, 1.0 + small, 4 * n) < 1.0 + small * np.cos(v)
    u, v = u[even][:n], v[even][:n]
    normals = np.column_stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)])
    return surfel.Surfels(np.column_stack([np.cos(u), np.sin(u), 0.0 * u]) + small * normals, normals=normals)


def random_points(solid: Any, n: int) -> surfel.Surfels:
    """Return random points of an exact solid with their normals; none lie on its edges."""
    found = surfel.sample(solid, n)
    return surfel.Surfels(found.points, normals=found.normals)


def _outlines(quick: bool) -> str:
    """Return how well splats, and the reference itself, keep to outlines that are known."""
    cases: dict[str, tuple[Any, Callable[[int], surfel.Surfels]]] = {
        "torus 1 and 0.4": (surfel.Torus(1.0, 0.4), lambda n: random_torus(n, 0.4)),
        "torus 1 and 0.1": (surfel.Torus(1.0, 0.1), lambda n: random_torus(n, 0.1)),
        "cylinder": (CYLINDER, lambda n: random_points(CYLINDER, n)),
        "box": (BOX, lambda n: random_points(BOX, n)),
    }
    lines = []
    for n in (5_000,) if quick else (5_000, 20_000):
        for name, (solid, make) in cases.items():
            truth = surfel.render(solid, CAMERA, SIZE, smooth=False).ids >= 0
            found = []
            for how in (False, True):
                image = surfel.render(make(n), CAMERA, SIZE, smooth=False, reference=how).ids >= 0
                found += [np.count_nonzero(image & ~truth), np.count_nonzero(truth & ~image)]
            share = (f"{100 * value / np.count_nonzero(truth):.3f} %" for value in found)
            lines.append((f"{name}, {n:,} random points", *share))
    head = ("outline against the exact surface", "splats: beyond", "within", "reference: beyond", "within")
    return table(head, lines) + "The reference crosses the curved sheets that points and normals tell of.\n"


def _scans() -> list[tuple[str, Path]]:
    """Return real scans, where there are any."""
    folder = DATA / "meshes"
    names = ("bun_zipper.ply", "horse.ply", "rocker-arm.obj", "igea.ply")
    return [(name, folder / name) for name in names if (folder / name).is_file()]
