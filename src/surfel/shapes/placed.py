"""Placed: a primitive under an affine map. Lines are mapped into its frame, so areas stay right under any map."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.affine import as_affine, inverse
from surfel.core.cast import Floats, read_only
from surfel.core.crossings import Crossings
from surfel.core.lines import Lines
from surfel.core.patches import Patches
from surfel.shapes.base import MARGIN, Shape
from surfel.shapes.primitives.primitive import Primitive, square_points

if TYPE_CHECKING:
    from surfel.shapes.tree import Tree


class Placed(Shape):
    """A primitive under an affine map; what ``primitive.transformed(matrix)`` gives.

    Parameters
    ----------
    shape : Primitive
        In its own frame.
    matrix : Floats, shape (4, 4)
        From there to the world.
    """

    def __init__(self, shape: Primitive, matrix: Floats) -> None:
        self.shape = shape
        self.matrix = read_only(matrix.copy())

    @cached_property
    def inverse(self) -> Floats:
        """The map from the world to the frame of the primitive, shape (3, 4)."""
        return read_only(inverse(self.matrix))

    @cached_property
    def bounds(self) -> Floats:
        """The lowest and the highest corner of an axis-aligned box round the shape, shape (2, 3)."""
        return read_only(self.shape._bounds_under(self.matrix))

    @property
    def solid(self) -> bool:
        """Whether there is an inside; else the shape is a sheet."""
        return self.shape.solid

    @property
    def sampled(self) -> bool:
        """Whether points can be drawn from the surface."""
        return self.shape.sampled

    def transformed(self, matrix: ArrayLike) -> Placed:
        """Return the shape under a further affine map, shape (4, 4)."""
        return Placed(self.shape, as_affine(as_affine(matrix) @ self.matrix))

    @cached_property
    def _alone(self) -> Tree:
        from surfel.shapes.tree import Union

        return Union(self)

    def _events(self, lines: Lines) -> Crossings:
        return self.shape._cross_placed(lines, self.inverse)

    def _cross(self, lines: Lines) -> Crossings:
        return self._alone._cross(lines)

    def _hull(self) -> tuple[Floats, float]:
        points, _ = self.shape._hull()
        moved = points @ self.matrix[:3, :3].T + self.matrix[:3, 3]
        return moved, MARGIN * float(np.abs(moved).max())

    def _is_sheet(self) -> bool:
        return not self.shape.solid

    def _sample(self, uv: Floats) -> Patches:
        return self._mapped(self.shape._sample(uv))

    def _mapped(self, local: Patches) -> Patches:
        """Map elements to the world: normals by the inverse transposed, areas by how the map stretches them."""
        normals = local.normals @ self.inverse[:, :3]
        length = np.sqrt(np.einsum("ij,ij->i", normals, normals))
        stretch = self._volume_factor * length
        points = local.points @ self.matrix[:3, :3].T + self.matrix[:3, 3]
        return Patches(points, normals / length[:, None], local.areas * stretch)

    @cached_property
    def _volume_factor(self) -> float:
        return abs(float(np.linalg.det(self.matrix[:3, :3])))

    def _patches(self, n: int) -> Patches:
        return self._sample(square_points(n))

    def _contains(self, points: Floats) -> NDArray[np.bool_]:
        return self._alone._contains(points)

    def __repr__(self) -> str:
        return f"{self.shape!r}.transformed({np.array2string(self.matrix, separator=', ')})"
