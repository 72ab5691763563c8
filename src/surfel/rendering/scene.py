"""Scene: what is to be seen, taken apart into leaves, with all that does not depend on the camera."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from surfel.booleans.sides import Rule, is_sheet
from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.rendering.disks import CLIPPED, CREASE, EDGE, ELLIPTIC, PAINTED, Disks, joined
from surfel.rendering.extremes import check_boxes
from surfel.rendering.palette import leaf_color
from surfel.rendering.shown import as_shapes
from surfel.rendering.splats import Splats, splats_of
from surfel.rendering.survivors import Survivors, survivors_of
from surfel.shapes.base import CORNERS, Shape
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree

_FEW = 5_000  # points of a shape that a camera is fitted to


@dataclass(frozen=True, eq=False)
class Item:
    """One of the shapes shown: a tree or a leaf, and which leaves of the scene are its own."""

    shape: Shape
    leaves: tuple[Shape, ...]
    first: int
    """The scene's number of its first leaf."""
    rule: Rule | None
    """What survives; None where everything does, or where lines cross the shape as a whole."""

    @cached_property
    def exact(self) -> list[int]:
        """The leaves that lines of sight cross: all but clouds."""
        return [k for k, leaf in enumerate(self.leaves) if not isinstance(leaf, Surfels)]

    @property
    def cast(self) -> bool:
        """Whether lines of sight cross it as a whole: there are no clouds in it."""
        return len(self.exact) == len(self.leaves)


