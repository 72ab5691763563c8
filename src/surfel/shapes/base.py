"""The contract of a shape: whatever a line can cross."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.cast import Floats, as_count, as_points, as_rows
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.core.patches import Patches


class Shape(ABC):
    """A solid or a sheet. Public methods validate; the private ones that a subclass writes do the work."""

    @property
    @abstractmethod
    def bounds(self) -> Floats:
        """The lowest and the highest corner of an axis-aligned box round the shape, shape (2, 3)."""

    @abstractmethod
    def _cross(self, lines: Lines) -> Crossings:
        """Return every hit of every line, sorted along each line."""

    def _sheets(self, crossings: Crossings) -> Crossings:
        """Return one event for each passage through the surface; on an exact surface every hit is one."""
        return crossings

    @abstractmethod
    def _patches(self, n: int) -> Patches:
        """Return elements of the surface whose areas sum to its area."""

    @abstractmethod
    def _contains(self, points: Floats) -> NDArray[np.bool_]:
        """Return which of the points lie inside."""

    def cross(self, lines: Lines) -> Crossings:
        """Cross the shape with lines.

        Parameters
        ----------
        lines : Lines
            The lines, infinite in both directions.

        Returns
        -------
        Crossings
            Every hit, sorted along each line.

        Raises
        ------
        InputError
            If ``lines`` is not a :class:`~surfel.Lines`.
        """
        if not isinstance(lines, Lines):
            raise InputError(f"lines must be a surfel.Lines (see Lines.of); got {type(lines).__name__}")
        return self._cross(lines)

    def patches(self, n: int = 65_536) -> Patches:
        """Return elements of the surface, each with a place, a normal and an area.

        Parameters
        ----------
        n : int
            How many, where the shape can choose; a cloud gives one for each of its points.

        Returns
        -------
        Patches
            Elements whose areas sum to the area of the surface.
        """
        return self._patches(as_count(n, "n"))

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Tell which points lie inside.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            In the units of the shape.

        Returns
        -------
        NDArray[np.bool_], shape (n,)
            True inside.

        Raises
        ------
        InputError
            If the points are not finite, or the shape is not closed.
        """
        return self._contains(as_points(points))


def as_affine(matrix: ArrayLike) -> Floats:
    """Return a 4 x 4 affine matrix, or say what is wrong with it."""
    array = as_rows(matrix, "matrix", 4, 4)
    if not np.isfinite(array).all():
        raise InputError("matrix must be finite")
    if not np.array_equal(array[3], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(f"the last row of matrix must be 0 0 0 1 (an affine map); got {array[3].tolist()}")
    scale = float(np.abs(array[:3, :3]).max())
    if scale == 0.0 or abs(np.linalg.det(array[:3, :3] / scale)) < 1e-12:
        raise InputError("matrix must not be singular: it would flatten the shape")
    return array
