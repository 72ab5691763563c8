"""Disks: surfels made ready to be drawn, of all clouds together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

EDGE, CREASE, CLIPPED, ELLIPTIC, PAINTED = 1, 2, 4, 8, 16
"""Bits of a surfel: a cut may pass it; its neighbours' normals spread; it has clip planes, axes, a color of its own."""


class Disks(NamedTuple):
    """Surfels to be drawn, leaf after leaf, each in the frame of its own cloud.

    What every frame reads of all surfels is stored coordinate by coordinate, so that several are read at once.
    """

    points: NDArray[np.float32]  # (3, n)
    normals: NDArray[np.float32]  # (3, n)
    radii: NDArray[np.float32]  # (n,)
    bends: NDArray[np.float32]  # (n,): curvature, where convex
    colors: NDArray[np.uint8]  # (n, 3)
    leaf: NDArray[np.int32]  # (n,), in ascending order
    flags: NDArray[np.uint8]  # (n,)
    row: NDArray[np.int32]  # (n,): of the cloud as it was given
    clips: NDArray[np.int32]  # (n + 1,): runs of planes
    planes: NDArray[np.float32]  # (k, 4): n . (x - centre) <= d
    axes: NDArray[np.float32]  # (n, 6), or (0, 6) where all are round
    cuts: NDArray[np.float32]  # (n, 5), or (0, 5) where not known: planes of cuts, and how far these may be off

    def chosen(self, good: NDArray[np.bool_]) -> Disks:
        """Return some of the disks."""
        starts = np.concatenate([[0], np.cumsum(np.diff(self.clips)[good])]).astype(np.int32)
        return Disks(
            np.ascontiguousarray(self.points[:, good]),
            np.ascontiguousarray(self.normals[:, good]),
            self.radii[good],
            self.bends[good],
            self.colors[good],
            self.leaf[good],
            self.flags[good],
            self.row[good],
            starts,
            self.planes[np.repeat(good, np.diff(self.clips))],
            self.axes[good] if len(self.axes) else self.axes,
            self.cuts[good] if len(self.cuts) else self.cuts,
        )


NO_DISKS = Disks(
    np.empty((3, 0), np.float32),
    np.empty((3, 0), np.float32),
    np.empty(0, np.float32),
    np.empty(0, np.float32),
    np.empty((0, 3), np.uint8),
    np.empty(0, np.int32),
    np.empty(0, np.uint8),
    np.empty(0, np.int32),
    np.zeros(1, np.int32),
    np.empty((0, 4), np.float32),
    np.empty((0, 6), np.float32),
    np.empty((0, 5), np.float32),
)


def joined(parts: Sequence[Disks]) -> Disks:
    """Join disks, one after the other."""
    if len(parts) <= 1:
        return parts[0] if parts else NO_DISKS
    starts = np.cumsum([0, *(int(part.clips[-1]) for part in parts)])
    columns: dict[str, list[NDArray[Any]]] = {name: [getattr(part, name) for part in parts] for name in Disks._fields}
    columns["clips"] = [part.clips[:-1] + start for part, start in zip(parts, starts[:-1], strict=True)]
    columns["clips"].append(starts[-1:])
    for name, width in (("axes", 6), ("cuts", 5)):  # where some have none, these are never read
        if any(len(rows) for rows in columns[name]):
            columns[name] = [
                rows if len(rows) else np.ones((len(part.radii), width))
                for rows, part in zip(columns[name], parts, strict=True)
            ]
    along = {"points": 1, "normals": 1}
    return Disks(
        **{k: np.concatenate(v, axis=along.get(k, 0)).astype(getattr(NO_DISKS, k).dtype) for k, v in columns.items()}
    )
