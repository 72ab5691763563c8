"""A tree made ready for the kernels: its logic, its convex leaves, and where each leaf can matter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.core.affine import inverse
from surfel.core.cast import Floats
from surfel.core.crossings import Crossings
from surfel.core.lines import Lines
from surfel.index.box_tree import box_tree
from surfel.shapes.base import Shape
from surfel.shapes.cloud_inside import events_at, lies_on
from surfel.shapes.cloud_passages import closed_events
from surfel.shapes.convex import ConvexLeaves, convex_leaves
from surfel.shapes.extent import boxes_of, is_empty
from surfel.shapes.logic import Logic, logic_of, refuse_lost_sheets
from surfel.shapes.placed import Placed
from surfel.shapes.primitives.primitive import Primitive
from surfel.shapes.surfels import Surfels
from surfel.shapes.sweep import BOUNDARY, FLIP, SHARE, SHEET, SLOTS, Others, Solids, judge_points, sweep_lines
from surfel.shapes.tree import Tree, postorder

Source = tuple[int, int, Crossings]
"""A leaf, how its events are taken, and its events."""

_FAR = 4.0
"""Origins farther off than this many sizes of the tree are moved along their lines first."""


@dataclass(frozen=True, eq=False)
class TreeCrossings(Crossings):
    """Crossings of a tree in which hits and passages differ: with clouds, or with sheets, which bound nothing."""

    events: Crossings


def events_of(crossings: Crossings) -> Crossings:
    """Return one event for each passage through the boundary of the solid."""
    return crossings.events if isinstance(crossings, TreeCrossings) else crossings


class Program:
    """What the kernels need of a tree."""

    def __init__(self, leaves: tuple[Shape, ...], logic: Logic, boxes: Floats, convex: ConvexLeaves) -> None:
        self.leaves = leaves
        self.logic = logic
        self.boxes = boxes
        self.convex = convex
        finite = np.abs(boxes[np.isfinite(boxes)])
        self.size = float(finite.max(initial=0.0)) or 1.0
        margin = 1e-9 * self.size
        grown = boxes[convex.leaf] + np.array([[-margin], [margin]])
        self.solids = Solids(logic, convex, box_tree(grown), self.size)
        plain = set(range(len(leaves))) - set(convex.leaf.tolist())
        self.others = [k for k in sorted(plain) if not is_empty(boxes[k])]

    @cached_property
    def sheets(self) -> list[int]:
        """The leaves that have no inside."""
        return [k for k in self.others if self.leaves[k]._is_sheet()]

    @cached_property
    def clouds(self) -> list[int]:
        """The leaves that are closed clouds."""
        return [k for k in self.others if isinstance(self.leaves[k], Surfels) and k not in self.sheets]

    def cross(self, lines: Lines) -> Crossings:
        """Return every hit of every line on the boundary of the tree, sorted along each line."""
        near, moved = self._near(lines)
        hits, passages = self._sources(near)
        found = self._sweep(near, hits, moved)
        if not (self.sheets or self.clouds):
            return found
        events = self._sweep(near, passages, moved)
        return TreeCrossings(found.offsets, found.t, found.cosine, found.weight, found.leaf, events)

    def keeps(self, points: Floats, normals: Floats, leaf: int) -> NDArray[np.int8]:
        """Tell which elements of the surface of a leaf survive: 1, with the other side outward -1, else 0."""
        inner_side, outer_side = self._judge(points, normals, leaf)
        return inner_side.astype(np.int8) - outer_side.astype(np.int8)

    def contains(self, points: Floats) -> NDArray[np.bool_]:
        """Tell which points lie inside; a point on the boundary may count as either."""
        upward = np.broadcast_to(np.array([0.3015, 0.5371, 0.7878]) / 0.99997, points.shape)
        return self._judge(points, np.ascontiguousarray(upward), -1)[0]

    def meets_cloud(self, points: Floats, normals: Floats, leaf: int) -> NDArray[np.bool_]:
        """Tell which elements of the surface of a leaf coincide with the surface of another leaf that is a cloud."""
        found = np.zeros(len(points), np.bool_)
        for k in self.clouds:
            other = self.leaves[k]
            if isinstance(other, Surfels) and k != leaf and len(points):
                found |= lies_on(other, points, normals)
        return found

    def _judge(self, points: Floats, normals: Floats, leaf: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        n = len(points)
        inner_side, outer_side = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        found = []
        for k in self.others:
            if k == leaf or k in self.sheets:
                continue
            margin = self._margin(k)
            low, high = self.boxes[k, 0] - margin, self.boxes[k, 1] + margin
            near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
            if len(near):
                found.append((k, self._passages(k, points[near], normals[near], leaf), near))
        others = _packed([(k, BOUNDARY, _spread(events, near, n)) for k, events, near in found], n)
        mode = SHEET if leaf in self.sheets else BOUNDARY
        with threads_for(4 * n):
            judge_points(
                n, self.solids, others, points, normals, np.int64(leaf), np.int64(mode), inner_side, outer_side
            )
        return inner_side, outer_side

    def _margin(self, k: int) -> float:
        """Return how far outside the box of a leaf there may be something of it."""
        leaf = self.leaves[k]
        return max(1e-9 * self.size, leaf.surface.spacing if isinstance(leaf, Surfels) else 0.0)

    def _passages(self, k: int, points: Floats, normals: Floats, leaf: int) -> Crossings:
        """Return what lies behind some points of the surface of a leaf and at them."""
        other = self.leaves[k]
        if isinstance(other, Surfels):
            return events_at(other, points, normals if leaf >= 0 else None)
        return other._events(Lines(points, normals, np.ones(len(points))))

    def _sources(self, lines: Lines) -> tuple[list[Source], list[Source]]:
        """Return the sources of the hits, and those of the passages through the solid."""
        hits: list[Source] = []
        passages: list[Source] = []
        for k in self.others:
            leaf = self.leaves[k]
            if k in self.sheets:
                hits.append((k, SHEET, leaf._events(lines)))
            elif isinstance(leaf, Surfels):
                raw = leaf._cross(lines)
                events = closed_events(leaf, lines, raw)
                hits += [(k, FLIP, events), (k, SHARE, raw)]
                passages.append((k, BOUNDARY, events))
            else:
                events = leaf._events(lines)
                hits.append((k, BOUNDARY, events))
                passages.append((k, BOUNDARY, events))
        return hits, passages

    def _sweep(self, lines: Lines, sources: list[Source], moved: Floats | None) -> Crossings:
        m = len(lines)
        others = _packed(sources, m)
        most = np.int64(2 * len(self.convex.leaf) + sum(int(c.counts.max(initial=0)) for _, _, c in sources))
        counts, starts = np.zeros(m, np.int64), np.full(m, -1)
        noted = _room_for(m * SLOTS)
        with threads_for(4 * m):
            sweep_lines(
                m, self.solids, others, most, lines.origins, lines.directions, np.arange(m), starts, counts, *noted
            )
            offsets = np.concatenate([[0], np.cumsum(counts)])
            kept = _room_for(int(offsets[-1]))
            _move(m, starts, offsets, *noted, *kept)
            rest = np.flatnonzero(starts < 0)
            if len(rest):
                sweep_lines(
                    len(rest), self.solids, others, most, lines.origins, lines.directions, rest, offsets[rest],
                    np.zeros(len(rest), np.int64), *kept,
                )  # fmt: skip
        if moved is not None:
            kept[0][:] += np.repeat(moved, counts)
        return Crossings(offsets, *kept)

    def _near(self, lines: Lines) -> tuple[Lines, Floats | None]:
        """Move origins that lie far off along their lines, so that t keeps its digits."""
        far = np.abs(lines.origins).max(initial=0.0) > _FAR * self.size
        if not far:
            return lines, None
        bounded = self.boxes[np.isfinite(self.boxes).all(axis=(1, 2))]
        middle = 0.5 * (bounded[:, 0].min(axis=0) + bounded[:, 1].max(axis=0)) if len(bounded) else np.zeros(3)
        shift = np.einsum("ij,ij->i", middle - lines.origins, lines.directions)
        return Lines(lines.origins + shift[:, None] * lines.directions, lines.directions, lines.weights), shift


def program_of(tree: Tree) -> Program:
    """Make a tree ready.

    Raises
    ------
    InputError
        If a sheet is subtracted, or two are intersected.
    """
    order = postorder(tree)
    leaves = tree.leaves
    logic = logic_of(order, leaves)
    boxes = where_leaves_matter(tree, order)
    rows = []
    for k, leaf in enumerate(leaves):
        shape = leaf.shape if isinstance(leaf, Placed) else leaf
        convex = shape._convex() if isinstance(shape, Primitive) else None
        if convex is not None:
            form, placement = convex
            matrix = leaf.matrix @ placement if isinstance(leaf, Placed) else placement
            rows.append((inverse(matrix), form, k))
    program = Program(leaves, logic, boxes, convex_leaves(rows))
    refuse_lost_sheets(logic, program.sheets)
    return program


def where_leaves_matter(tree: Tree, order: list[Shape]) -> Floats:
    """Return a box for each leaf outside of which its bit changes nothing, shape (leaves, 2, 3).

    What an intersection or a difference cannot reach is of no account to its inputs; a union passes everything on.
    """
    boxes = boxes_of(tree)
    reach = {id(node): np.array([[np.inf] * 3, [-np.inf] * 3]) for node in order}
    reach[id(tree)] = boxes[id(tree)]
    for node in reversed(order):
        if not isinstance(node, Tree):
            continue
        region = reach[id(node)] if node.operation == "union" else _common(reach[id(node)], boxes[id(node)])
        for child in node.children:
            part = _common(region, boxes[id(child)])
            if not is_empty(part):
                known = reach[id(child)]
                reach[id(child)] = np.stack([np.minimum(known[0], part[0]), np.maximum(known[1], part[1])])
    return np.array([reach[id(leaf)] for leaf in tree.leaves]).reshape(-1, 2, 3)


def _common(a: Floats, b: Floats) -> Floats:
    return np.stack([np.maximum(a[0], b[0]), np.minimum(a[1], b[1])])


def _spread(events: Crossings, rows: NDArray[np.int64], n: int) -> Crossings:
    """Return crossings of some rows as those of all n, the others without any."""
    counts = np.zeros(n, np.int64)
    counts[rows] = events.counts
    offsets = np.concatenate([[0], np.cumsum(counts)])
    return Crossings(offsets, events.t, events.cosine, events.weight, events.leaf)


def _packed(sources: list[Source], m: int) -> Others:
    if not sources:
        nothing = np.empty(0)
        rows, leaves, modes = np.zeros((0, m + 1), np.int64), np.empty(0, np.int32), np.empty(0, np.int8)
        return Others(rows, nothing, nothing, nothing, leaves, modes)
    starts = np.concatenate([[0], np.cumsum([len(events.t) for _, _, events in sources])])
    return Others(
        np.stack([events.offsets + start for (_, _, events), start in zip(sources, starts[:-1], strict=True)]),
        np.concatenate([events.t for _, _, events in sources]),
        np.concatenate([events.cosine for _, _, events in sources]),
        np.concatenate([events.weight for _, _, events in sources]),
        np.array([k for k, _, _ in sources], np.int32),
        np.array([mode for _, mode, _ in sources], np.int8),
    )


def _room_for(events: int) -> tuple[Floats, Floats, Floats, NDArray[np.int32]]:
    return np.empty(events), np.empty(events), np.empty(events), np.empty(events, np.int32)


@rows
def _move(first, last, starts, offsets, from_t, from_cosine, from_weight, from_leaf, t, cosine, weight, leaf):
    """Move the noted events of each line to their rows; lines that found no room are left out."""
    for line in range(first, last):
        if starts[line] < 0:
            continue
        for k in range(offsets[line + 1] - offsets[line]):
            at, to = starts[line] + k, offsets[line] + k
            t[to], cosine[to], weight[to], leaf[to] = from_t[at], from_cosine[at], from_weight[at], from_leaf[at]
