"""A spline as a function over a plane: heights, derivatives, bounds and where it is trimmed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.bounding.report import FitReport
from surfel.core.cast import Floats, as_points, read_only
from surfel.core.errors import InputError

if TYPE_CHECKING:
    from surfel.bounding.frame import Frame
    from surfel.bounding.memory import Memory
    from surfel.bounding.occupancy import Quarters


@dataclass(frozen=True, eq=False)
class HeightSpline:
    """A bicubic tensor-product B-spline over the plane across a direction: what can be read of it at places.

    The graph is ``{(u, v, F(u, v))}`` in the coordinates of ``frame``.

    Parameters
    ----------
    frame : Frame
        The grid and the direction.
    coefficients : Floats, shape (n + 2, m + 2)
        Uniform cubic B-spline coefficients with knots ``-3 .. n + 2`` and ``-3 .. m + 2``, along u and v.
    side : str
        ``above``: every point lies at or below the surface. ``below``: at or above it.
    boundary : str
        ``open``, or ``clamped`` (the outermost coefficients repeat their neighbours, as in the paper).
    occupancy, trim : Quarters, shape (n - 1, m - 1)
        Which quarters of the cells have data, and which the trimmed surface keeps.
    report : FitReport
        How it was made and how close it lies.
    memory : Memory, optional
        What is remembered of the points, so that points can come and go and the surface be fitted again.
    """

    frame: Frame
    coefficients: Floats
    side: str
    boundary: str
    occupancy: Quarters
    trim: Quarters
    report: FitReport
    memory: Memory | None = None

    def __post_init__(self) -> None:
        for name in ("coefficients", "occupancy", "trim"):
            object.__setattr__(self, name, read_only(np.array(getattr(self, name), order="C")))

    @property
    def shape(self) -> tuple[int, int]:
        """Coefficients along u and v of the clamped form; the cells are one fewer."""
        return self.frame.shape

    @property
    def direction(self) -> Floats:
        """The unit vector along which heights are measured."""
        return self.frame.direction

    def to_domain(self, points: ArrayLike) -> tuple[Floats, Floats]:
        """Return the domain coordinates (in cells) and the heights along the direction of points of space.

        Parameters
        ----------
        points : array_like, shape (k, 3)
            World coordinates.

        Returns
        -------
        uv : Floats, shape (k, 2)
            The domain is ``[0, n - 1] x [0, m - 1]``.
        heights : Floats, shape (k,)
            In the units of the points; along (0, 0, 1) they are z itself.
        """
        return self.frame.to_domain(points)

    def __call__(self, places: ArrayLike, *, trimmed: bool = True) -> Floats:
        """Return the height of the surface.

        Parameters
        ----------
        places : array_like, shape (k, 2) or (k, 3)
            Domain coordinates, or points of space over (or under) which the height is wanted.
        trimmed : bool
            Outside the trimmed region the surface says nothing about the points; by default the height is NaN there.
            False gives the spline's value all over the domain.

        Returns
        -------
        Floats, shape (k,)
            Heights along the direction; NaN outside.
        """
        from surfel.bounding.evaluate import values
        from surfel.bounding.occupancy import trimmed_values

        uv = self._places(places)
        return trimmed_values(self.coefficients, self.trim, uv) if trimmed else values(self.coefficients, uv)

    def _places(self, places: ArrayLike) -> Floats:
        from surfel.bounding.frame import as_domain

        array = np.asarray(places)
        if array.ndim == 2 and array.shape[1] == 3:
            return self.frame.to_domain(as_points(array, "places", finite=False))[0]
        if array.ndim != 2 and array.size:
            raise InputError(
                f"places must have shape (k, 2) for domain coordinates or (k, 3) for points; got {array.shape}"
            )
        return as_domain(array)

    def verify(self, points: Any) -> tuple[int, float]:
        """Count the points on the wrong side, by the same kernel that evaluates the surface.

        Parameters
        ----------
        points : array_like of shape (k, 3), a cloud, or an iterable of these
            World coordinates.

        Returns
        -------
        violations : int
            How many points lie on the wrong side. A point outside the trimmed region is one.
        worst : float
            By how much the worst of them does, in the units of the points: 0 where none does, infinite for a point
            outside.
        """
        from surfel.bounding.certify import violations
        from surfel.bounding.source import chunks_of

        count, worst = 0, 0.0
        for chunk in chunks_of(points):
            found, much = violations(self.frame, self.coefficients, self.trim, chunk, self.side)
            count, worst = count + found, max(worst, much)
        return count, worst

    def difference(self, other: HeightSpline, places: ArrayLike | None = None) -> Floats:
        """Return how much higher another surface lies, as at another time.

        Parameters
        ----------
        other : HeightSpline
            A surface along the same direction; its grid may be another one.
        places : array_like, shape (k, 2) or (k, 3), optional
            Domain coordinates of this surface, or points; by default the corners of this surface's grid.

        Returns
        -------
        Floats, shape (k,), or (n, m) for the corners
            Height of the other surface less that of this one; NaN where either says nothing.

        Raises
        ------
        InputError
            If the directions differ.
        """
        from surfel.bounding.evolve import heights_between

        return heights_between(self, other, places)

    def gradient(self, places: ArrayLike, *, trimmed: bool = True) -> Floats:
        """Return the first derivatives of the height with respect to u and v.

        Parameters
        ----------
        places : array_like, shape (k, 2) or (k, 3)
            Domain coordinates, or points of space.
        trimmed : bool
            NaN outside the trimmed region; False gives derivatives all over the domain.

        Returns
        -------
        Floats, shape (k, 2)
            Units of height a cell; times ``frame.scale`` they are slopes along the first two rows of
            ``frame.rotation``.
        """
        from surfel.bounding.geometry import derivatives_at

        return np.ascontiguousarray(derivatives_at(self, self._places(places), trimmed)[:, 1:3])

    def hessian(self, places: ArrayLike, *, trimmed: bool = True) -> Floats:
        """Return the second derivatives with respect to u and v, shape (k, 2, 2); see :meth:`gradient`."""
        from surfel.bounding.geometry import hessian_at

        return hessian_at(self, self._places(places), trimmed)

    def normal(self, places: ArrayLike, *, trimmed: bool = True) -> Floats:
        """Return unit normals of the surface in world coordinates, on the side without points, shape (k, 3)."""
        from surfel.bounding.geometry import normal_at

        return normal_at(self, self._places(places), trimmed)

    def bounds(self, cell: tuple[int, int]) -> tuple[float, float]:
        """Return two heights between which the surface lies over the cell [h, h + 1] x [k, k + 1], given as (h, k).

        They are the least and the largest Bezier coefficient of the cell, rounded outwards.

        Raises
        ------
        InputError
            If there is no such cell.
        """
        from surfel.bounding.geometry import bounds_of_cell

        return bounds_of_cell(self, cell)

    def trim_mask(self, places: ArrayLike) -> NDArray[np.bool_]:
        """Tell which places the trimmed surface answers for: every point that it bounds lies over one of these.

        Parameters
        ----------
        places : array_like, shape (k, 2) or (k, 3)
            Domain coordinates, or points of space.

        Returns
        -------
        NDArray[np.bool_], shape (k,)
            False outside.
        """
        from surfel.bounding.geometry import mask_of

        return mask_of(self, self._places(places))

    def trim_polygons(self) -> list[Floats]:
        """Return the polygons that bound the trimmed region: along cells and their diagonals (sec. 6, Fig. 7).

        Returns
        -------
        list of Floats, shape (k, 2)
            Corners in domain coordinates, the first not repeated; outer borders counterclockwise, holes clockwise.
        """
        from surfel.bounding.trim import outlines

        return outlines(self.trim)

    def to_scipy(self) -> Any:
        """Return the spline as a :class:`scipy.interpolate.NdBSpline` over its domain (u, v), NaN outside that."""
        from surfel.bounding.export import to_scipy

        return to_scipy(self)
