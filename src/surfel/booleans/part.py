"""Part: the surfels of one leaf, in the order of their index; those of an exact solid are sampled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.cells import cell_areas, cells_of, frames_of
from surfel.core.cast import Floats
from surfel.inside.operand import Operand
from surfel.shapes.surfels import Surfels

RADIUS = 1.0
"""Radius of the disk of a surfel that brings none, in spacings."""


@dataclass(frozen=True, eq=False)
class Part:
    """The surfels of a leaf.

    Parameters
    ----------
    leaf : int
        Which one.
    cloud : Surfels
        They themselves, in the order in which they were given.
    operand : Operand
        The same in the order of their index, with flipped normals turned.
    exact : bool
        Whether they were drawn from an exact surface.
    """

    leaf: int
    cloud: Surfels
    operand: Operand
    exact: bool

    def __len__(self) -> int:
        return len(self.operand)

    @cached_property
    def points(self) -> Floats:
        """Where they lie, shape (n, 3)."""
        return np.asarray(self.operand.points + self.operand.origin)

    @property
    def normals(self) -> Floats:
        """Their unit normals, outward, shape (n, 3)."""
        return self.operand.normals

    @cached_property
    def radii(self) -> Floats:
        """The radii of their disks, of ellipses those of disks of the same size, shape (n,)."""
        if self.cloud.radii is not None:
            return np.asarray(self.cloud.radii[self.order])
        if self.axes is not None:
            return np.asarray(np.sqrt(np.linalg.norm(self.axes, axis=2).prod(axis=1)))
        return np.asarray(RADIUS * self.operand.spacings)

    @cached_property
    def axes(self) -> Floats | None:
        """The half axes of their ellipses, shape (n, 2, 3); None where they are disks."""
        return None if self.cloud.axes is None else np.asarray(self.cloud.axes[self.order])

    @cached_property
    def extents(self) -> Floats:
        """How far each disk or ellipse reaches from its centre, shape (n,)."""
        return self.radii if self.axes is None else np.asarray(np.linalg.norm(self.axes, axis=2).max(axis=1))

    @cached_property
    def reach(self) -> Floats:
        """How far from its centre each may be cut: its disk, and its cell where that is larger, shape (n,)."""
        return np.maximum(self.extents, RADIUS * self.operand.spacings)

    def disks(self, rows: NDArray[np.int64]) -> Floats:
        """Return the half axes of some of them in their tangent frames, shape (m, 2, 2); of disks any two."""
        if self.axes is None:
            return np.asarray(self.radii[rows][:, None, None] * np.eye(2))
        frame = np.stack(frames_of(self.normals[rows]), axis=1)
        return np.asarray(np.einsum("iaj,ibj->iab", self.axes[rows], frame))

    def boxes(self, rows: NDArray[np.int64]) -> Floats | None:
        """Return half axes of the boxes that their cells are cut out of, shape (m, 2, 2); None where they are disks.

        As long and narrow as the ellipses, and no smaller than the box of a disk of the local spacing.
        """
        if self.axes is None:
            return None
        axes = self.disks(rows)
        size = np.sqrt(np.linalg.norm(axes, axis=2).prod(axis=1))
        least = RADIUS * self.operand.spacings[rows] / np.maximum(size, 1e-300)
        return np.asarray(axes * np.maximum(least, 1.0)[:, None, None])

    @cached_property
    def areas(self) -> Floats:
        """The area that each stands for, shape (n,): that of the cloud's patches, of exact leaves that of the cells."""
        if self.exact:
            return cell_areas(cells_of(self.operand, np.arange(len(self))))
        carried = None if self.cloud.clips is None else self.cloud.clips.areas
        return np.asarray((self.cloud.surface.patches.areas if carried is None else carried)[self.order])

    @property
    def order(self) -> NDArray[np.int32]:
        """The row of the cloud that each row stands for, shape (n,)."""
        return self.operand.order

    def before(self, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], Floats]:
        """Return the lines in which clips cut some of them already, in compressed rows."""
        if self.cloud.clips is None:
            return np.zeros(len(rows) + 1, np.int64), np.empty((0, 3))
        clips = self.cloud.clips[self.order[rows]]
        which = np.repeat(np.arange(len(rows)), clips.counts)
        across, along = frames_of(self.normals[rows])
        normal = clips.planes[:, :3]
        a, b, shift = (np.einsum("ij,ij->i", normal, v[which]) for v in (across, along, clips.places))
        length = np.maximum(np.hypot(a, b), 1e-12)
        return clips.offsets, np.stack([a, b, clips.planes[:, 3] - shift], axis=1) / length[:, None]
