"""The methods of the literature, as published, for comparison: Wicke's clip buffer and alpha-blended quads."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.core.cast import Booleans
from surfel.rendering.clip_buffer import layers_of
from surfel.rendering.disks import EDGE, Disks
from surfel.rendering.fragments import Fragments
from surfel.rendering.frame import Frame
from surfel.rendering.lists import Lists, lists_at
from surfel.rendering.places import CENTRE, Places
from surfel.rendering.projection import normal_of
from surfel.rendering.raster import BLEND
from surfel.rendering.verdicts import kept, sides_of

_SIDE_UNKNOWN = np.uint8(255)
_ZERO, _ONE, _FOUR, _INF = np.float32(0.0), np.float32(1.0), np.float32(4.0), np.float32(np.inf)


class ClipBuffer(Frame):
    """Wicke et al., *CSG-Tree Rendering for Point-Sampled Objects*, 2004; Gaal, sec. 4.3.

    Surfels are classified (on the result, inside edge, outside edge, outside); edge surfels go to a clip buffer, where
    every fragment is clipped by the plane of the surfel of each other solid that lies nearest on the same pixel. A
    solid without a surfel there is judged at the centre of the surfel.
    """

    @cached_property
    def disks(self) -> Disks:
        """The surfels that are drawn; what is known of the cuts beforehand is no part of the method."""
        return self.scene.disks._replace(cuts=np.empty((0, 5), np.float32))

    def _behind(self, places: Places, rows: NDArray[np.int64]) -> Fragments:
        lists = lists_at(self.disks, self.placed, self.motions, self.view, places, rows)
        self._clip(lists)
        plain = self.disks._replace(flags=self.disks.flags & np.uint8(255 - EDGE))
        layers = layers_of(plain, self.placed.label, self.motions, self.view, lists, places, rows)
        return self._first_of(layers, np.arange(layers.winner.shape[1]) < layers.number[:, None])

    def _clip(self, lists: Lists) -> None:
        """Take out the fragments of edge surfels that their partners on the same pixel clip."""
        row = np.repeat(lists.starts, lists.counts)
        row = row + np.arange(len(row)) - np.repeat(np.cumsum(lists.counts) - lists.counts, lists.counts)
        edge = row[self.disks.flags[lists.who[row]] & EDGE != 0]
        leaf = self.disks.leaf[lists.who[edge]]
        good = np.ones(len(edge), np.bool_)
        for k in np.unique(leaf):
            item, of = self.scene.item_of(int(k)), np.flatnonzero(leaf == k)
            assert item.rule is not None  # only trees have edges
            who = lists.who[edge[of]]
            points, normals = self._in_world(self.disks, who, int(k))
            sides = {}
            for j, other in enumerate(item.leaves):
                if j + item.first == k or j in item.rule.sheets:
                    continue
                found = np.full(len(lists.who), _SIDE_UNKNOWN)
                with threads_for(100 * len(lists.counts)):
                    _partners(
                        len(lists.counts), lists, self.disks.leaf, self.placed.label, np.int64(k),
                        np.int64(j + item.first), found,
                    )  # fmt: skip
                here = found[edge[of]]
                unknown = np.flatnonzero(here == _SIDE_UNKNOWN)
                here[unknown] = sides_of(other, points[unknown], normals[unknown], self.scene.reach)
                sides[j] = here
            good[of] = item.rule.keeps(int(k) - item.first, dict(sides), len(of)) != 0
        lists.who[edge[~good]] = -1


class Quads(Frame):
    """Gaal, sec. 7: each surfel is kept or dropped as a whole, and drawn as a textured quad in two passes.

    The first pass fills the depth buffer. The second blends, surfel after surfel, what passes the test of depth, each
    over what is there, with the Gaussian of its texture for its opacity; outside the disk the texture is clear.
    """

    @cached_property
    def disks(self) -> Disks:
        """The surfels whose centres the trees keep."""
        disks = self.scene.disks
        edge = disks.flags & EDGE != 0
        good: Booleans = ~edge
        for k in np.unique(disks.leaf[edge]):
            item, of = self.scene.item_of(int(k)), np.flatnonzero(edge & (disks.leaf == k))
            points, normals = self._in_world(disks, of, int(k))
            good[of] = kept(item, int(k) - item.first, points, normals, self.scene.reach)
        some = disks.chosen(good)
        return some._replace(flags=some.flags & np.uint8(255 - EDGE))

    def _drawn(self, places: Places | None) -> Fragments:
        if places is not None:
            return self._behind(places, np.arange(len(places.pixels) * len(places.offsets)))
        seen = super()._drawn(None)
        pixels = np.flatnonzero(seen.seen)
        blended = self._behind(Places(pixels, CENTRE), np.arange(len(pixels)))
        seen.normal[pixels], seen.color[pixels] = blended.normal, blended.color
        return seen

    def _behind(self, places: Places, rows: NDArray[np.int64]) -> Fragments:
        lists = lists_at(self.disks, self.placed, self.motions, self.view, places, rows)
        seen = Fragments.nothing(len(lists.counts))
        with threads_for(100 * len(seen)):
            _blend_over(len(seen), lists, self.disks, self.motions, *_columns(seen))
        back = seen.normal[:, 2] > 0.0
        seen.normal[back] = -seen.normal[back]
        return seen


def _columns(seen: Fragments) -> tuple[NDArray[np.float32] | NDArray[np.uint8] | NDArray[np.int32], ...]:
    return seen.depth, seen.normal, seen.color, seen.leaf, seen.row


@rows
def _partners(first, last, lists, leaf, label, own, other, sides):
    """Tell on which side of its nearest partner each fragment of ``own`` lies: 3 inside ``other``, 0 outside."""
    starts, counts, z, _, who = lists
    for line in range(first, last):
        for a in range(starts[line], starts[line] + counts[line]):
            if leaf[who[a]] != own:
                continue
            nearest = _INF
            for b in range(starts[line], starts[line] + counts[line]):
                if leaf[who[b]] == other and abs(z[a] - z[b]) < nearest:
                    nearest = abs(z[a] - z[b])
                    faces = label[who[b]] & 1 == 0
                    sides[a] = 3 if (z[a] > z[b]) == faces else 0


@rows
def _blend_over(first, last, lists, disks, motions, depth, normal, color, out_leaf, out_row):
    starts, counts, z, weight, who = lists
    for line in range(first, last):
        begin, end = starts[line], starts[line] + counts[line]
        nearest, lead = _INF, -1
        for a in range(begin, end):
            if z[a] < nearest or (z[a] == nearest and who[a] < lead):
                nearest, lead = z[a], who[a]
        if lead < 0:
            continue
        depth[line], out_leaf[line], out_row[line] = nearest, disks.leaf[lead], disks.row[lead]
        nx, ny, nz = normal_of(lead, disks.leaf[lead], disks.normals, motions)
        red, green, blue = (
            np.float32(disks.colors[lead, 0]), np.float32(disks.colors[lead, 1]), np.float32(disks.colors[lead, 2])
        )  # fmt: skip
        for a in range(begin, end):
            i = who[a]
            if z[a] > nearest + BLEND * disks.radii[i]:
                continue
            opacity = math.exp(-_FOUR * (_ONE - math.sqrt(weight[a])))  # the weight is (1 - u)^2
            ax, ay, az = normal_of(i, disks.leaf[i], disks.normals, motions)
            nx += opacity * (ax - nx)
            ny += opacity * (ay - ny)
            nz += opacity * (az - nz)
            red += opacity * (np.float32(disks.colors[i, 0]) - red)
            green += opacity * (np.float32(disks.colors[i, 1]) - green)
            blue += opacity * (np.float32(disks.colors[i, 2]) - blue)
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length > _ZERO:
            normal[line, 0], normal[line, 1], normal[line, 2] = nx / length, ny / length, nz / length
        color[line, 0], color[line, 1], color[line, 2] = np.uint8(red), np.uint8(green), np.uint8(blue)
