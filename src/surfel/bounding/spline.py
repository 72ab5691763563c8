"""A safe spline: a smooth height function over a plane, with every point of a cloud on one side."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from os import PathLike
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
    from surfel.bounding.sheet import SplineSheet
    from surfel.core.crossings import Crossings


@dataclass(frozen=True, eq=False)
class SafeSpline:
    """A bicubic tensor-product B-spline over the plane across a direction, safe for the points it was fitted to.

    Made by :func:`surfel.bound`; immutable. The graph is ``{(u, v, F(u, v))}`` in the coordinates of ``frame``.

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

    def __repr__(self) -> str:
        n, m = self.shape
        return (
            f"SafeSpline({n} x {m}, {self.boundary}, {self.side} {self.report.points} points, "
            f"mean gap {self.report.gap_mean:.3g})"
        )

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

    def inserted(self, points: Any) -> SafeSpline:
        """Return a surface that bounds some points more, raised over them by as little as it takes.

        Where they reach beyond the grid it grows by whole cells.

        Parameters
        ----------
        points : array_like of shape (k, 3), a cloud, or chunks
            World coordinates.

        Returns
        -------
        SafeSpline
            Safe for the old and the new points. Its report's ``gap_max`` is an upper bound.

        Raises
        ------
        InputError
            If points are not finite, or so far away that the grid would have more than 4096 cells a side.

        Examples
        --------
        >>> import numpy as np, surfel
        >>> p = np.random.default_rng(0).random((1000, 3))
        >>> lid = surfel.bound(p[:900], shape=(8, 8)).inserted(p[900:])
        >>> lid.verify(p), lid.report.points
        ((0, 0.0), 1000)
        """
        from surfel.bounding.evolve import with_points

        return with_points(self, points)

    def removed(self, points: Any) -> SafeSpline:
        """Return the surface with some of its points forgotten; :meth:`refitted` can then bring it closer.

        The surface itself stays as it is, which is safe. Only the number of points of each micro-cell (4 x 4 a cell) is
        remembered, so a new fit gains where the last point of a micro-cell is gone.

        Parameters
        ----------
        points : array_like of shape (k, 3), a cloud, or chunks
            Points that the surface bounds: to name others makes what is remembered wrong.

        Raises
        ------
        InputError
            If a micro-cell does not hold as many points, or none would be left.
        """
        from surfel.bounding.evolve import without_points

        return without_points(self, points)

    def refitted(self) -> SafeSpline:
        """Return a new fit from what the surface remembers, safe for all its points, without looking at them.

        Remembered are, for every micro-cell, the number of points, the largest residual beside a reference spline and
        the point that has it. See :class:`surfel.bounding.memory.Memory`.
        """
        from surfel.bounding.evolve import fitted_again

        return fitted_again(self)

    def difference(self, other: SafeSpline, places: ArrayLike | None = None) -> Floats:
        """Return how much higher another surface lies, as at another time.

        Parameters
        ----------
        other : SafeSpline
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

    def intersect(self, rays: Any, which: str = "first") -> Crossings:
        """Find where rays meet the trimmed surface.

        Along a ray the height of a cell is a polynomial of degree six. Its zeros are found in Bernstein form by
        cutting it into monotone parts, and a safeguarded Newton's method; places where a ray only touches the
        surface are included, once each.

        Parameters
        ----------
        rays : pair of array_like, each of shape (m, 3), or Lines
            Origins and directions (of any length but zero). A ray begins at its origin.
        which : {"first", "all"}
            The first hit of each ray, or all.

        Returns
        -------
        Crossings
            ``t`` is the distance from the origin, ascending along each ray; ``lines`` says which ray a hit is of,
            ``cosine`` is direction . normal. A ray that misses has no hit.

        Raises
        ------
        InputError
            If the rays are not finite, or a direction is zero.

        Examples
        --------
        >>> import numpy as np, surfel
        >>> lid = surfel.bound(np.random.default_rng(0).random((1000, 3)), shape=(6, 6))
        >>> hits = lid.intersect(([[0.5, 0.5, 9.0]], [[0.0, 0.0, -1.0]]))
        >>> bool(abs(9.0 - hits.t[0] - lid([[0.5, 0.5, 0.0]])[0]) < 1e-12)
        True
        """
        from surfel.bounding.geometry import intersect_rays

        return intersect_rays(self, rays, which)

    def occludes(self, rays: Any, length: ArrayLike | None = None) -> NDArray[np.bool_]:
        """Tell which rays the trimmed surface stops.

        Parameters
        ----------
        rays : pair of array_like, each of shape (m, 3), or Lines
            Origins and directions.
        length : float or array_like, shape (m,), optional
            How far each ray reaches; by default without end.

        Returns
        -------
        NDArray[np.bool_], shape (m,)
            True where the ray meets the surface within its length.

        Raises
        ------
        InputError
            If the rays are not finite, a direction is zero or a length is negative.
        """
        from surfel.bounding.geometry import are_occluded

        return are_occluded(self, rays, length)

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

    def sheet(self) -> SplineSheet:
        """Return the trimmed surface as a shape: what lines cross, what has patches and an area."""
        return self._sheet

    @cached_property
    def _sheet(self) -> SplineSheet:
        from surfel.bounding.sheet import SplineSheet

        return SplineSheet(self)

    def to_scipy(self) -> Any:
        """Return the spline as a :class:`scipy.interpolate.NdBSpline` over its domain (u, v), NaN outside that."""
        from surfel.bounding.export import to_scipy

        return to_scipy(self)

    def to_3dm(self, path: str | PathLike[str]) -> None:
        """Write the surface as an exact NURBS surface, and the outlines of its trim, to a 3DM file (extra ``cad``).

        All numbers are float64. The surface is moved outwards by some units in the last place, so that it stays safe
        when its control points are rounded; what was written is read back and verified.

        Parameters
        ----------
        path : str or path-like
            The file; an old one is replaced at once or left as it was.

        Raises
        ------
        MissingExtraError
            If rhino3dm is not installed.
        InputError
            If the file cannot be written.
        """
        from surfel.bounding.export import to_3dm

        to_3dm(self, path)

    def save(self, path: str | PathLike[str]) -> None:
        """Write everything to an NPZ file that :meth:`load` reads; an old file is replaced at once or left as it was.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        from surfel.bounding.stored import save

        save(self, path)

    @staticmethod
    def load(path: str | PathLike[str]) -> SafeSpline:
        """Read a file that :meth:`save` wrote.

        Raises
        ------
        InputError
            If the file cannot be opened.
        FileFormatError
            If it is cut, changed or something else.
        """
        from surfel.bounding.stored import load

        return load(path)
