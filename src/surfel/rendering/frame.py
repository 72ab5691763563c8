"""Frame: a scene seen by one camera; what its lines of sight see, on the grid of pixels or at places within pixels."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Booleans, Floats
from surfel.core.crossings import Crossings
from surfel.rendering.camera import Camera
from surfel.rendering.cast import FARTHEST, Hits, Sight, cloud_at, first_hits, mesh_at, normals_at, sight, window
from surfel.rendering.clip_buffer import Layers, peeled
from surfel.rendering.disks import Disks
from surfel.rendering.extremes import check_camera
from surfel.rendering.fragments import Fragments
from surfel.rendering.pinholes import close_pinholes
from surfel.rendering.places import CENTRE, Places
from surfel.rendering.placing import Placed, View, place, view_of
from surfel.rendering.raster import draw
from surfel.rendering.scene import Item, Scene, box_of
from surfel.rendering.tiles import UNSURE
from surfel.rendering.verdicts import kept
from surfel.shapes.mesh import Mesh
from surfel.shapes.surfels import Surfels


class Frame:
    """A scene seen by a camera.

    Parameters
    ----------
    scene : Scene
        What is seen.
    camera : Camera
        From where.
    size : tuple of int
        Width and height.
    """

    def __init__(self, scene: Scene, camera: Camera, size: tuple[int, int]) -> None:
        check_camera(camera, scene.middle)
        self.scene, self.camera, self.size = scene, camera, size
        self.middle = float((scene.middle - camera.eye) @ camera.frame[2])
        self.view: View = view_of(camera, size, self.middle, scene.reach)

    @cached_property
    def disks(self) -> Disks:
        """The surfels that are drawn."""
        return self.scene.disks

    @cached_property
    def motions(self) -> NDArray[np.float32]:
        """From the frame of each cloud to the camera's, depth relative to the scene's middle."""
        turn, poses = self.camera.frame, self.scene.poses
        moved = np.empty((len(self.scene.leaves), 3, 4))
        moved[:, :, :3] = turn @ poses[:, :, :3]
        moved[:, :, 3] = (poses[:, :, 3] - self.camera.eye) @ turn.T
        moved[:, 2, 3] = (poses[:, :, 3] - self.scene.middle) @ turn[2]
        return moved.astype(np.float32)

    @cached_property
    def placed(self) -> Placed:
        """The splats in the picture."""
        return place(self.disks, self.motions, self.view)

    def grid(self) -> Fragments:
        """Return what is seen at the centre of every pixel, row after row."""
        seen = self._drawn(None) if self.scene.splats else Fragments.nothing(self.size[0] * self.size[1])
        for item in self.scene.items:
            pixels = self._window(item) if item.exact else np.empty(0, np.int64)
            if len(pixels):
                self._put_cast(seen, item, pixels, *Places(pixels, CENTRE).columns_and_rows(self.size[0]))
        if self.scene.splats:
            close_pinholes(seen, self.view)
        return seen

    def at(self, places: Places) -> Fragments:
        """Return what is seen at places within pixels."""
        number = len(places.pixels) * len(places.offsets)
        seen = self._drawn(places) if self.scene.splats else Fragments.nothing(number)
        if not any(item.exact for item in self.scene.items):
            return seen
        rows, (x, y) = np.arange(number), places.columns_and_rows(self.size[0])
        for item in self.scene.items:
            if item.exact:
                self._put_cast(seen, item, rows, x, y)
        return seen

    def world(self, x: Floats, y: Floats, depth: NDArray[np.float32]) -> Floats:
        """Return the places of the world that lie at depths, relative to the middle, along lines of sight."""
        width, height = self.size
        turn, focal, ahead = self.camera.frame, self.camera.focal(height), depth.astype(np.float64)
        wide = np.full(len(x), self.camera.distance) if self.camera.orthographic else self.middle + ahead
        across, down = (x - 0.5 * (width - 1)) * wide / focal, (y - 0.5 * (height - 1)) * wide / focal
        middle = self.camera.eye + self.middle * turn[2]
        return np.asarray(middle + np.column_stack([across, down, ahead]) @ turn)

    def _in_world(self, disks: Disks, rows: NDArray[np.integer[Any]], leaf: int) -> tuple[Floats, Floats]:
        """Return where some surfels of a leaf lie in the world, and their normals."""
        turn, shift = self.scene.poses[leaf, :, :3], self.scene.poses[leaf, :, 3]
        return disks.points[:, rows].T @ turn.T + shift, disks.normals[:, rows].T @ turn.T

    def _sight(self, x: Floats, y: Floats) -> Sight:
        return sight(self.camera, self.size, x, y, self.middle, float(self.view.near))

    def _window(self, item: Item) -> NDArray[np.int64]:
        """Return the pixels that the box of an item can fall on."""
        box = box_of(item.shape)
        found = None if box is None else window(box, self.camera, self.size)
        if found is None:
            return np.empty(0, np.int64)
        low_x, high_x, low_y, high_y = found
        rows, columns = np.arange(low_y, high_y + 1), np.arange(low_x, high_x + 1)
        return (rows[:, None] * self.size[0] + columns).ravel()

    def _drawn(self, places: Places | None) -> Fragments:
        """Return what is seen of the clouds at places; by default on the grid of pixels."""
        seen, state = draw(self.disks, self.placed, self.motions, self.view, places)
        rows = np.flatnonzero(state >= UNSURE)
        if len(rows):
            seen.clear(rows)
            some, wanted = (Places(rows, CENTRE), np.arange(len(rows))) if places is None else (places, rows)
            seen.put(rows, self._behind(some, wanted))
        return seen

    def _behind(self, places: Places, rows: NDArray[np.int64]) -> Fragments:
        """Return, for some of the places, the first sheet of the clouds that the trees keep."""
        layers = peeled(self.disks, self.placed, self.motions, self.view, places, rows)
        valid = np.arange(layers.winner.shape[1]) < layers.number[:, None]
        good = valid & ~layers.unsure
        line, level = np.nonzero(valid & layers.unsure)
        if len(line):
            value, leaf = layers.value[line, level], self.disks.leaf[layers.winner[line, level]]
            x, y = places.columns_and_rows(self.size[0], rows[line])
            good[line, level] = self._verdicts(x, y, value[:, 0], value[:, 1:4], leaf)
        return self._first_of(layers, good)

    def _first_of(self, layers: Layers, good: Booleans) -> Fragments:
        """Return the first good sheet of each line."""
        first = np.argmax(good, axis=1)
        rows = np.flatnonzero(good[np.arange(len(first)), first])
        first = first[rows]
        seen = Fragments.nothing(len(good))
        value, who = layers.value[rows, first], layers.winner[rows, first]
        seen.depth[rows], seen.normal[rows], seen.color[rows] = value[:, 0], value[:, 1:4], np.rint(value[:, 4:7])
        seen.leaf[rows], seen.row[rows] = self.disks.leaf[who], self.disks.row[who]
        back = seen.normal[:, 2] > 0.0
        seen.normal[back] = -seen.normal[back]
        return seen

    def _verdicts(
        self, x: Floats, y: Floats, depth: NDArray[np.float32], normal: NDArray[np.float32], leaf: NDArray[np.int32]
    ) -> Booleans:
        """Ask the trees for the blended points of sheets that a cut may pass."""
        points, normals = self.world(x, y, depth), normal.astype(np.float64) @ self.camera.frame
        good = np.zeros(len(x), np.bool_)
        for item in self.scene.items:
            own = leaf - item.first
            rows = np.flatnonzero((own >= 0) & (own < len(item.leaves)))
            good[rows] = kept(item, own[rows], points[rows], normals[rows], self.scene.reach)
        return good

    def _put_cast(self, seen: Fragments, item: Item, rows: NDArray[np.int64], x: Floats, y: Floats) -> None:
        """Cross what is no cloud with lines of sight, and put the first kept hits where they are nearer."""
        looking = self._sight(x, y)
        if item.cast:
            hits = first_hits(item.shape, looking)
        else:
            hits = self._first_kept(item, item.exact, looking, seen.depth[rows])
        with np.errstate(invalid="ignore"):
            depth = hits.t * looking.ahead
        near = np.flatnonzero((hits.leaf >= 0) & (depth < seen.depth[rows]))
        if not len(near):
            return
        seen.put(rows[near], self._described(item, looking, hits, near))

    def _described(self, item: Item, looking: Sight, hits: Hits, rows: NDArray[np.int64]) -> Fragments:
        """Return fragments of some hits: with normals and colors."""
        found = Fragments.nothing(len(rows))
        found.depth[:] = hits.t[rows] * looking.ahead[rows]
        found.leaf[:] = hits.leaf[rows] + item.first
        along = looking.lines.directions[rows]
        points = looking.lines.origins[rows] + hits.t[rows, None] * along
        for k in np.unique(hits.leaf[rows]):
            of = np.flatnonzero(hits.leaf[rows] == k)
            leaf, colors = item.leaves[k], None
            if isinstance(leaf, Mesh):
                normal, colors = mesh_at(leaf, points[of], along[of])
            elif isinstance(leaf, Surfels):
                normal, colors, found.row[of] = cloud_at(leaf, points[of], along[of])
            else:
                normal = normals_at(leaf, points[of], along[of])
            found.normal[of] = normal @ self.camera.frame.T
            found.color[of] = self.scene.colors[k + item.first] if colors is None else np.rint(colors)
        return found

    def _first_kept(self, item: Item, leaves: Iterable[int], looking: Sight, limit: NDArray[np.float32]) -> Hits:
        """Return the first hits on some leaves that a tree with clouds keeps, nearer than a limit."""
        best = Hits.none(looking.number)
        for k in leaves:
            leaf = item.leaves[k]
            hits = leaf._sheets(leaf._cross(looking.lines))
            at = _skip(hits, looking.start)
            rows = np.arange(looking.number)
            while len(rows):
                rows = rows[at[rows] < hits.offsets[1:][rows]]
                t = hits.t[at[rows]]
                with np.errstate(invalid="ignore"):
                    ahead = (t < np.minimum(best.t[rows], limit[rows] / looking.ahead[rows])) & (t < FARTHEST)
                rows, t = rows[ahead], t[ahead]
                along = looking.lines.directions[rows]
                points = looking.lines.origins[rows] + t[:, None] * along
                cosine = hits.cosine[at[rows]]
                toward = (
                    cloud_at(leaf, points, along)[0] if isinstance(leaf, Surfels) else normals_at(leaf, points, along)
                )
                good = kept(item, k, points, np.where(cosine[:, None] > 0.0, -toward, toward), self.scene.reach)
                best.t[rows[good]], best.cosine[rows[good]], best.leaf[rows[good]] = t[good], cosine[good], k
                rows = rows[~good]
                at[rows] += 1
        return best


def _skip(hits: Crossings, start: Floats) -> NDArray[np.int64]:
    """Return the first row of each line that lies beyond a t."""
    line = hits.lines
    return hits.offsets[:-1] + np.bincount(line[hits.t <= start[line]], minlength=len(hits))
