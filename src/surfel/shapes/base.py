"""The contract of a shape: whatever a line can cross."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.affine import reflection, rotation, scaling, translation
from surfel.core.cast import Floats, as_count, as_points
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.core.patches import Patches

if TYPE_CHECKING:
    from surfel.shapes.tree import Difference, Intersection, Union

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
"""Which end of a box each of its corners has along each axis."""

MARGIN = 1e-14
"""What is added round exact solids so that rounding leaves nothing outside, in their largest coordinates."""


class Shape(ABC):
    """A solid or a sheet. Public methods validate; the private ones that a subclass writes do the work.

    Shapes are combined by ``a | b`` (union), ``a & b`` (intersection) and ``a - b`` (difference), and moved by the
    methods below; each gives a new shape.
    """

    __array_ufunc__ = None  # the operators of numpy's arrays leave shapes alone

    @property
    @abstractmethod
    def bounds(self) -> Floats:
        """The lowest and the highest corner of an axis-aligned box round the shape, shape (2, 3)."""

    @abstractmethod
    def _cross(self, lines: Lines) -> Crossings:
        """Return every hit of every line, sorted along each line."""

    def _events(self, lines: Lines) -> Crossings:
        """Return what a tree needs of a solid: in and out in turn, from t = -inf or to t = inf where it has no end."""
        return self._cross(lines)

    def _hull(self) -> tuple[Floats, float]:
        """Return points whose convex hull, grown by a margin, holds all that can be crossed."""
        corners = self.bounds[CORNERS, range(3)]
        return corners, MARGIN * float(np.abs(corners).max())

    def _is_sheet(self) -> bool:
        """Tell whether the shape has no inside."""
        return False

    def _sheets(self, crossings: Crossings) -> Crossings:
        """Return one event for each passage through the surface; on an exact surface every hit is one."""
        return crossings

    def _pieces(self, lines: Lines, events: Crossings) -> Crossings:
        """Return the ends of the pieces of lines inside, from one event a passage; odd where nothing is known."""
        return events

    def _patches(self, n: int) -> Patches:
        """Return elements of the surface whose areas sum to its area."""
        raise InputError(f"the surface of a {type(self).__name__} cannot be sampled; cross it with lines instead")

    def _contains(self, points: Floats) -> NDArray[np.bool_]:
        """Return which of the points lie inside."""
        raise InputError(f"a {type(self).__name__} has no inside; leave contains out")

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

    def transformed(self, matrix: ArrayLike) -> Shape:
        """Return the shape under an affine map given as a 4 x 4 matrix; its last row is 0 0 0 1."""
        raise InputError(f"a {type(self).__name__} cannot be moved; move what it was made from")

    def translated(self, vector: ArrayLike) -> Shape:
        """Return the shape moved by a vector."""
        return self.transformed(translation(vector))

    def rotated(self, axis: ArrayLike, degrees: float) -> Shape:
        """Return the shape turned about an axis through the origin, counterclockwise seen from the axis' tip."""
        return self.transformed(rotation(axis, degrees))

    def scaled(self, factors: ArrayLike) -> Shape:
        """Return the shape stretched from the origin by one positive factor, or by one along each axis."""
        return self.transformed(scaling(factors))

    def mirrored(self, normal: ArrayLike) -> Shape:
        """Return the shape reflected in the plane through the origin across ``normal``."""
        return self.transformed(reflection(normal))

    def __or__(self, other: Shape) -> Union:
        from surfel.shapes.tree import Union

        return Union.joining(self, other)

    def __and__(self, other: Shape) -> Intersection:
        from surfel.shapes.tree import Intersection

        return Intersection.joining(self, other)

    def __sub__(self, other: Shape) -> Difference:
        from surfel.shapes.tree import Difference

        return Difference.joining(self, other)
