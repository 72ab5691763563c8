"""The tables of Liu et al. (2006): the paper's figures, ours by their method, and those of the default."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.util import find_spec

import numpy as np

import surfel
from benchmarks.clock import median_seconds, processor_seconds
from benchmarks.clouds import Cloud
from benchmarks.liu2006_counts import LINES, Spread, mixed_signs, prepared, spread
from benchmarks.liu2006_sets import PointSet, sphere, square, two_squares
from benchmarks.shapes import KnownShape
from benchmarks.tables import percent, seconds, table
from surfel.index.octree import build_octree
from surfel.lines.enclosing import smallest_ball
from surfel.shapes.clusters import Reading
from surfel.surface.bilateral import bilateral
from surfel.surface.resample import resample

PAPER_1 = {
    "cylinder": (12_516, 0.015375, 0.015625), "sphere": (30_096, 0.032250, 0.0625), "cube": (65_000, 0.0165, 0.125),
    "cube + cylinder": (21_941, 0.015105, 0.046875), "bunny": (35_947, 0.046999, 0.0625),
    "dragon": (437_645, 0.469, 0.921875),
}  # fmt: skip
PAPER_2 = {"cylinder": (0.0015, 0.0054), "sphere": (0.0019, 0.0113)}
PAPER_3 = {
    "cylinder": (1.015625, 10.281, 0.001506, 0.005816), "sphere": (3.609375, 26.672, 0.0019, 0.013713),
    "cube": (4.25, 3.782, 0.004009, 0.016475), "cube + cylinder": (2.921875, 7.218999, 0.003615, 0.014159),
}  # fmt: skip
PAPER_4 = {"bunny": (1.875, 0.057626, 0.008699), "dragon": (7.109375, 0.073941, 0.018527)}


def table_1(sets: Sequence[PointSet]) -> str:
    """Return the times of the preprocessing."""
    lines = []
    for known in sets:
        theirs, octree, ball = PAPER_1[known.name]
        points = known.points
        lines.append([
            known.name, f"{theirs:,}", f"{len(points):,}", seconds(octree),
            seconds(median_seconds(lambda p=points: build_octree(p, 4))), seconds(ball),
            seconds(median_seconds(lambda p=points: smallest_ball(p))),
        ])  # fmt: skip
    return table(["model", "points: paper", "here", "octree: paper", "here", "ball: paper", "here"], lines)


def default_error(known: PointSet) -> tuple[float, float, float]:
    """Return the error of the default method, the half-width of its 95 % interval, and its time, volume included."""
    cloud = surfel.Surfels(known.points, normals=known.normals)
    surfel.measure(surfel.Surfels(known.points[:500], normals=known.normals[:500]), lines=64)
    found: list[surfel.Measurement] = []
    spent = processor_seconds(lambda: found.append(surfel.measure(cloud, lines=4096)))
    area = found[0].area
    return area.value / known.area - 1.0, 1.96 * float(area.standard_error) / known.area, spent


def qmca_time(known: PointSet) -> float:
    """Return the time of 5,000 lines from points to area, preprocessing included."""
    cloud = surfel.Surfels(known.points, normals=known.normals)
    return median_seconds(lambda: surfel.measure(cloud, method="qmca", radius_factor=known.factor, lines=LINES))


def as_cloud(known: PointSet) -> Cloud:
    shape = KnownShape(known.name, known.area, lambda n, rng: (known.points, known.normals))
    return Cloud(known.name, known.points, known.normals, shape)


def peer(method: Callable[[Cloud], tuple[float, float]], known: PointSet) -> tuple[float, float]:
    """Return error and time of a peer, NaN where Open3D is absent."""
    if find_spec("open3d") is None:
        return float("nan"), float("nan")
    start = time.process_time()
    area = method(as_cloud(known))[0]
    return area / known.area - 1.0, time.process_time() - start


def table_2(found: list[tuple[str, dict[str, Spread]]]) -> str:
    """Return the errors with noise by the readings of "0.001 % variances"."""
    lines = [["the paper", *(f"{percent(e)}" for name in PAPER_2 for e in PAPER_2[name][1:])]]
    lines += [[name, *(told(one[known]) for known in PAPER_2)] for name, one in found]
    return table(["noise", *PAPER_2], lines)


def table_3(sets: Sequence[PointSet], runs: int) -> str:
    """Return errors and times on the simple models, beside Poisson in the place of MPU."""
    from benchmarks.peers import by_poisson

    lines = []
    for known in sets:
        their_time, mpu_time, theirs, mpu = PAPER_3[known.name]
        ours, poisson, mine = spread(known, runs=runs), peer(by_poisson, known), default_error(known)
        counter = prepared(known)
        lines.append([
            known.name, percent(theirs), told(ours), interval(mine), percent(mpu), percent(poisson[0], signed=True),
            seconds(their_time), seconds(lines_time(known, counter)), seconds(qmca_time(known)), seconds(mine[2]),
            seconds(mpu_time), seconds(poisson[1]),
        ])  # fmt: skip
    head = [
        "model", "error %: paper", "our QMCA", "our default", "MPU (paper)", "Poisson", "time: paper",
        "our 5,000 lines", "with preprocessing", "our default", "MPU (paper)", "Poisson",
    ]  # fmt: skip
    return table(head, lines)


def lines_time(known: PointSet, counter: object) -> float:
    """Return the time of 5,000 lines alone, as the paper tells it."""
    from benchmarks.liu2006_counts import error

    return median_seconds(lambda: error(known, LINES, None, counter))  # type: ignore[arg-type]


def table_4(sets: Sequence[PointSet], runs: int) -> str:
    """Return areas, errors and times on the scans."""
    lines = []
    for known in sets:
        their_time, area, theirs = PAPER_4[known.name]
        ours, mine = spread(known, runs=runs), default_error(known)
        lines.append([
            known.name, f"{known.area:.6f}", f"{area:.6f}", f"{known.area * (1.0 + ours.plain):.6f}",
            percent(theirs, signed=True), told(ours), interval(mine), seconds(their_time),
            seconds(lines_time(known, prepared(known))), seconds(qmca_time(known)),
        ])  # fmt: skip
    lines.append(["Buddha", "not at hand", "0.053063", "-", "-5.24", "-", "-", seconds(7.828125), "-", "-"])
    head = [
        "model", "mesh", "QMCA: paper", "here", "error %: paper", "our QMCA", "our default", "time: paper",
        "our 5,000 lines", "with preprocessing",
    ]  # fmt: skip
    return table(head, lines)


def open_and_several(runs: int) -> str:
    """Return the open square, and two squares in two ways, with ball pivoting in the place of Amenta's method."""
    from benchmarks.peers import by_ball_pivoting

    lines = []
    for known in (square(), two_squares(crossing=True), two_squares(crossing=False)):
        mine, pivoting = default_error(known), peer(by_ball_pivoting, known)
        lines.append([
            known.name, percent(known.paper, signed=known.signed), told(spread(known, runs=runs)),
            told(spread(known, runs=runs, reading=Reading("cylinder"))), interval(mine),
            percent(pivoting[0], signed=True), seconds(qmca_time(known)), seconds(pivoting[1]),
        ])  # fmt: skip
    head = [
        "set", "error %: paper", "our QMCA", "the same, cells of the cylinder", "our default", "ball pivoting",
        "time: our QMCA", "ball pivoting",
    ]  # fmt: skip
    return table(head, lines)


