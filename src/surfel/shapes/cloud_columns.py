"""The columns of a cloud: what is known at each of its surfels, checked and copied at the door, immutable."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.box import corners
from surfel.core.cast import Floats, as_points, as_rows, read_only
from surfel.core.errors import InputError
from surfel.shapes.columns import as_axes, as_column, as_judge, as_radii, unit

if TYPE_CHECKING:
    from surfel.shapes.clips import Clips


class CloudColumns:
    """What a cloud was given; see :class:`surfel.Surfels`, which adds what is learnt from it."""

    _derived: ClassVar[tuple[str, ...]] = ("_lock",)
    """Attributes that are not given but made, and not pickled."""

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
    ) -> Self:
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

    def _repr_png_(self) -> bytes | None:
        from surfel.shapes.portrait import portrait

        try:
            return portrait(self)
        except (ArithmeticError, ImportError, MemoryError, ValueError):  # a notebook shows the table then
            return None

    def with_solid(self, solid: bool | None) -> Self:
        """Return the same cloud, said to be a solid (True), a sheet (False), or undecided (None)."""
        return self._like(solid=solid)

    def with_judge(self, judge: str | None) -> Self:
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

    def __getitem__(self, rows: Any) -> Self:
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

    def __getstate__(self) -> dict[str, Any]:
        state = {name: value for name, value in self.__dict__.items() if name not in self._derived}
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

    def _like(self, **changes: Any) -> Self:
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
        return type(self)(**{**same, **changes})
