"""What a file holds, whatever its format: the one thing that every reader returns and every writer takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats, Integers
from surfel.core.errors import InputError
from surfel.io.clip_columns import AREA, clips_from, columns_of

if TYPE_CHECKING:
    from surfel.shapes.mesh import Mesh
    from surfel.shapes.surfels import Surfels


@dataclass(frozen=True)
class Frame:
    """How and where coordinates were stored, so that writing gives back the last stored digit.

    Parameters
    ----------
    scale, offset : tuple of three floats, optional
        Where whole numbers are stored: world = stored * scale + offset.
    crs : str
        The coordinate reference system as text (WKT, or an authority's code); empty where it is not known.
    extra : mapping of str to object
        What only the format itself understands, by its name.
    """

    scale: tuple[float, float, float] | None = None
    offset: tuple[float, float, float] | None = None
    crs: str = ""
    extra: Mapping[str, object] = field(default_factory=dict)


@dataclass
class Head:
    """What the header of a file tells without its points; None and False where it does not say.

    Parameters
    ----------
    points, triangles : int, optional
        How many there are.
    bounds : ndarray of float64, shape (2, 3), optional
        The lowest and the highest corner.
    normals, radii, colors : bool
        Whether there are any.
    attributes : list of str
        The names of all further values of a point.
    frame : Frame, optional
        How coordinates are stored.
    notes : list of str
        What has to be said.
    facts : dict of str to object
        Further facts for ``info``, in plain Python values.
    """

    points: int | None = None
    normals: bool = False
    bounds: Floats | None = None
    radii: bool = False
    colors: bool = False
    attributes: list[str] = field(default_factory=list)
    triangles: int | None = None
    frame: Frame | None = None
    notes: list[str] = field(default_factory=list)
    facts: dict[str, object] = field(default_factory=dict)


@dataclass
class Content:
    """Points or the vertices of a mesh, with all that a file says about them.

    Parameters
    ----------
    points : ndarray of float64, shape (n, 3)
        Points or vertices, as stored: rows that are not finite included.
    triangles : ndarray of int64, shape (m, 3), optional
        None where the file has no faces; every entry names a row of ``points``.
    normals, radii, colors : ndarray of n rows, optional
        As stored; normals and radii in float64, colors in the type of the file.
    attributes : dict of str to ndarray of n rows
        Any further value of a point, by its name in the file.
    notes : list of str
        What was left out or decided while reading, for the provenance.
    frame : Frame, optional
        How the coordinates were stored, and in which reference system.
    """

    points: Floats
    triangles: Integers | None = None
    normals: Floats | None = None
    radii: Floats | None = None
    colors: NDArray[Any] | None = None
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    frame: Frame | None = None

    def finite(self) -> tuple[Content, int, int]:
        """Return the content without rows that are not finite, and how many points and triangles that cost."""
        if _all_finite(self.points):
            return self, 0, 0
        keep: NDArray[np.bool_] = np.asarray(np.isfinite(self.points).all(axis=1))
        content, lost = self.with_points(keep)
        return content, int(len(keep) - keep.sum()), lost

    def with_points(self, keep: NDArray[np.bool_]) -> tuple[Content, int]:
        """Return the content with the chosen points and the triangles between them, and how many triangles are lost."""
        content = self.rows(keep)
        if self.triangles is None:
            return content, 0
        whole: NDArray[np.bool_] = np.asarray(keep[self.triangles].all(axis=1))
        content.triangles = (np.cumsum(keep) - 1)[self.triangles[whole]]
        return content, int(len(whole) - whole.sum())

    def rows(self, keep: NDArray[np.bool_] | slice) -> Content:
        """Return the chosen points with all that is known at them, without triangles."""

        def kept(array: NDArray[Any] | None) -> Any:
            return None if array is None else array[keep]

        attributes = {name: value[keep] for name, value in self.attributes.items()}
        return Content(
            self.points[keep], None, kept(self.normals), kept(self.radii), kept(self.colors), attributes, self.notes,
            self.frame,
        )  # fmt: skip

    def as_points(self) -> Content:
        """Return the points alone; of a mesh its used vertices with their area-weighted normals."""
        if self.triangles is None:
            return self
        points, normals = self.to_mesh().vertex_points()
        notes = [*self.notes, f"the vertices of {len(self.triangles)} triangles were taken as points"]
        if self.normals is not None:
            notes.append("stored vertex normals gave way to area-weighted ones")
        if len(points) != len(self.points):
            notes.append(f"{len(self.points) - len(points)} vertices that no triangle uses were left out")
            return Content(points, None, normals, notes=[*notes, *self._lost_in_mesh()], frame=self.frame)
        return Content(points, None, normals, self.radii, self.colors, self.attributes, notes, self.frame)

    def to_surfels(self, provenance: Mapping[str, object]) -> Surfels:
        """Return the points, all of them finite, as a cloud that takes over the arrays."""
        from surfel.shapes.surfels import Surfels

        radii = self.radii
        attributes = self.attributes
        if radii is not None and not (np.isfinite(radii).all() and (radii >= 0.0).all()):
            attributes, radii = {**attributes, "radius": radii}, None
            self.notes.append("radii that are negative or not finite are kept as the attribute 'radius'")
        told: dict[str, object] = {**provenance, "notes": tuple(self.notes)}
        if self.frame is not None:
            told |= {"frame": self.frame} | ({"crs": self.frame.crs} if self.frame.crs else {})
        normals = None if self.normals is None else _units(self.normals)
        clips = None
        if AREA in attributes:
            clips, attributes = clips_from(attributes)
        cloud = Surfels._adopted(self.points, normals, radii, self.colors, attributes, told)
        cloud._clips = clips
        return cloud

    def to_mesh(self) -> Mesh:
        """Return the mesh."""
        from surfel.shapes.mesh import Mesh

        if self.triangles is None:
            raise InputError("there are no triangles to make a mesh of")
        return Mesh(self.points, self.triangles, self.colors)

    def in_single_precision(self, name: str, lost: list[str]) -> NDArray[np.float32]:
        """Return the points as a format stores them that has no double precision, and say if that changes them.

        Raises
        ------
        InputError
            If a coordinate is too large.
        """
        if len(self.points) and np.abs(self.points).max() > np.finfo(np.float32).max:
            raise InputError(f"{name} holds single precision, and a coordinate is larger; write .ply, which has double")
        single = np.ascontiguousarray(self.points, "<f4")
        if (single != self.points).any():
            lost.append("coordinates beyond single precision")
        return single

    def lost_without(self, *held: str) -> list[str]:
        """Return what of this content a format cannot keep that holds only the parts named in ``held``."""
        lost = [
            f"{name} of {len(self.points)} points"
            for name in ("normals", "radii", "colors")
            if name not in held and getattr(self, name) is not None
        ]
        if "attributes" not in held:
            lost += [f"attribute {name!r}" for name in self.attributes]
        if "triangles" not in held and self.triangles is not None:
            lost.append(f"{len(self.triangles)} triangles")
        return lost

    def _lost_in_mesh(self) -> list[str]:
        return [f"left out: {what}" for what in self.lost_without("normals", "triangles")]


def content_of(thing: object) -> Content:
    """Return what can be written of a cloud, a mesh or an array of points.

    Raises
    ------
    InputError
        If it is none of these.
    """
    from surfel.core.cast import as_points

    if hasattr(thing, "vertices") and hasattr(thing, "triangles"):
        mesh: Any = thing
        return Content(mesh.vertices, np.asarray(mesh.triangles, np.int64), colors=getattr(mesh, "colors", None))
    if hasattr(thing, "points") and hasattr(thing, "attributes"):
        cloud: Any = thing
        clips = getattr(cloud, "clips", None)
        attributes = {**cloud.attributes, **({} if clips is None else columns_of(clips))}
        return Content(cloud.points, None, cloud.normals, cloud.radii, cloud.colors, attributes, frame=_frame_of(cloud))
    if isinstance(thing, (np.ndarray, list, tuple)):
        return Content(as_points(thing, "points"))
    raise InputError(
        f"surfel.write takes a cloud, a mesh or an array of points (n, 3); got {type(thing).__name__}; "
        "a tree of solids is written as .csg, or becomes a cloud by surfel.sample(tree, n)"
    )


def _frame_of(cloud: Any) -> Frame | None:
    frame = getattr(cloud, "provenance", {}).get("frame")
    return frame if isinstance(frame, Frame) else None


def _all_finite(points: Floats) -> bool:
    """Tell whether all is finite, a run at a time: no array as large as the points is made."""
    return all(bool(np.isfinite(points[first : first + _RUN]).all()) for first in range(0, len(points), _RUN))


_RUN = 1 << 15


def _units(normals: Floats) -> Floats:
    """Scale normals to unit length where they lie, a run at a time: what is worked on stays in the cache."""
    from surfel.io.parts import in_parts
    from surfel.shapes.columns import UNIT, unit

    if not normals.flags.writeable:
        normals = normals.copy()

    def scale(first: int, last: int) -> None:
        x, y, z = normals[first:last].T
        square = x * x
        square += y * y
        square += z * z
        if not (np.isfinite(square).all() and square.min(initial=1.0) > 1e-200):
            normals[first:last] = unit(normals[first:last])  # which takes care of what is missing or overflows
            return
        factor = np.sqrt(square)
        np.divide(1.0, factor, out=factor)
        square -= 1.0
        factor[np.abs(square, out=square) <= UNIT] = 1.0
        x *= factor
        y *= factor
        z *= factor

    in_parts(scale, len(normals), _RUN)
    return normals