def weaknesses(scans: Sequence[PointSet], runs: int) -> str:
    """Return what the paper and its readers name as the method's weaknesses, beside the default."""
    ball = sphere()
    rng = np.random.default_rng(0)
    random = rng.standard_normal((30_096, 3))
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    scattered = replace(ball, points=0.4 * random, normals=random)
    h = 1.0 / 70.0
    flat = two_squares(crossing=False)
    close = replace(flat, points=flat.points * [1.0, 1.0, 2.0 * h])
    cases = [
        ("sphere, as it is", ball),
        ("sphere, all normals inward", replace(ball, normals=-ball.normals)),
        ("sphere, random signs", mixed_signs(ball)),
        *((f"{known.name}, random signs", mixed_signs(known)) for known in scans[:1]),
        ("sphere, random points", scattered),
        ("two squares one spacing apart", close),
    ]
    lines = []
    for name, known in cases:
        lines.append([
            name, told(spread(known, runs=runs)), told(spread(known, runs=runs, reading=Reading("line", "two"))),
            told(spread(known, runs=runs, reading=Reading("cylinder", "two"))), interval(default_error(known)),
        ])  # fmt: skip
    return table(["set", "our QMCA", "case 4 counts two", "the same, cells of the cylinder", "our default"], lines)


def uneven(runs: int) -> str:
    """Return the two remedies of section 5.1 on a sphere whose points lie 16 times denser at one pole."""
    known = uneven_sphere()
    spacing = prepared(known).gap
    points, normals = resample(known.points, known.normals, spacing)
    more = replace(known, points=points, normals=normals)
    wide = Reading("cylinder")
    lines = [
        ["one radius", f"{len(known.points):,}", told(spread(known, runs=runs)),
         told(spread(known, runs=runs, reading=wide))],
        ["uneven cylinder", f"{len(known.points):,}", told(spread(known, runs=runs, cylinder="uneven")),
         told(spread(known, runs=runs, cylinder="uneven", reading=wide))],
        ["resampled", f"{len(points):,}", told(spread(more, runs=runs)), told(spread(more, runs=runs, reading=wide))],
        ["our default", f"{len(known.points):,}", interval(default_error(known)), ""],
    ]  # fmt: skip
    return table(["remedy", "points", "error %", "cells of the cylinder"], lines)


