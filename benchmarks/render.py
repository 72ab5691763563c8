"""Pictures: times of frames, edges of cuts against true curves, and pixels that differ from the reference."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

import surfel
from benchmarks.tables import busy, made_on, table
from surfel.rendering.frame import Frame
from surfel.rendering.scene import Scene
from surfel.rendering.shading import developed

SIZE = (1024, 768)
CAMERA = surfel.Camera((2.2, -2.9, 1.7), (0, 0, 0), field=42)
BITE = (0.5, -0.7, 0.3)
_WHITE = np.array([255, 255, 255], np.uint8)


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
        ["# Pictures\n", f"{made_on()} {busy()}\n", _times(quick), _edges(quick), _reference(quick), _drags(quick)]
    )


def _drags(quick: bool) -> str:
    """Return the table of the page's drags, where the extra ``view`` is installed."""
    from importlib.util import find_spec

    if find_spec("viser") is None:
        return "Steps of a drag: not measured, for want of the extra `view`.\n"
    from benchmarks.view import drags

    return drags(quick)


def _frame_times(shape: surfel.Surfels | surfel.Difference, smooth: bool) -> tuple[float, float]:
    """Return the median clock and processor time of a frame while the camera goes round, in milliseconds."""
    cameras = list(CAMERA.turntable(8))
    scene = Scene(shape)

    def draw(camera: surfel.Camera) -> None:
        if smooth:
            surfel.render(shape, camera, SIZE)
            return
        frame = Frame(scene, camera, SIZE)
        developed(frame.grid(), frame.view, _WHITE)

    draw(cameras[0])
    clock, processor = [], []
    for camera in cameras[1:]:
        started, spent = time.perf_counter(), time.process_time()
        draw(camera)
        clock.append(time.perf_counter() - started)
        processor.append(time.process_time() - spent)
    return 1e3 * statistics.median(clock), 1e3 * statistics.median(processor)


def _times(quick: bool) -> str:
    three = ball(40_000) - ball(30_000, 0.7, BITE) - ball(30_000, 0.6, (-0.6, -0.6, 0.2))
    cases: list[tuple[str, Callable[[], surfel.Surfels | surfel.Difference], int]] = [
        ("40k surfels", lambda: ball(40_000), 35),
        ("100k surfels", lambda: ball(100_000), 45),
        ("three operands of 100k surfels", lambda: three, 80),
    ]
    if not quick:
        cases.append(("1M surfels", lambda: ball(1_000_000), 90))
    lines = []
    for name, make, goal in cases:
        shape = make()
        clock, processor = _frame_times(shape, smooth=False)
        whole = _frame_times(shape, smooth=True)
        lines.append((name, f"<= {goal} ms", f"{clock:.0f} ms", f"{processor:.0f} ms", f"{whole[0]:.0f} ms"))
    head = ("frame of", "reach", "clock", "processor", "with smooth edges")
    return f"{SIZE[0]} x {SIZE[1]}, camera moving, all kernels cached.\n\n" + table(head, lines)


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
    cases = {
        "ball less ball": ball(40_000) - ball(30_000, 0.7, BITE),
        "ball less cylinder": ball(40_000) - surfel.Cylinder(radius=0.4, height=4),
        "box less ball": surfel.Box(1.6) - ball(40_000, 0.9, BITE),
    }
    lines = []
    for name, shape in cases.items():
        image, truth = (surfel.render(shape, CAMERA, size, reference=how) for how in (False, True))
        covered = np.count_nonzero(truth.ids >= 0)
        other = np.count_nonzero(image.ids != truth.ids) / covered
        visible = np.count_nonzero(np.abs(image.pixels.astype(int) - truth.pixels).max(axis=2) > 32) / covered
        lines.append((name, "<= 0.5 %", f"{100 * other:.3f} %", f"{100 * visible:.3f} %"))
    return table(("pixels that differ from the reference", "reach", "another leaf", "color off by over 32"), lines)
