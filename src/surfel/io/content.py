"""What a file holds, whatever its format: the one thing that every reader returns and every writer takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats, Integers
from surfel.core.errors import InputError

if TYPE_CHECKING:
    from surfel.shapes.mesh import Mesh
    from surfel.shapes.surfels import Surfels


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
    """

    points: Floats
    triangles: Integers | None = None
    normals: Floats | None = None
    radii: Floats | None = None
    colors: NDArray[Any] | None = None
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def finite(self) -> tuple[Content, int, int]:
        """Return the content without rows that are not finite, and how many points and triangles that cost."""
        if np.isfinite(self.points).all():
            return self, 0, 0
        keep: NDArray[np.bool_] = np.asarray(np.isfinite(self.points).all(axis=1))
        triangles = self.triangles
        lost = 0
        if triangles is not None:
            whole: NDArray[np.bool_] = np.asarray(keep[triangles].all(axis=1))
            lost = int(len(whole) - whole.sum())
            triangles = (np.cumsum(keep) - 1)[triangles[whole]]
        rows = {name: value[keep] for name, value in self.attributes.items()}

        def kept(array: NDArray[Any] | None) -> Any:
            return None if array is None else array[keep]

        content = Content(
            self.points[keep], triangles, kept(self.normals), kept(self.radii), kept(self.colors), rows, self.notes
        )
        return content, int(len(keep) - keep.sum()), lost

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
            return Content(points, None, normals, notes=[*notes, *self._lost_in_mesh()])
        return Content(points, None, normals, self.radii, self.colors, self.attributes, notes)

    def to_surfels(self, provenance: Mapping[str, object]) -> Surfels:
        """Return the points as a cloud."""
        from surfel.shapes.surfels import Surfels

        radii = self.radii
        attributes = self.attributes
        if radii is not None and not (np.isfinite(radii).all() and (radii >= 0.0).all()):
            attributes, radii = {**attributes, "radius": radii}, None
            self.notes.append("radii that are negative or not finite are kept as the attribute 'radius'")
        return Surfels(
            self.points, self.normals, radii, self.colors, attributes,
            provenance={**provenance, "notes": tuple(self.notes)},
        )  # fmt: skip

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
        return Content(
            cloud.points, None, cloud.normals, cloud.radii, cloud.colors, dict(cloud.attributes)
        )  # fmt: skip
    if isinstance(thing, (np.ndarray, list, tuple)):
        return Content(as_points(thing, "points"))
    raise InputError(
        f"surfel.write takes a cloud, a mesh or an array of points (n, 3); got {type(thing).__name__}; "
        "a tree of solids becomes a cloud by surfel.combine(tree).surfels"
    )
