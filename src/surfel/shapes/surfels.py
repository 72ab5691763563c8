"""Surfels: a cloud of points as a shape, immutable, with everything learnt from it kept on first use."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.affine import as_affine
from surfel.core.box import corners
from surfel.core.cast import Floats, as_choice, as_points, as_rows, read_only
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.core.patches import Patches
from surfel.shapes.base import Shape
from surfel.shapes.columns import as_axes, as_column, as_judge, as_radii, axes_under, on_one_scale, unit

if TYPE_CHECKING:
    from surfel.inside.classify import Classifier
    from surfel.inside.operand import Operand
    from surfel.shapes.clips import Clips
    from surfel.shapes.cloud_surface import CloudSurface

CLOSED_BELOW = 0.02
"""A cloud is closed where a smaller share of the lines that hit than this is odd."""


class Surfels(Shape):
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

    _surface: CloudSurface | None
    _operand: Operand | None
    _classifiers: dict[str, Classifier]

    def __init__(
        self,
        points: ArrayLike,
        normals: ArrayLike | None = None,
        radii: ArrayLike | None = None,
        colors: ArrayLike | None = None,
        attributes: Mapping[str, ArrayLike] | None = None,
        solid: bool | None = None,
        provenance: Mapping[str, object] | None = None,
        axes: ArrayLike | None = None,
        clips: Clips | None = None,
        judge: str | None = None,
    ) -> None:
        place = as_points(points, finite=False)
        rows = len(place)
        everything = bool(np.isfinite(place).all())
        keep = slice(None) if everything else np.isfinite(place).all(axis=1)

        def kept(array: NDArray[Any]) -> NDArray[Any]:
            return read_only(np.array(array[keep], order="C"))

        self._points = kept(place)
        self._normals = None if normals is None else kept(unit(as_rows(normals, "normals", rows)))
        self._radii = None if radii is None else kept(as_radii(radii, rows))
        self._colors = None if colors is None else kept(as_column(colors, "colors", rows))
        if self._colors is not None and (self._colors.ndim != 2 or self._colors.shape[1] not in (3, 4)):
            raise InputError(f"colors must have shape ({rows}, 3) or ({rows}, 4); got {np.shape(np.asarray(colors))}")
        self._attributes = MappingProxyType(
            {
                str(name): kept(as_column(value, f"attribute {name!r}", rows))
                for name, value in (attributes or {}).items()
            }
        )
        if not (solid is None or isinstance(solid, bool | np.bool_)):
            raise InputError(f"solid must be True, False or None; got {solid!r}")
        self._solid = None if solid is None else bool(solid)
        self._provenance = MappingProxyType(dict(provenance or {}))
        self._axes = None if axes is None else kept(as_axes(axes, rows))
        if not (clips is None or len(clips) == rows):
            raise InputError(f"clips must have one row for each of the {rows} points; got {len(clips)}")
        self._clips = clips if clips is None or everything else clips[keep]
        self._judge = None if judge is None else as_judge(judge)
        self._dropped = rows - len(self._points)
        self._lock = threading.RLock()
        self._forget()

    @classmethod
    def _adopted(
        cls,
        points: Floats,
        normals: Floats | None,
        radii: Floats | None,
        colors: NDArray[Any] | None,
        attributes: Mapping[str, NDArray[Any]],
        provenance: Mapping[str, object],
    ) -> Surfels:
        """Take valid arrays that nobody else holds without a copy: finite points, normals that are unit or zero.

        Readers hand over clouds so; what is checked and copied at the public door is known of them.
        """
        cloud = cls(np.empty((0, 3)), provenance=provenance)

        def owned(array: NDArray[Any]) -> NDArray[Any]:
            return read_only(np.ascontiguousarray(array))

        cloud._points = owned(points)
        cloud._normals = None if normals is None else owned(normals)
        cloud._radii = None if radii is None else owned(radii)
        cloud._colors = None if colors is None else owned(colors)
        cloud._attributes = MappingProxyType({str(name): owned(value) for name, value in attributes.items()})
        return cloud

    @property
    def points(self) -> Floats:
        """World coordinates, shape (n, 3), read-only."""
        return self._points

    @property
    def normals(self) -> Floats | None:
        """Unit normals as given, zero where unknown, shape (n, 3); None where none were given."""
        return self._normals

    @property
    def radii(self) -> Floats | None:
        """Radii as given, shape (n,), or None."""
        return self._radii

    @property
    def colors(self) -> NDArray[Any] | None:
        """Colors as given, shape (n, 3) or (n, 4), or None."""
        return self._colors

    @property
    def attributes(self) -> Mapping[str, NDArray[Any]]:
        """Any further values, by name."""
        return self._attributes

    @property
    def solid(self) -> bool | None:
        """Whether the cloud was said to bound a solid."""
        return self._solid

    @property
    def axes(self) -> Floats | None:
        """Half axes of elliptical surfels, shape (n, 2, 3), or None."""
        return self._axes

    @property
    def clips(self) -> Clips | None:
        """The planes that cut surfels off, or None where nothing was cut."""
        return self._clips

    @property
    def judge(self) -> str | None:
        """Which judge tells the inside of this cloud in Boolean operations; None where that was not said."""
        return self._judge

    @property
    def provenance(self) -> Mapping[str, object]:
        """Where the cloud came from."""
        return self._provenance

    @property
    def dropped(self) -> int:
        """How many rows were dropped at the door because a coordinate was not finite."""
        return self._dropped

    @property
    def bounds(self) -> Floats:
        """The lowest and the highest corner, shape (2, 3)."""
        if len(self) == 0:
            raise InputError("an empty cloud has no bounds")
        return corners(self._points)

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
        return self._like(
            points=self._points @ linear.T + affine[:3, 3],
            normals=normals,
            radii=radii,
            axes=None if self._axes is None else axes_under(self._axes, linear),
            clips=None if self._clips is None else self._clips.transformed(linear, self._normals),
        )

    def cropped(self, shape: Shape) -> Surfels:
        """Return the part of the cloud whose points lie inside ``shape``."""
        return self[shape.contains(self._points)]

    def with_solid(self, solid: bool | None) -> Surfels:
        """Return the same cloud, said to be a solid (True), a sheet (False), or undecided (None)."""
        return self._like(solid=solid)

    def with_judge(self, judge: str | None) -> Surfels:
        """Return the same cloud, its inside told by a judge in Boolean operations.

        Parameters
        ----------
        judge : str or None
            One of ``auto``, ``sheets``, ``nearest``, ``two-nearest``, ``two-cluster``, ``imls``, ``mls``, ``winding``,
            ``indicator`` and ``brute``; None leaves it to the operation.

        Raises
        ------
        InputError
            If there is no judge of that name.
        """
        return self._like(judge=judge)

    def __getitem__(self, rows: Any) -> Surfels:
        """Return the chosen rows (a mask, a slice, or row numbers) with all that is known at them."""
        if isinstance(rows, int | np.integer):
            row = range(len(self))[rows]  # an IndexError past the end, which ends a loop over the cloud
            rows = slice(row, row + 1)
        return self._like(
            points=self._points[rows],
            normals=None if self._normals is None else self._normals[rows],
            radii=None if self._radii is None else self._radii[rows],
            colors=None if self._colors is None else self._colors[rows],
            attributes={name: value[rows] for name, value in self._attributes.items()},
            axes=None if self._axes is None else self._axes[rows],
            clips=None if self._clips is None else self._clips[rows],
        )

    def __add__(self, other: Surfels) -> Surfels:
        """Concatenate two clouds; what only one of them knows (colors, radii, an attribute) is left out.

        Colors of one scale stay as they are. Of different scales (floats to 1, 16-bit words to 65535, other integers to
        255) they become floats of 0 to 1. An attribute that is text here and numbers there is left out.
        """
        if not isinstance(other, Surfels):
            return NotImplemented

        def joined(a: NDArray[Any] | None, b: NDArray[Any] | None) -> NDArray[Any] | None:
            if a is None or b is None or a.shape[1:] != b.shape[1:] or (a.dtype.kind in "US") != (b.dtype.kind in "US"):
                return None
            return np.concatenate([a, b])

        both = {k: joined(v, other.attributes.get(k)) for k, v in self._attributes.items()}
        return Surfels(
            np.concatenate([self._points, other.points]),
            joined(self._normals, other.normals),
            joined(self._radii, other.radii),
            joined(*on_one_scale(self._colors, other.colors)),
            {k: v for k, v in both.items() if v is not None},
            self._solid if self._solid == other.solid else None,
            axes=joined(self._axes, other.axes),
            clips=None if self._clips is None and other.clips is None else _clips(self).joined(_clips(other)),
            judge=self._judge if self._judge == other.judge else None,
        )

    def __len__(self) -> int:
        return len(self._points)

    def __repr__(self) -> str:
        known = [name for name in ("normals", "radii", "colors") if getattr(self, name) is not None]
        return f"Surfels({len(self):,} points" + "".join(f", {name}" for name in [*known, *self._attributes]) + ")"

    def _repr_html_(self) -> str:
        from html import escape

        cells = [("points", f"{len(self):,}")]
        if len(self):
            low, high = (", ".join(f"{value:.6g}" for value in corner) for corner in self.bounds)
            cells += [("from", low), ("to", high)]
        known = [name for name in ("normals", "radii", "colors") if getattr(self, name) is not None]
        cells += [("known", ", ".join([*known, *self._attributes]) or "places alone")]
        return "<table>" + "".join(f"<tr><th>{k}</th><td>{escape(v)}</td></tr>" for k, v in cells) + "</table>"

    def __getstate__(self) -> dict[str, Any]:
        derived = ("_lock", "_surface", "_operand", "_classifiers")
        state = {name: value for name, value in self.__dict__.items() if name not in derived}
        for name in ("_attributes", "_provenance"):
            state[name] = dict(state[name])
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for name in ("_attributes", "_provenance"):
            setattr(self, name, MappingProxyType(state[name]))
        for array in (self._points, self._normals, self._radii, self._colors, self._axes, *self._attributes.values()):
            if array is not None:
                read_only(array)
        self._lock = threading.RLock()
        self._forget()

    def _forget(self) -> None:
        """Start with nothing derived."""
        self._surface = None
        self._operand = None
        self._classifiers = {}

    def _like(self, **changes: Any) -> Surfels:
        same = {
            name: getattr(self, f"_{name}")
            for name in (
                "points",
                "normals",
                "radii",
                "colors",
                "attributes",
                "solid",
                "provenance",
                "axes",
                "clips",
                "judge",
            )
        }
        return Surfels(**{**same, **changes})

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


def _clips(cloud: Surfels) -> Clips:
    """Return the clips of a cloud; of one that was not cut, none for each surfel, and its whole patches."""
    from surfel.shapes.clips import Clips

    if cloud.clips is not None:
        return cloud.clips
    return Clips(np.zeros(len(cloud) + 1, np.int64), np.empty((0, 4)), areas=lambda: cloud.surface.patches.areas)