class Scene:
    """Shapes to be seen; made once, then drawn from any camera.

    What is learnt from a cloud, and what of a cloud survives beside another leaf, is kept while these live.

    Parameters
    ----------
    shapes : Shape or iterable of Shape
        A tree, a leaf, or several of these, which are shown together. A safe spline is shown as its sheet, the result
        of a Boolean operation as its surfels.

    Raises
    ------
    InputError
        If something is no shape, a tree subtracts a sheet, or sizes are too extreme for pictures.
    """

    def __init__(self, shapes: Any) -> None:
        self.items: list[Item] = []
        count = 0
        for shape in as_shapes(shapes):
            leaves = shape.leaves if isinstance(shape, Tree) else (shape,)
            self.items.append(_item(shape, leaves, count))
            count += len(leaves)
        self.leaves = tuple(leaf for item in self.items for leaf in item.leaves)
        check_boxes([box for item in self.items for box in _boxes_of(item)])
        self.colors = np.array([leaf_color(k) for k in range(count)], np.float32).reshape(-1, 3)

    def item_of(self, leaf: int) -> Item:
        """Return the item that a leaf belongs to."""
        return next(item for item in reversed(self.items) if item.first <= leaf)

    @cached_property
    def bounds(self) -> Floats:
        """The box round all shapes, shape (2, 3); infinite where one has no end, zeros where there is nothing."""
        boxes = [box for box in (box_of(item.shape) for item in self.items) if box is not None]
        return np.stack([np.min(boxes, axis=0)[0], np.max(boxes, axis=0)[1]]) if boxes else np.zeros((2, 3))

    @cached_property
    def outline(self) -> Floats:
        """Places round which a camera is fitted, shape (m, 3): some surfels, and corners round what is exact."""
        disks = self.disks
        some = slice(None, None, len(disks.radii) // _FEW + 1)
        pose = self.poses[disks.leaf[some]]
        parts = [np.einsum("nij,jn->ni", pose[:, :, :3], disks.points[:, some]) + pose[:, :, 3]]
        for item in self.items:
            box = box_of(item.shape)
            if box is None:
                continue
            if item.cast:
                points = item.shape._hull()[0]
                parts.append(points[:: len(points) // _FEW + 1])
                continue
            for leaf in item.leaves:
                if not isinstance(leaf, Surfels) and box_of(leaf) is not None:
                    corners = leaf._hull()[0] if np.isfinite(leaf.bounds).all() else box[CORNERS, range(3)]
                    parts.append(np.clip(corners, *box))
        return np.concatenate(parts)

    @cached_property
    def middle(self) -> Floats:
        """A place about which depths are told, shape (3,)."""
        box = self.bounds
        box = np.where(np.isfinite(box).all(axis=0), box, 0.0)
        return np.asarray(0.5 * box[0] + 0.5 * box[1])

    @cached_property
    def reach(self) -> float:
        """How far the scene reaches from its middle; 1 where that has no end."""
        span = self.bounds[1] - self.middle
        return float(np.linalg.norm(span[np.isfinite(span)])) or 1.0

    @cached_property
    def splats(self) -> dict[int, Splats]:
        """The disks of each cloud that has any."""
        found = {k: splats_of(leaf) for k, leaf in enumerate(self.leaves) if isinstance(leaf, Surfels)}
        return {k: splats for k, splats in found.items() if splats is not None}

    @cached_property
    def poses(self) -> Floats:
        """From what the points of each leaf are told in to the world, shape (leaves, 3, 4)."""
        found = np.zeros((len(self.leaves), 3, 4))
        for k, splats in self.splats.items():
            found[k] = splats.pose
        return found

    @cached_property
    def disks(self) -> Disks:
        """The surfels that can be seen from anywhere: those that the trees keep, and those that a cut may pass."""
        parts = []
        for item in self.items:
            found = _disks_of(item)
            if len(self.items) > 1:
                own = np.where(found.flags & PAINTED, found.colors.T, self.colors[item.first + found.leaf].T).T
                found = found._replace(leaf=found.leaf + np.int32(item.first), colors=own.astype(np.uint8))
            parts.append(found)
        return joined(parts)


_made: WeakKeyDictionary[Shape, Disks] = WeakKeyDictionary()
_lock = threading.RLock()


def _disks_of(item: Item) -> Disks:
    """Return the disks of one of the shapes, its leaves numbered from 0; kept while the shape lives."""
    with _lock:
        if item.shape not in _made:
            parts = []
            for k, leaf in enumerate(item.leaves):
                splats = splats_of(leaf) if isinstance(leaf, Surfels) else None
                if splats is not None:
                    kept = Survivors.all(len(splats)) if item.rule is None else survivors_of(item, k)
                    parts.append(_disks(splats, k, kept))
            _made[item.shape] = joined(parts)
        return _made[item.shape]


_boxes: WeakKeyDictionary[Shape, Floats] = WeakKeyDictionary()


def box_of(shape: Shape) -> Floats | None:
    """Return the box round a shape; None where there is nothing. It is found once while the shape lives."""
    with _lock:
        if shape not in _boxes:
            try:
                _boxes[shape] = np.asarray(shape.bounds)
            except InputError:  # an empty cloud, a mesh without triangles
                _boxes[shape] = np.zeros((0, 3))
        box = _boxes[shape]
    return None if not len(box) or (isinstance(shape, Tree) and not box.any()) else box


def _boxes_of(item: Item) -> list[Floats]:
    """Return the boxes of what is drawn or crossed for itself: of the clouds, and of the shape as a whole."""
    boxes = [box_of(leaf) for leaf in item.leaves if isinstance(leaf, Surfels)] + [box_of(item.shape)]
    return [box for box in boxes if box is not None]


def _item(shape: Shape, leaves: tuple[Shape, ...], first: int) -> Item:
    if not isinstance(shape, Tree) or not any(isinstance(leaf, Surfels) for leaf in leaves):
        return Item(shape, leaves, first, None)
    return Item(shape, leaves, first, Rule(shape, {k for k, leaf in enumerate(leaves) if is_sheet(leaf)}))


def _disks(splats: Splats, leaf: int, kept: Survivors) -> Disks:
    """Return those disks of a cloud that may be seen."""
    rows = kept.rows
    counts = np.diff(splats.clips)[rows]
    clips = np.concatenate([[0], np.cumsum(counts)])
    planes = splats.planes[np.repeat(splats.clips[:-1][rows] - clips[:-1], counts) + np.arange(clips[-1])]
    flags = EDGE * kept.edge.astype(np.int64) + CREASE * splats.creased[rows]
    flags = flags | np.where(counts > 0, CLIPPED, 0) | (ELLIPTIC if splats.axes is not None else 0)
    flags = flags | (PAINTED if splats.colors is not None else 0)
    n = len(rows)
    rgb = np.tile(np.array(leaf_color(leaf), np.uint8), (n, 1)) if splats.colors is None else splats.colors[rows]
    axes = np.empty((0, 6)) if splats.axes is None else splats.axes[rows]
    return Disks(
        np.ascontiguousarray(splats.index.points[rows].T, np.float32),
        np.ascontiguousarray(splats.normals[rows].T, np.float32),
        splats.radii[rows].astype(np.float32),
        splats.bends[rows].astype(np.float32),
        np.ascontiguousarray(rgb),
        np.full(n, leaf, np.int32),
        flags.astype(np.uint8),
        splats.rows[rows],
        clips.astype(np.int32),
        planes.astype(np.float32).reshape(-1, 4),
        axes.astype(np.float32),
        kept.cuts.astype(np.float32),
    )
