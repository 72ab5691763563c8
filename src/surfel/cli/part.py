"""The demo's part: a block with a round hole through it, whose area and volume are known in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from surfel.core.cast import Floats


@dataclass(frozen=True)
class BoredBlock:
    """A block with a round hole along z, centred on the origin.

    Parameters
    ----------
    width, depth, height : float
        Along x, y and z.
    radius : float
        Of the hole; less than half of width and depth.

    Examples
    --------
    >>> part = BoredBlock(4.0, 3.0, 2.0, 0.8)
    >>> round(part.area, 4), round(part.volume, 4)
    (58.0319, 19.9788)
    """

    width: float = 4.0
    depth: float = 3.0
    height: float = 2.0
    radius: float = 0.8

    @property
    def area(self) -> float:
        """Six rectangles, less two disks, and the wall of the hole."""
        w, d, h, r = self.width, self.depth, self.height, self.radius
        return 2.0 * (w * d + d * h + h * w) - 2.0 * math.pi * r * r + 2.0 * math.pi * r * h

    @property
    def volume(self) -> float:
        """The block, less the cylinder."""
        return (self.width * self.depth - math.pi * self.radius**2) * self.height

    def sample(self, number: int, seed: int = 0) -> tuple[Floats, Floats]:
        """Return independent uniform points of the surface and the outward normals there.

        Parameters
        ----------
        number : int
            How many points.
        seed : int
            Of the pseudo-random numbers.

        Returns
        -------
        points, normals : Floats, shape (number, 3)
            Mixed: the order says nothing about the face.
        """
        import numpy as np

        rng = np.random.default_rng(seed)
        w, d, h, r = self.width, self.depth, self.height, self.radius
        lid = w * d - math.pi * r * r
        faces = np.array([d * h, d * h, h * w, h * w, lid, lid, 2.0 * math.pi * r * h])
        counts = rng.multinomial(number, faces / faces.sum())
        half = 0.5 * np.array([w, d, h])

        points, normals = [], []
        for face, count in enumerate(counts[:6]):
            axis, sign = face // 2, 1.0 - 2.0 * (face % 2)
            place = self._on_rectangle(rng, axis, count)
            place[:, axis] = sign * half[axis]
            points.append(place)
            normals.append(np.tile(sign * np.eye(3)[axis], (count, 1)))

        angle = rng.uniform(0.0, 2.0 * math.pi, counts[6])
        across = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(counts[6])])
        points.append(r * across + np.outer(rng.uniform(-half[2], half[2], counts[6]), [0.0, 0.0, 1.0]))
        normals.append(-across)

        order = rng.permutation(number)
        return np.concatenate(points)[order], np.concatenate(normals)[order]

    def _on_rectangle(self, rng: np.random.Generator, axis: int, count: int) -> Floats:
        """Return uniform points of the block's cross-section normal to ``axis``; those above the hole are redrawn."""
        import numpy as np

        half = 0.5 * np.array([self.width, self.depth, self.height])
        place = rng.uniform(-half, half, (count, 3))
        if axis == 2:
            while (inside := np.hypot(place[:, 0], place[:, 1]) < self.radius).any():
                place[inside] = rng.uniform(-half, half, (int(inside.sum()), 3))
        return np.asarray(place)
