"""Points on the triangles of a mesh."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.shapes.mesh import Mesh

_R2 = np.array([0.7548776662466927, 0.5698402909980532])


class Samples(NamedTuple):
    """Points of a surface.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Where they lie.
    normals : Floats, shape (n, 3)
        Unit normals, outward where the shape is closed.
    triangles : NDArray[np.int32], shape (n,)
        The triangle of a mesh that each lies on; of another shape, which of its patches it is.
    """

    points: Floats
    normals: Floats
    triangles: NDArray[np.int32]


def spread(mesh: Mesh, n: int, seed: int) -> tuple[Floats, NDArray[np.int32]]:
    """Return ``n`` low-discrepancy points of the surface and their triangles; see :meth:`Mesh.patches`."""
    source = OfMesh(mesh)
    shift = np.random.default_rng(seed).random(3)
    order = mesh.bvh.order
    reach = np.cumsum(mesh.areas[order])
    numbers = np.arange(n)
    rank = np.searchsorted(reach, (numbers + shift[0]) / n * reach[-1], side="right")
    triangles = order[np.minimum(rank, len(reach) - 1)]
    u, v = ((numbers * ratio + start) % 1.0 for ratio, start in zip(_R2, shift[1:], strict=True))
    return source.place(triangles, u, v), triangles


class OfMesh:
    """Draws from the triangles of a mesh."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.area = some_area(mesh.area)

    def random(self, n: int, rng: np.random.Generator) -> Samples:
        """Return ``n`` independent points, uniform by area."""
        reach = np.cumsum(self.mesh.areas)
        # the n sorted uniform numbers are found as sums of exponential ones: a sweep instead of n searches
        gaps = np.cumsum(rng.standard_exponential(n + 1))
        rank = np.searchsorted(reach, gaps[:-1] / gaps[-1] * reach[-1], side="right")
        triangles = rng.permutation(np.minimum(rank, len(reach) - 1).astype(np.int32))
        points = self.place(triangles, rng.random(n), rng.random(n))
        return Samples(points, self.mesh.face_normals[triangles], triangles)

    def place(self, triangles: NDArray[np.int32], u: Floats, v: Floats) -> Floats:
        """Map the unit square to triangles so that areas stay equal."""
        root = np.sqrt(u)
        corners = self.mesh.triangles[triangles]
        points = (1.0 - root)[:, None] * self.mesh.vertices[corners[:, 0]]
        points += (root * (1.0 - v))[:, None] * self.mesh.vertices[corners[:, 1]]
        points += (root * v)[:, None] * self.mesh.vertices[corners[:, 2]]
        return points


def some_area(area: float) -> float:
    """Return an area that is positive, or say that there is nothing to sample."""
    if not area > 0.0:
        raise InputError("the shape has no area: there is no surface to sample")
    return area
