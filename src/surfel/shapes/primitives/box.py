"""Box: a cuboid with its faces across the axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surfel.core.cast import Floats
from surfel.core.patches import Patches
from surfel.shapes.primitives.faces import choose_face
from surfel.shapes.primitives.primitive import Convex, Primitive
from surfel.shapes.primitives.sizes import as_sizes


@dataclass(frozen=True)
class Box(Primitive):
    """A cuboid, centred at the origin.

    Parameters
    ----------
    size : float or sequence of three floats
        Lengths of the edges along x, y and z; one number gives a cube.

    Raises
    ------
    InputError
        If a length is not positive and finite.

    Examples
    --------
    >>> import surfel
    >>> box = surfel.Box((1, 2, 3))
    >>> box.area, box.volume
    (22.0, 6.0)
    """

    size: float | Sequence[float]

    sampled = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", as_sizes(self.size, "size"))

    @property
    def _half(self) -> Floats:
        return 0.5 * np.asarray(self.size, float)

    @property
    def _pairs(self) -> Floats:
        """The areas of the faces across x, y and z."""
        x, y, z = np.asarray(self.size, float)
        return np.array([y * z, z * x, x * y])

    @property
    def area(self) -> float:
        """The exact area."""
        return 2.0 * math.fsum(self._pairs)

    @property
    def volume(self) -> float:
        """The exact volume."""
        x, y, z = (float(edge) for edge in np.asarray(self.size))
        return x * y * z

    @property
    def bounds(self) -> Floats:
        """The lowest and the highest corner, shape (2, 3)."""
        return np.stack([-self._half, self._half])

    def _convex(self) -> Convex:
        return np.concatenate([-self._half, self._half, np.zeros(5)]), np.eye(4)

    def _sample(self, uv: Floats) -> Patches:
        """Share the square out to the six faces; the map keeps areas."""
        face, u = choose_face(uv[:, 0], np.repeat(self._pairs, 2))
        axis, sign = face // 2, np.where(face % 2 == 0, -1.0, 1.0)
        rows = np.arange(len(uv))
        unit = np.empty((len(uv), 3))
        unit[rows, axis] = sign
        unit[rows, (axis + 1) % 3] = 2.0 * u - 1.0
        unit[rows, (axis + 2) % 3] = 2.0 * uv[:, 1] - 1.0
        normals = np.zeros((len(uv), 3))
        normals[rows, axis] = sign
        return Patches(unit * self._half, normals, np.full(len(uv), self.area / max(len(uv), 1)))
