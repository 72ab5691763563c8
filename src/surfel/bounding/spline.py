"""A safe spline: a smooth height function over a plane, with every point of a cloud on one side."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike, NDArray

from surfel.bounding.height_spline import HeightSpline

if TYPE_CHECKING:
    import numpy as np

    from surfel.bounding.sheet import SplineSheet
    from surfel.core.crossings import Crossings


@dataclass(frozen=True, eq=False)
class SafeSpline(HeightSpline):
    """A bicubic tensor-product B-spline over the plane across a direction, safe for the points it was fitted to.

    Made by :func:`surfel.bound`; immutable. The graph is ``{(u, v, F(u, v))}`` in the coordinates of ``frame``. What is
    read of it as a function is inherited; here is what it knows of its points, of rays and of files.

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

    def __repr__(self) -> str:
        n, m = self.shape
        return (
            f"SafeSpline({n} x {m}, {self.boundary}, {self.side} {self.report.points} points, "
            f"mean gap {self.report.gap_mean:.3g})"
        )

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
            Points that the surface bounds, bit for bit as they were given; they are found again however often the grid
            has grown. To name others makes what is remembered wrong where that cannot be noticed.

        Raises
        ------
        InputError
            If some cannot be among the points (beyond the grid, more in a micro-cell than it holds, beyond all that it
            holds, or the last of a micro-cell while that of its largest residual was not named), or none would be left.
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

    def intersect(self, rays: Any, which: str = "first") -> Crossings:
        """Find where rays meet the trimmed surface.

        Along a ray the height of a cell is a polynomial of degree six. Its zeros are found in Bernstein form by
        cutting it into monotone parts, and a safeguarded Halley's method; places where a ray only touches the
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

    def sheet(self) -> SplineSheet:
        """Return the trimmed surface as a shape: what lines cross, what has patches and an area."""
        return self._sheet

    @cached_property
    def _sheet(self) -> SplineSheet:
        from surfel.bounding.sheet import SplineSheet

        return SplineSheet(self)

    def plot(self, points: ArrayLike) -> Any:
        """Return a figure of matplotlib (extra ``plot``): the surface over some points, and slices through both.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Some of the points that it bounds.

        Raises
        ------
        MissingExtraError
            If matplotlib is not installed.
        """
        from surfel.bounding.figures import plot_spline
        from surfel.core.cast import as_points

        return plot_spline(self, as_points(points))

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
