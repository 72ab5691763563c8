"""Surfels: a cloud of points as a shape, immutable, with everything learnt from it kept on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar
from weakref import ref

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.affine import as_affine, is_motion
from surfel.core.cast import Floats, as_choice
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.core.patches import Patches
from surfel.shapes.base import Shape
from surfel.shapes.cloud_columns import CloudColumns
from surfel.shapes.columns import axes_under

if TYPE_CHECKING:
    from surfel.inside.classify import Classifier
    from surfel.inside.operand import Operand
    from surfel.shapes.cloud_surface import CloudSurface

CLOSED_BELOW = 0.02
"""A cloud is closed where a smaller share of the lines that hit than this is odd."""


class Surfels(CloudColumns, Shape):
    """A cloud of surface elements: points, and what is known at each of them.

    Arrays are copied at the door and read-only. Rows whose coordinates are not finite are dropped there and counted
    in ``dropped``. Normals are scaled to unit length; a normal that is zero or not finite means "not known here" and
    is kept as zero. Duplicates stay: what measures a cloud counts them and looks at each place once.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        World coordinates, kept in double precision.
    normals : array_like, shape (n, 3), optional
        Normals of any length and either sign; outward where they are to tell the inside.
    radii : array_like, shape (n,), optional
        Radii of the surfels.
    colors : array_like, shape (n, 3) or (n, 4), optional
        Colors, 0 to 255 in integers (16-bit words: to 65535) or 0 to 1 in floats; the type is kept.
    attributes : mapping of str to array_like of n rows, optional
        Any further values by name (intensity, classification, ...).
    solid : bool, optional
        True: the cloud bounds a solid even where it leaks. False: it is a sheet. None: decided from the leak share.
    provenance : mapping, optional
        Where the cloud came from and what the reader did to it.
    axes : array_like, shape (n, 2, 3), optional
        Half axes of elliptical surfels, in their planes and at right angles to each other.
    clips : Clips, optional
        The planes that cut surfels off; what :func:`surfel.combine` gives its results.
    judge : str, optional
        Which judge tells the inside of this cloud in Boolean operations, ``auto`` included; None leaves it to them.

    Raises
    ------
    InputError
        If a shape does not fit or a value is not a number.

    Examples
    --------
    >>> import numpy as np, surfel
    >>> rng = np.random.default_rng(0)
    >>> p = rng.standard_normal((2000, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> ball = surfel.Surfels(p)
    >>> len(ball), ball.normals is None
    (2000, True)
    """

    _derived: ClassVar[tuple[str, ...]] = ("_lock", "_surface", "_operand", "_classifiers", "_moved_from")
    _surface: CloudSurface | None
    _operand: Operand | None
    _classifiers: dict[str, Classifier]
    _moved_from: tuple[ref[Surfels], Floats] | None

    def _forget(self) -> None:
        """Start with nothing derived."""
        self._surface = None
        self._operand = None
        self._classifiers = {}
        self._moved_from = None

    @property
    def surface(self) -> CloudSurface:
        """What is learnt from the points (spacing, noise, normals, patches), computed once, on first use."""
        with self._lock:
            if self._surface is None:
                from surfel.shapes.cloud_surface import CloudSurface

                if self._clips is None:
                    self._surface = CloudSurface(self._points, self._normals)
                else:
                    self._surface = CloudSurface(self._points + self._clips.places, self._normals, self._clips)
            return self._surface

    @property
    def operand(self) -> Operand:
        """The cloud as the judges of :mod:`surfel.inside` see it, computed once, on first use."""
        with self._lock:
            if self._operand is None:
                from surfel.shapes.judged import operand_of

                self._operand = operand_of(self)
            return self._operand

    @property
    def classifier(self) -> Classifier:
        """What tells the inside of the cloud, by its own judge; built once, on first use."""
        return self._classifier(self._judge or "auto")

    def _classifier(self, judge: str) -> Classifier:
        with self._lock:
            if judge not in self._classifiers:
                from surfel.inside.classify import Classifier

                self._classifiers[judge] = Classifier(self.operand, judge)
            return self._classifiers[judge]

    def cross(
        self, lines: Lines, counter: str = "patches", *, radius_factor: float = 1.5, depth: int = 4,
        cells: str = "line", cylinder: str = "even",
    ) -> Crossings:  # fmt: skip
        """Cross the cloud with lines.

        Parameters
        ----------
        lines : Lines
            The lines, infinite in both directions.
        counter : {"patches", "lpsi", "single"}
            What a hit is. "patches": a hit on the patches of the points, with a weight. "lpsi": a cluster of the points
            in a cylinder round the line, placed at the mean of their projections (Liu et al. 2006, section 3); it
            depends on the normals' signs. "single": the first cluster alone, as Schaufler and Jensen's ray tracer finds
            it (2000).
        radius_factor, depth, cells
            Of the last two, as for :func:`surfel.measure` with ``method="qmca"``.
        cylinder : {"even", "uneven"}
            One radius for all points, or one for each cell of the octree.

        Returns
        -------
        Crossings
            Every hit, sorted along each line.

        Raises
        ------
        InputError
            If an argument cannot be used, or the cloud shows no surface to "lpsi" and "single".

        Examples
        --------
        >>> import numpy as np, surfel
        >>> rng = np.random.default_rng(0)
        >>> p = rng.standard_normal((20000, 3))
        >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
        >>> axis = surfel.Lines.of([[0, 0, 0]], [[0, 0, 1]], 1.0)
        >>> surfel.Surfels(p, normals=p).cross(axis, "lpsi", radius_factor=3.0).t.round(2).tolist()
        [-1.0, 1.0]
        """
        if as_choice(counter, "counter", ("patches", "lpsi", "single")) == "patches":
            return super().cross(lines)
        if not isinstance(lines, Lines):
            raise InputError(f"lines must be a surfel.Lines (see Lines.of); got {type(lines).__name__}")
        from surfel.shapes.lpsi import counter_of

        return counter_of(self, radius_factor, depth, cells, cylinder).cross(lines, single=counter == "single")

    def transformed(self, matrix: ArrayLike) -> Surfels:
        """Return the cloud under an affine map.

        Parameters
        ----------
        matrix : array_like, shape (4, 4)
            The last row is 0 0 0 1. Normals follow by the inverse transpose; radii by the cube root of the volume's
            factor, which is exact for rigid motions and uniform scales.

        Raises
        ------
        InputError
            If the matrix is not affine, not finite or singular.
        """
        affine = as_affine(matrix)
        linear = affine[:3, :3]
        normals = None if self._normals is None else self._normals @ np.linalg.inv(linear)
        radii = None if self._radii is None else self._radii * abs(np.linalg.det(linear)) ** (1.0 / 3.0)
        moved = self._like(
            points=self._points @ linear.T + affine[:3, 3],
            normals=normals,
            radii=radii,
            axes=None if self._axes is None else axes_under(self._axes, linear),
            clips=None if self._clips is None else self._clips.transformed(linear, self._normals),
        )
        if is_motion(affine):
            rest, motion = self._at_rest
            moved._moved_from = (ref(rest), affine @ motion)
        return moved

    @property
    def _at_rest(self) -> tuple[Surfels, Floats]:
        """The cloud that this one is, turned and shifted, while that lives, and the motion; else itself, unmoved.

        What was learnt from that cloud need not be learnt anew.
        """
        if self._moved_from is not None:
            rest = self._moved_from[0]()
            if rest is not None:
                return rest, self._moved_from[1]
        return self, np.eye(4)

    def cropped(self, shape: Shape) -> Surfels:
        """Return the part of the cloud whose points lie inside ``shape``."""
        return self[shape.contains(self._points)]

    def __add__(self, other: Surfels) -> Surfels:
        """Concatenate two clouds; what only one of them knows (colors, radii, an attribute) is left out.

        Colors of one scale stay as they are. Of different scales (floats to 1, 16-bit words to 65535, other integers to
        255) they become floats of 0 to 1. An attribute that is text here and numbers there is left out.
        """
        if not isinstance(other, Surfels):
            return NotImplemented

        from surfel.shapes.cloud_join import both_of

        return both_of(self, other)

    def _hull(self) -> tuple[Floats, float]:
        patches = self.surface.patches
        return patches.points[patches.areas != 0.0], 2.0 * self.surface.spacing

    def _is_sheet(self) -> bool:
        return not self._solid if self._solid is not None else len(self) > 0 and self._is_open()

    def _is_open(self) -> bool:
        from surfel.shapes.cloud_inside import is_open

        return is_open(self)

    @property
    def _inside(self) -> Classifier:
        """What tells the inside of the cloud as lines see it: cleaned, and the signs of its normals made sure of."""
        with self._lock:
            if "cleaned" not in self._classifiers:
                from surfel.shapes.cloud_inside import classifier_of

                self._classifiers["cleaned"] = classifier_of(self)
            return self._classifiers["cleaned"]

    def _cross(self, lines: Lines) -> Crossings:
        return self.surface.cross(lines)

    def _sheets(self, crossings: Crossings) -> Crossings:
        from surfel.shapes.sheets import CloudCrossings

        return crossings.merged() if isinstance(crossings, CloudCrossings) else crossings

    def _pieces(self, lines: Lines, events: Crossings) -> Crossings:
        """Ask a cloud that is known to bound a solid what lies inside along lines that leak: those pass thin edges.

        They hold less than others, so the others cannot stand for them.
        """
        if not self._solid or self._normals is None or self._inside.leaky:
            return events
        from surfel.shapes.cloud_passages import mended

        return mended(self, lines, events)

    def _patches(self, n: int) -> Patches:
        return self.surface.patches

    def _contains(self, points: Floats) -> NDArray[np.bool_]:
        """Answer for a solid: one that was said to be one, or whose leak share tells so."""
        if self._solid is False:
            raise InputError("a cloud that was said to be a sheet (solid=False) has no inside; leave that out")
        if self._solid is None and len(points) and self._is_open():
            raise InputError(
                f"the cloud is open: {self.surface.leak:.1%} of the lines that hit pass an odd number of sheets, so it "
                "has no inside; if it bounds a solid all the same, say so (with_solid(True))"
            )
        return self._inside.classify(points).inside
