"""What surfel says about a cloud: the area alone, with its error, or the whole measure."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.clouds import Cloud
from benchmarks.pieces import Floats

MODES = ("value", "error", "measure")
"""The area; the area with its error, without lines; everything, with lines."""

Z95 = 1.959964


@dataclass(frozen=True)
class Outcome:
    """One case: relative errors against the truth (NaN where there is none), and what surfel said of itself."""

    row: str
    shape: str
    normals: str
    points: int
    error: float
    half_width: float
    noise: float
    seconds: float
    reliable: bool = True
    volume: float = math.nan
    volume_half_width: float = math.nan
    centroid: float = math.nan
    leak: float = math.nan

    @property
    def covered(self) -> bool:
        """Whether the 95 % interval of the area holds the truth."""
        return abs(self.error) <= self.half_width


def area_of(points: Floats, normals: Floats | None = None, *, error: bool = True) -> tuple[float, float, float]:
    """Return the area, its standard error (NaN where not asked for) and the noise in spacings, without any line."""
    import surfel

    surface = surfel.Surfels(points, normals).surface
    local = surface.local
    assert local is not None
    square = surface.scale**2
    found = surface.error.standard_error * square if error else math.nan
    return local.area * square, found, local.noise


def judge(row: str, cloud: Cloud, *, mode: str = "error", lines: int = 100_000) -> Outcome:
    """Measure a cloud and compare with the truth."""
    normals = "none" if cloud.normals is None else "given"
    start = time.perf_counter()
    if mode == "measure":
        return _whole(row, normals, cloud, lines)
    area, error, noise = area_of(cloud.points, cloud.normals, error=mode == "error")
    seconds = time.perf_counter() - start
    truth = cloud.shape.area
    return Outcome(row, cloud.name, normals, len(cloud.points), area / truth - 1.0, Z95 * error / truth, noise, seconds)


def _whole(row: str, normals: str, cloud: Cloud, lines: int) -> Outcome:
    import surfel

    start = time.perf_counter()
    m = surfel.measure(surfel.Surfels(cloud.points, cloud.normals), lines=lines, seed=0)
    seconds = time.perf_counter() - start
    truth = cloud.shape
    known: dict[str, Any] = {"leak": m.leak}
    if truth.volume is not None and m.volume is not None:
        low, high = m.volume.interval(0.95)
        size = 0.5 * float(np.linalg.norm(np.ptp(cloud.points, axis=0)))
        known |= {
            "volume": m.volume.value / truth.volume - 1.0,
            "volume_half_width": 0.5 * (high - low) / truth.volume,
            "centroid": float(np.linalg.norm(np.asarray(m.centroid.value) - truth.centroid)) / size,
        }
    low, high = m.area.interval(0.95)
    return Outcome(
        row, cloud.name, normals, len(cloud.points), m.area.value / truth.area - 1.0, 0.5 * (high - low) / truth.area,
        m.noise, seconds, m.area.reliable, **known,
    )  # fmt: skip
