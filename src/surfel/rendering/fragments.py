"""Fragments: what lines of sight see, one row a line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Booleans
from surfel.rendering.memory import room


@dataclass(frozen=True, eq=False)
class Fragments:
    """What each line of sight sees; written to as nearer things are found.

    Where nothing is seen, only ``depth`` and ``leaf`` tell so; the others may hold anything.

    Parameters
    ----------
    depth : NDArray[np.float32], shape (m,)
        Relative to the depth of the scene's middle; infinite where nothing is seen.
    normal : NDArray[np.float32], shape (m, 3)
        Unit normals in the camera's frame, towards the camera.
    color : NDArray[np.uint8], shape (m, 3)
        Red, green and blue.
    leaf : NDArray[np.int32], shape (m,)
        Which leaf is seen, -1 for none.
    row : NDArray[np.int32], shape (m,)
        Of a cloud, the surfel that is nearest; else -1.
    """

    depth: NDArray[np.float32]
    normal: NDArray[np.float32]
    color: NDArray[np.uint8]
    leaf: NDArray[np.int32]
    row: NDArray[np.int32]

    @classmethod
    def nothing(cls, count: int) -> Fragments:
        """Return that nothing is seen."""
        return cls(
            np.full(count, np.inf, np.float32),
            np.zeros((count, 3), np.float32),
            np.empty((count, 3), np.uint8),
            np.full(count, -1, np.int32),
            np.full(count, -1, np.int32),
        )

    @classmethod
    def room(cls, count: int) -> Fragments:
        """Return room for fragments that are all going to be written."""
        return cls(
            room(count, np.float32),
            room((count, 3), np.float32),
            room((count, 3), np.uint8),
            room(count, np.int32),
            room(count, np.int32),
        )

    def __len__(self) -> int:
        return len(self.depth)

    @property
    def seen(self) -> Booleans:
        """Which lines see anything."""
        return np.asarray(self.leaf >= 0)

    def clear(self, rows: NDArray[np.int64]) -> None:
        """Let nothing be seen in some rows."""
        self.depth[rows], self.leaf[rows] = np.inf, -1

    def put(self, rows: NDArray[np.int64], other: Fragments) -> None:
        """Put other fragments into some rows, where they are nearer."""
        nearer = other.depth < self.depth[rows]
        to = rows[nearer]
        for name in ("depth", "normal", "color", "leaf", "row"):
            getattr(self, name)[to] = getattr(other, name)[nearer]