def uneven_sphere(n: int = 120_000) -> PointSet:
    """Return points of a sphere, thinned so that none is nearer to another than a distance that grows by four."""
    from benchmarks.clouds import darts

    rng = np.random.default_rng(0)
    p = rng.standard_normal((n, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    p = p[darts(p, 0.015 * 4.0 ** (0.5 * (1.0 - p[:, 2])), rng)]
    return replace(sphere(), name="uneven sphere", points=0.4 * p, normals=p)


def filtered(sets: Sequence[PointSet], runs: int) -> str:
    """Return what the bilateral filter does to the error and to the points (section 5.2)."""
    lines = []
    for known in sets:
        for sigma in (0.0, 0.001, 1e-5**0.5):
            noisy = known.noisy(sigma)
            line: list[str] = [known.name, f"{sigma:.2g}", told(spread(noisy, runs=runs))]
            for passes in (1, 2):
                found = bilateral(noisy.points, noisy.normals, passes)
                clean = replace(noisy, points=found.points, normals=found.normals)
                line += [told(spread(clean, runs=runs)), f"{found.moved.max():.2g}"]
            lines.append([*line, interval(default_error(noisy))])
    head = ["set", "deviation", "error %", "one pass", "moved at most", "two passes", "moved at most", "our default"]
    return table(head, lines)


def single_hits(sets: Sequence[PointSet]) -> str:
    """Return the area by the single-hit counter of Schaufler and Jensen: first hits, twice for a closed surface."""
    from surfel.lines.models import line_block

    lines = []
    for known in sets:
        counter = prepared(known, reading=Reading("cylinder"))
        ball = smallest_ball(known.points).grown(counter.radius)
        block = line_block("niederreiter", "tangent", ball, 0, 65_536, 65_536)
        unit = ball.surface / (2.0 * 65_536) / known.area
        first = float(counter.counts(block, single=True).sum()) * unit
        lines.append([known.name, percent(first - 1.0, signed=True), percent(2.0 * first - 1.0, signed=True),
                      percent(float(counter.counts(block).sum()) * unit - 1.0, signed=True)])  # fmt: skip
    return table(["set", "first hits, error %", "twice the first hits", "LPSI"], lines)


def told(found: Spread) -> str:
    """Return the error of the plain sequence, and mean and deviation of shifted ones, in percent."""
    plain, mean = percent(found.plain, signed=True), percent(found.mean, signed=True)
    return f"{plain} ({mean} ± {percent(found.deviation)})"


def interval(found: tuple[float, float, float]) -> str:
    return f"{percent(found[0], signed=True)} ± {percent(found[1])}"
