"""Scans: the difference of two clouds, measured, beside the exact Boolean of the meshes that they were drawn from."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import surfel
from benchmarks.clouds import generator
from benchmarks.judge_cases import Solid, known_solid, on_its_way
from benchmarks.shapes import NoDataError
from benchmarks.tables import busy, made_on, percent, table

AIM = 0.002
PAIRS = (
    ("armadillo", "spot"),
    ("fandisk", "cow"),
    ("igea", "horse"),
    ("fertility", "rocker-arm"),
    ("bunny", "fertility"),
)
OPERATIONS = ("A - B", "B - A", "A & B")


@dataclass(frozen=True)
class Row:
    """Errors as shares of the truth, and the standard errors that were told with them."""

    pair: str
    operation: str
    surfels: int
    area: float
    area_told: float
    volume: float
    volume_told: float
    seconds: float


def run(quick: bool) -> Iterator[Row]:
    """Measure every pair; the second solid is turned and shifted."""
    for first, second in PAIRS[-1:] if quick else PAIRS:
        try:
            solids = known_solid(first), on_its_way(known_solid(second))
            truth = _booleans(*solids)
        except NoDataError as error:
            print(error)
            continue
        for surfels in (20_000,) if quick else (20_000, 100_000):
            clouds = [
                surfel.Surfels(*solid.draw(surfels, generator("scans", first, second, surfels, which), smooth=False))
                for which, solid in enumerate(solids)
            ]
            a, b = clouds
            for operation, tree in zip(OPERATIONS, (a - b, b - a, a & b), strict=True):
                yield _row(f"{first}, {second}", operation, surfels, tree, *truth[operation])


def _row(pair: str, operation: str, surfels: int, tree: surfel.Shape, area: float, volume: float) -> Row:
    started = time.perf_counter()
    found = surfel.measure(tree)
    assert found.volume is not None
    return Row(
        pair, operation, surfels,
        float(found.area.value) / area - 1.0, float(found.area.standard_error) / area,
        float(found.volume.value) / volume - 1.0, float(found.volume.standard_error) / volume,
        time.perf_counter() - started,
    )  # fmt: skip


def _booleans(one: Solid, other: Solid) -> dict[str, tuple[float, float]]:
    """Return the area and the volume of each Boolean of two meshes."""
    try:
        from manifold3d import Manifold, Mesh64
    except ImportError as error:
        raise NoDataError("the truth is made by manifold3d, which is not installed") from error

    a, b = (
        Manifold(Mesh64(np.ascontiguousarray(solid.vertices), np.ascontiguousarray(solid.triangles, np.uint64)))
        for solid in (one, other)
    )
    return {
        name: (float(found.surface_area()), float(found.volume()))
        for name, found in zip(OPERATIONS, (a - b, b - a, a ^ b), strict=True)
    }


def report(rows: list[Row]) -> str:
    """Return the table as Markdown."""
    lines = [
        (
            f"{row.pair}: {row.operation}", f"{row.surfels:,}", percent(row.area, signed=True), percent(row.area_told),
            percent(row.volume, signed=True), percent(row.volume_told), f"{row.seconds:.1f}",
        )
        for row in rows
    ]  # fmt: skip
    parts = [
        "# Scans: what one cloud has and another has not\n",
        __doc__ or "",
        "`surfel.measure` of trees of two clouds of random surfels with normals. Errors in percent of the truth, "
        "beside the standard errors that came with the values; seconds with all that is learnt from the clouds, for "
        "the first tree of each pair.\n",
        table(["clouds", "surfels each", "area", "told", "volume", "told", "seconds"], lines),
    ]
    for surfels in sorted({row.surfels for row in rows}):
        here = [row for row in rows if row.surfels == surfels]
        worst = max(max(abs(row.area), abs(row.volume)) for row in here)
        held = sum((abs(row.area) < 1.96 * row.area_told) + (abs(row.volume) < 1.96 * row.volume_told) for row in here)
        aim = f" (aim: {percent(AIM)} %)" if surfels == 100_000 else ""
        parts.append(
            f"{surfels:,} surfels: worst error {percent(worst)} %{aim}; {held} of {2 * len(here)} intervals of 95 % "
            "hold the truth.\n"
        )
    return "\n".join([*parts, f"{made_on()} {busy()}\n"])
