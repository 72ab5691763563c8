"""Reference: every line of sight is cast through the tree; the slow truth that splats are compared with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.execute import blocks
from surfel.rendering.cast import first_hits
from surfel.rendering.fragments import Fragments
from surfel.rendering.frame import Frame
from surfel.rendering.places import CENTRE, Places
from surfel.rendering.scene import Item

_BLOCK = 1 << 17


class Reference(Frame):
    """A frame in which clouds are crossed as they are for measuring: by their fans, one event for each sheet.

    Whether the tree keeps an event is asked at its place, not by parity along the line: a line that has come in through
    a hole of a scan would not know.
    """

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
                limit = np.full(last - first, np.inf, np.float32)
                hits = self._first_kept(item, range(len(item.leaves)), looking, limit)
            met = np.flatnonzero(hits.leaf >= 0)
            seen.put(rows[run][met], self._described(item, looking, hits, met))
