"""Mesh: triangles as a shape, crossed exactly."""

from __future__ import annotations

import math
import threading
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.affine import as_affine
from surfel.core.box import corners
from surfel.core.cast import Floats, as_count, as_points, read_only
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.core.patches import Patches
from surfel.core.triangles import as_triangles
from surfel.shapes.base import Shape

if TYPE_CHECKING:
    from surfel.index.bvh import TriangleBvh

_JUDGES = np.array([[0.3015, 0.5371, 0.7878], [-0.6713, 0.7049, 0.2289], [0.7291, -0.2113, 0.6510]])
"""Directions in which parity is counted: generic, and far from each other."""

_LARGEST = 1e100  # coordinates beyond have no cube


class Mesh(Shape):
    """A surface of triangles, immutable.

    A mesh is a solid if it is closed: after merging vertices with equal coordinates, every edge is passed as often
    one way as the other. A closed mesh whose triangles face inwards is a solid all the same: it is ``inverted``, and
    normals and signs of crossings are given outwards.

    Parameters
    ----------
    vertices : array_like, shape (v, 3)
        Finite coordinates.
    triangles : array_like of int, shape (f, 3)
        Rows of ``vertices``, counterclockwise seen from outside.
    colors : array_like, shape (v, 3) or (v, 4), optional
        Colors of the vertices; the type is kept.

    Raises
    ------
    InputError
        If a shape or a type does not fit, a coordinate is not finite or a triangle names a vertex that is not there.

    Examples
    --------
    >>> import surfel
    >>> corner = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> mesh = surfel.Mesh(corner, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> mesh.closed, round(mesh.volume, 6), round(mesh.area, 6)
    (True, 0.166667, 2.366025)
    """

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike, colors: ArrayLike | None = None) -> None:
        points = as_points(vertices, "vertices")
        self._vertices = read_only(points.copy() if points is vertices or points.base is not None else points)
        self._triangles = read_only(as_triangles(triangles, len(points)).copy())
        self._colors = None if colors is None else _as_colors(colors, len(points))
        self._lock = threading.RLock()
        self._tree: TriangleBvh | None = None

    @property
    def vertices(self) -> Floats:
        """Coordinates, shape (v, 3), read-only."""
        return self._vertices

    @property
    def triangles(self) -> NDArray[np.int32]:
        """Rows of ``vertices``, shape (f, 3), read-only."""
        return self._triangles

    @property
    def colors(self) -> NDArray[Any] | None:
        """Colors of the vertices as given, or None."""
        return self._colors

    @cached_property
    def bounds(self) -> Floats:
        """The lowest and the highest corner of the box round the triangles, shape (2, 3)."""
        if not len(self):
            raise InputError("a mesh without triangles has no bounds")
        used = self._vertices[self._used]
        return read_only(corners(used))

    @property
    def area(self) -> float:
        """The sum of the areas of the triangles."""
        return float(self.areas.sum())

    @cached_property
    def areas(self) -> Floats:
        """The area of each triangle, shape (f,)."""
        length = np.sqrt(np.einsum("ij,ij->i", self._doubled, self._doubled))
        return read_only(0.5 * length * self._unit_length * self._unit_length)

    @cached_property
    def closed(self) -> bool:
        """Whether every edge is shared by triangles that pass it in opposite directions."""
        from surfel.shapes.mesh_topology import is_closed

        return is_closed(self._merged[self._triangles])

    @property
    def volume(self) -> float | None:
        """The enclosed volume, positive also where the mesh is inverted; None where it is open."""
        return abs(self._signed_volume) if self.closed else None

    @property
    def inverted(self) -> bool:
        """Whether the mesh is closed and its triangles face inwards."""
        return self.closed and self._signed_volume < 0.0

    @cached_property
    def face_normals(self) -> Floats:
        """Unit normals of the triangles, outward where closed, shape (f, 3); zero for a triangle without area."""
        return read_only(_unit(self._outward * self._doubled))

    @cached_property
    def vertex_normals(self) -> Floats:
        """Unit normals of the vertices, outward where closed, shape (v, 3).

        The mean of the normals of the triangles at a vertex, and at vertices with equal coordinates, weighted by
        area; zero where there are none.
        """
        corners = self._merged[self._triangles]
        total = np.empty_like(self._vertices)
        for axis in range(3):
            share = np.repeat(self._doubled[:, axis], 3)
            total[:, axis] = np.bincount(corners.ravel(), share, len(self._vertices))
        return read_only(_unit(self._outward * total)[self._merged])

    def vertex_points(self) -> tuple[Floats, Floats]:
        """Return the mesh as points: its used vertices, equal ones once, and their normals.

        Returns
        -------
        points, normals : Floats, shape (n, 3)
            In the order of the vertices; the normals as in :attr:`vertex_normals`.
        """
        used = np.zeros(len(self._vertices), bool)
        used[self._merged[self._used]] = True
        rows = np.flatnonzero(used)
        return self._vertices[rows], self.vertex_normals[rows]

    def transformed(self, matrix: ArrayLike) -> Mesh:
        """Return the mesh under an affine map; a reflection turns the triangles round, so that outside stays outside.

        Parameters
        ----------
        matrix : array_like, shape (4, 4)
            The last row is 0 0 0 1.

        Raises
        ------
        InputError
            If the matrix is not affine, not finite or singular.
        """
        affine = as_affine(matrix)
        turned = np.linalg.det(affine[:3, :3] / np.abs(affine[:3, :3]).max()) < 0.0
        triangles = self._triangles[:, ::-1] if turned else self._triangles
        return Mesh(self._vertices @ affine[:3, :3].T + affine[:3, 3], triangles, self._colors)

    def patches(self, n: int = 65_536, seed: int = 0) -> Patches:
        """Return ``n`` low-discrepancy samples of the surface, each standing for an equal area.

        Places run along the triangles in the order of a space-filling curve, one every ``area / n``; within a
        triangle they follow the R2 sequence (M. Roberts, *The unreasonable effectiveness of quasirandom sequences*,
        2018).

        Parameters
        ----------
        n : int
            How many.
        seed : int
            Another seed shifts the samples.

        Returns
        -------
        Patches
            Of equal areas that sum to :attr:`area`.

        Raises
        ------
        InputError
            If the mesh has no area.
        """
        from surfel.shapes.sample_mesh import spread

        points, triangles = spread(self, as_count(n, "n"), as_count(seed, "seed", 0))
        return Patches(points, self.face_normals[triangles], np.full(len(points), self.area / len(points)))

    @property
    def bvh(self) -> TriangleBvh:
        """The tree that answers which triangles a line crosses, built on first use."""
        from surfel.index.bvh import TriangleBvh

        with self._lock:
            if self._tree is None:
                self._tree = TriangleBvh(self._vertices, self._triangles)
            return self._tree

    def _cross(self, lines: Lines) -> Crossings:
        offsets, t, triangle, _ = self.bvh.cross(lines.origins, lines.directions)
        along = np.repeat(lines.directions, np.diff(offsets), axis=0)
        cosine = np.einsum("ij,ij->i", along, self.face_normals[triangle])
        return Crossings(offsets, t, cosine, np.ones(len(t)), np.zeros(len(t), np.int32))

    def _hull(self) -> tuple[Floats, float]:
        return self._vertices, 1e-6 * float(np.abs(self._vertices - self._vertices.mean(axis=0)).max())

    def _is_sheet(self) -> bool:
        return not self.closed

    def _patches(self, n: int) -> Patches:
        return self.patches(n)

    def _contains(self, points: Floats) -> NDArray[np.bool_]:
        """Judge by parity in two directions, and where these disagree by a third."""
        if not self.closed:
            raise InputError("an open mesh has no inside; close it, or ask its points (as_='points')")
        inside = self._odd_ahead(points, _JUDGES[0])
        unsure = np.flatnonzero(inside != self._odd_ahead(points, _JUDGES[1]))
        inside[unsure] = self._odd_ahead(points[unsure], _JUDGES[2])
        return inside

    def _odd_ahead(self, points: Floats, direction: Floats) -> NDArray[np.bool_]:
        """Tell from which points a ray along ``direction`` crosses the mesh an odd number of times."""
        hits = self.bvh.cross(points, np.broadcast_to(direction, points.shape))
        ahead = np.concatenate([[0], np.cumsum(hits.t > 0.0)])
        return np.asarray(np.diff(ahead[hits.offsets]) % 2 == 1)

    @cached_property
    def _merged(self) -> NDArray[np.int32]:
        from surfel.shapes.mesh_topology import merge_equal

        return merge_equal(self._vertices)

    @cached_property
    def _used(self) -> NDArray[np.bool_]:
        used = np.zeros(len(self._vertices), bool)
        used[self._triangles] = True
        return used

    @cached_property
    def _unit_length(self) -> float:
        """A power of two near the largest coordinate: in this unit no product over- or underflows."""
        largest = float(np.abs(self._vertices).max(initial=0.0))
        if largest > _LARGEST:
            raise InputError(f"a coordinate of the mesh is {largest:g}, whose cube a number cannot hold; scale it down")
        return math.ldexp(1.0, math.frexp(largest)[1] - 1) if largest > 0.0 else 1.0

    @cached_property
    def _doubled(self) -> Floats:
        """Twice the area of each triangle along its normal, in squares of the unit length, shape (f, 3)."""
        a, b, c = (self._vertices[self._triangles[:, k]] / self._unit_length for k in range(3))
        return np.cross(b - a, c - a)

    @cached_property
    def _signed_volume(self) -> float:
        """A sixth of the sum of a . (b x c), from the middle of the box: the divergence theorem."""
        if not len(self):
            return 0.0
        low, high = self.bounds / self._unit_length
        start = self._vertices[self._triangles[:, 0]] / self._unit_length - 0.5 * (low + high)
        return math.fsum(np.einsum("ij,ij->i", start, self._doubled)) / 6.0 * self._unit_length**3

    @property
    def _outward(self) -> float:
        return -1.0 if self.inverted else 1.0

    def __len__(self) -> int:
        return len(self._triangles)

    def __repr__(self) -> str:
        state = "closed" if self.closed else "open"
        return f"Mesh({len(self._vertices):,} vertices, {len(self):,} triangles, {state})"

    def __getstate__(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("_vertices", "_triangles", "_colors")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _lock=threading.RLock(), _tree=None)
        for array in state.values():
            if array is not None:
                read_only(array)


def _unit(vectors: Floats) -> Floats:
    """Scale to unit length; zero where the length is zero."""
    largest = np.abs(vectors).max(axis=1, keepdims=True, initial=0.0)
    scaled = np.divide(vectors, largest, out=np.zeros_like(vectors), where=largest > 0.0)
    length = np.sqrt(np.einsum("ij,ij->i", scaled, scaled))[:, None]
    return np.asarray(np.divide(scaled, length, out=scaled, where=length > 0.0))


def _as_colors(value: ArrayLike, rows: int) -> NDArray[Any]:
    colors = np.array(value)
    if colors.ndim != 2 or len(colors) != rows or colors.shape[1] not in (3, 4) or colors.dtype.kind not in "uif":
        raise InputError(f"colors must have shape ({rows}, 3) or ({rows}, 4); got {colors.dtype} of {colors.shape}")
    return read_only(colors)
