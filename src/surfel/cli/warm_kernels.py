"""The kernels that measuring a cloud or a report needs last: called for next to nothing, with the types it has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import is_cached
from surfel.core.cast import Floats, read_only
from surfel.core.crossings import Crossings
from surfel.core.lines import Lines
from surfel.index import bvh_trace
from surfel.index.bvh import TriangleBvh
from surfel.lines.bundles import Bundles
from surfel.measuring.by_lines import SHIFTS, measure_by_lines
from surfel.shapes.base import Shape
from surfel.shapes.sheets import CloudCrossings, crossings_of
from surfel.surface.border import is_covered
from surfel.surface.fans import STAR, build_fans
from surfel.surface.noise import noise_level

_POINTS = 240  # enough for the noise to be asked for
_LINES = 512 * SHIFTS  # enough to be sorted


def compile_last() -> None:
    """Compile what stands behind the first neighbours, but for the cells: noise, borders, fans and all of the lines.

    So much takes as long as what the command compiles meanwhile. The fans come second, when the kernels that the tree
    shares with the neighbours are in the cache already.
    """
    if not is_cached(bvh_trace.trace):
        return  # no folder can be written: the work would be lost
    noise_level(_Sphere(_POINTS))
    is_covered(np.zeros(1), np.zeros(1), 1, 0.0, 0.0, 0.0)
    octahedron = _Octahedron()
    measure_by_lines(octahedron, Bundles.over(octahedron.corners, SHIFTS, 0, 0.1), _LINES)


def compile_for_report() -> None:
    """Compile what the report of the demo needs after its first pictures: the safe surface, and measuring a tree."""
    if not is_cached(bvh_trace.trace):
        return
    import surfel
    from surfel.cli.part import BoredBlock

    scan = surfel.Surfels(*BoredBlock().sample(20 * _POINTS))
    lid = surfel.bound(scan, direction=(0, 0, 1), shape=(12, 12), mode="tight")
    lid.verify(scan)
    surfel.render(lid, size=(40, 30))
    surfel.measure(scan - surfel.Sphere(1.0).translated((2.0, -1.5, 1.0)))


class _Sphere:
    """Points on a sphere, and their neighbours without an index."""

    def __init__(self, count: int) -> None:
        z = (2.0 * np.arange(count) + 1.0) / count - 1.0
        ring, turn = np.sqrt(1.0 - z * z), 2.399963 * np.arange(count)
        self.points: Floats = read_only(np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1))

    def knn(self, k: int, rows: NDArray[np.int32] | None = None) -> tuple[Floats, NDArray[np.int32]]:
        """Return squared distances and rows of the k nearest neighbours."""
        chosen = self.points if rows is None else self.points[rows]
        squared = ((chosen[:, None, :] - self.points) ** 2).sum(axis=2)
        near = np.argsort(squared, axis=1)[:, 1 : k + 1].astype(np.int32)
        return np.take_along_axis(squared, near, axis=1), near


class _Octahedron(Shape):
    """A cloud of six points, crossed as any cloud is."""

    def __init__(self) -> None:
        self.corners: Floats = np.concatenate([np.eye(3), -np.eye(3)])
        star = np.full((6, STAR), -1, np.int32)
        for i in range(6):
            one, two = (i + 1) % 3, (i + 2) % 3
            star[i, :4] = one, two, one + 3, two + 3
        self._fans = build_fans(
            read_only(self.corners.copy()), self.corners, np.full(6, 2.0), star, np.full(6, 0b1111, np.int32)
        )
        self._tree = TriangleBvh(self._fans.vertices, self._fans.triangles)

    @property
    def bounds(self) -> Floats:
        return np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])

    def _cross(self, lines: Lines) -> CloudCrossings:
        hits = self._tree.cross(lines.origins, lines.directions, barycentric=True)
        fans = self._fans
        return crossings_of(
            lines, hits, self.corners, self.corners, np.ones(6), fans.triangles, fans.weights, fans.votes
        )

    def _sheets(self, crossings: Crossings) -> Crossings:
        assert isinstance(crossings, CloudCrossings)
        return crossings.merged()
