"""Reference: every line of sight is cast through the tree; the slow truth that splats are compared with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Booleans, Floats
from surfel.core.execute import blocks
from surfel.rendering.camera import Camera
from surfel.rendering.cast import Hits, Sight, cloud_at, first_hits
from surfel.rendering.curved import Curved
from surfel.rendering.fragments import Fragments
from surfel.rendering.frame import Frame
from surfel.rendering.places import CENTRE, Places
from surfel.rendering.scene import Item, Scene
from surfel.rendering.verdicts import kept
from surfel.shapes.surfels import Surfels

_BLOCK = 1 << 17


class Reference(Frame):
    """A frame in which clouds are crossed as curved sheets.

    Whether the tree keeps an event is asked at its place, not by parity along the line: a line that has come in through
    a hole of a scan would not know.
    """

    def __init__(self, scene: Scene, camera: Camera, size: tuple[int, int]) -> None:
        super().__init__(scene, camera, size)
        self._sheets: dict[Surfels, Curved] = {}

    def grid(self) -> Fragments:
        """Return what is seen at the centre of every pixel, row after row."""
        return self.at(Places(np.arange(self.size[0] * self.size[1]), CENTRE))

    def at(self, places: Places) -> Fragments:
        """Return what is seen at places within pixels."""
        x, y = places.columns_and_rows(self.size[0])
        seen = Fragments.nothing(len(x))
        rows = np.arange(len(x))
        for item in self.scene.items:
            self._put_whole(seen, item, rows, x, y)
        return seen

    def _put_whole(self, seen: Fragments, item: Item, rows: NDArray[np.int64], x: Floats, y: Floats) -> None:
        """Cross a tree, and put the first passages that it keeps where they are nearer."""
        for first, last in blocks(len(rows), _BLOCK):
            run = slice(first, last)
            looking = self._sight(x[run], y[run])
            if item.cast:
                hits = first_hits(item.shape, looking)
            else:
                hits = self._first_kept(item, item.exact, looking, np.full(last - first, np.inf, np.float32))
                self._cross_clouds(item, looking, hits)
            met = np.flatnonzero(hits.leaf >= 0)
            seen.put(rows[run][met], self._described(item, looking, hits, met))

    def _cross_clouds(self, item: Item, looking: Sight, hits: Hits) -> None:
        """Put the first passages through curved sheets that a tree keeps into hits, where they are nearer."""
        for k, leaf in enumerate(item.leaves):
            if not isinstance(leaf, Surfels):
                continue

            def keeps(rows: NDArray[np.int64], t: Floats, side: Floats, k: int = k, leaf: Surfels = leaf) -> Booleans:
                along = looking.lines.directions[rows]
                points = looking.lines.origins[rows] + t[:, None] * along
                toward = cloud_at(leaf, points, along)[0]
                return kept(item, k, points, np.where(side[:, None] > 0.0, -toward, toward), self.scene.reach)

            t, side = self._curved(leaf).first(looking, keeps)
            nearer = t < hits.t
            hits.t[nearer], hits.cosine[nearer], hits.leaf[nearer] = t[nearer], side[nearer], k

    def _curved(self, cloud: Surfels) -> Curved:
        """Return the curved sheets of a cloud, made once."""
        if cloud not in self._sheets:
            self._sheets[cloud] = Curved(cloud)
        return self._sheets[cloud]
