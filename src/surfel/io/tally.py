"""What is counted over all points of a file, run after run: bounds, duplicates, spacing, what is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.io.content import Content

_WHOLE = 4_000_000
"""So many points are looked at together; of more the spacing is that of a sample."""
_SAMPLE = 20_000
_HASHES = 40_000_000
"""So many hashes are kept at a time; of more points, duplicates are counted in several passes."""

Runs = Callable[[], Iterable[Content]]
Words = NDArray[np.uint64]


class Tally:
    """Counts that grow with each run."""

    def __init__(self) -> None:
        self.points = 0
        self.non_finite = 0
        self._without_normal: int | None = None
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)

    @property
    def bounds(self) -> Floats | None:
        """The corners of all finite points, or None where there is none."""
        return np.stack([self._low, self._high]) if self.points > self.non_finite else None

    def add(self, run: Content) -> None:
        """Count one run."""
        content, dropped, _ = run.finite()
        self.points += len(run.points)
        self.non_finite += dropped
        for axis in range(3):  # of a column at a time numpy is several times as fast
            column = content.points[:, axis]
            self._low[axis] = min(self._low[axis], column.min(initial=np.inf))
            self._high[axis] = max(self._high[axis], column.max(initial=-np.inf))
        if content.normals is not None:
            largest = np.abs(content.normals).max(axis=1, initial=0.0)
            missing = int(len(largest) - (np.isfinite(largest) & (largest > 0.0)).sum())
            self._without_normal = (self._without_normal or 0) + missing

    def closer(self, runs: Runs) -> dict[str, Any]:
        """Return what takes further passes over the points."""
        finite = self.points - self.non_finite
        if finite <= _WHOLE:
            points = np.concatenate([np.empty((0, 3)), *(run.finite()[0].points for run in runs())])
            places, duplicates = _distinct(points)
            spacing = _spacing(places, places)
        else:
            duplicates = _duplicates_by_hash(runs, finite)
            spacing = _spacing_of_sample(runs, finite)
        return {
            "spacing": spacing, "duplicates": duplicates, "non_finite": self.non_finite,
            "without_normal": self._without_normal,
        }  # fmt: skip


def _distinct(points: Floats) -> tuple[Floats, int]:
    """Return the distinct places and how many points lie at the place of an earlier one."""
    if len(points) == 0:
        return points, 0
    order = np.lexsort(points.T)
    ordered = points[order]
    new = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
    return ordered[new], int(len(points) - new.sum())


def _duplicates_by_hash(runs: Runs, count: int) -> int:
    """Count by hashes of 64 bits, as many passes as it takes to keep few of them at a time.

    Of 500 million places two that differ share a hash with a probability of 0.7 %.
    """
    passes = -(-count // _HASHES)
    duplicates = 0
    for number in range(passes):
        kept = []
        for run in runs():
            hashes = _hashes(run.finite()[0].points)
            kept.append(hashes if passes == 1 else hashes[hashes % np.uint64(passes) == np.uint64(number)])
        together = np.concatenate(kept)
        together.sort()
        duplicates += int((together[1:] == together[:-1]).sum())
    return duplicates


def _hashes(points: Floats) -> Words:
    """Mix the bits of each row (the finalizer of D. Stafford's variant 13 of MurmurHash3, once a coordinate)."""
    bits: Words = np.ascontiguousarray(points + 0.0).view(np.uint64)  # + 0.0: minus zero is the same place
    mixed = np.zeros(len(bits), np.uint64)
    with np.errstate(over="ignore"):
        for axis in range(3):
            mixed = (mixed + np.uint64(0x9E3779B97F4A7C15)) ^ bits[:, axis]
            mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            mixed ^= mixed >> np.uint64(31)
    return mixed


def _spacing_of_sample(runs: Runs, count: int) -> float | None:
    """Return the median over a sample of the distance to the nearest other place, which is sought in every run."""
    step = max(1, count // _SAMPLE)
    at, sample = 0, []
    for run in runs():
        points = run.finite()[0].points
        sample.append(points[-at % step :: step])
        at += len(points)
    places = np.unique(np.concatenate(sample), axis=0)
    nearest = np.full(len(places), np.inf)
    for run in runs():
        points = np.unique(run.finite()[0].points, axis=0)
        nearest = np.minimum(nearest, _nearest_other(points, places))
    spacing = float(np.median(nearest)) if len(nearest) else np.inf
    return spacing if np.isfinite(spacing) else None


def _spacing(places: Floats, at: Floats) -> float | None:
    """Return the median distance from some distinct places to the nearest other one."""
    if len(places) < 2:
        return None
    spacing = float(np.median(_nearest_other(places, at)))
    return spacing if np.isfinite(spacing) else None


def _nearest_other(places: Floats, at: Floats) -> Floats:
    """Return the distance from each row of ``at`` to the nearest of ``places`` that is not the same."""
    from scipy.spatial import cKDTree

    with np.errstate(over="ignore"):
        size = float(np.abs(places - places[0]).max(initial=0.0)) or 1.0  # squares of FLT_MAX and more overflow
        scaled, asked = (places - places[0]) / size, (at - places[0]) / size
        if len(places) == 1:
            distance = np.stack([np.linalg.norm(asked, axis=1), np.full(len(at), np.inf)], axis=1)
        else:
            distance, _ = cKDTree(scaled).query(asked, k=2)
        nearest: Floats = np.where(distance[:, 0] > 0.0, distance[:, 0], distance[:, 1]) * size
    return nearest
