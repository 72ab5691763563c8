"""HalfSpace: everything on one side of a plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from surfel.core.cast import Floats, as_direction, as_number, as_rows, as_vector
from surfel.core.errors import InputError
from surfel.core.patches import Patches
from surfel.shapes.primitives.faces import choose_face
from surfel.shapes.primitives.primitive import Convex, Primitive


@dataclass(frozen=True)
class HalfSpace(Primitive):
    """The points with ``normal . x <= offset``.

    Unbounded: it is measured within a tree that bounds it.

    Parameters
    ----------
    normal : sequence of three floats
        Out of the solid; need not have unit length.
    offset : float
        Of the plane, in lengths of ``normal``: ``offset / |normal|`` is its distance from the origin.

    Raises
    ------
    InputError
        If the normal is zero or a number is not finite.

    Examples
    --------
    >>> import surfel
    >>> below = surfel.HalfSpace((0, 0, 2), 1)
    >>> below.contains([[0, 0, 0.4], [0, 0, 0.6]]).tolist()
    [True, False]
    """

    normal: Sequence[float]
    offset: float

    def __post_init__(self) -> None:
        as_direction(self.normal, "normal")
        object.__setattr__(self, "normal", tuple(as_vector(self.normal, "normal").tolist()))
        object.__setattr__(self, "offset", as_number(self.offset, "offset"))

    @property
    def area(self) -> float:
        """Infinite."""
        return math.inf

    @property
    def volume(self) -> float:
        """Infinite."""
        return math.inf

    @property
    def bounds(self) -> Floats:
        """Infinite, but for the side of a plane across an axis; shape (2, 3)."""
        box = np.array([[-np.inf] * 3, [np.inf] * 3])
        axis = self._axis
        if axis is not None:
            box[1 if self.normal[axis] > 0.0 else 0, axis] = self.offset / self.normal[axis]
        return box

    @cached_property
    def _unit(self) -> tuple[Floats, float]:
        """The unit normal, and the distance of the plane from the origin along it."""
        unit = as_direction(self.normal, "normal")
        largest = int(np.argmax(np.abs(unit)))
        return unit, self.offset / self.normal[largest] * float(unit[largest])

    @property
    def _axis(self) -> int | None:
        """The axis that the plane lies across, if any."""
        used = np.flatnonzero(self.normal)
        return int(used[0]) if len(used) == 1 else None

    def _convex(self) -> Convex:
        low, high = np.full(3, -np.inf), np.full(3, np.inf)
        axis = self._axis
        if axis is not None:
            low, high = self.bounds  # no turn, so that equal planes of boxes give equal bits
            return np.concatenate([low, high, np.zeros(5)]), np.eye(4)
        unit, distance = self._unit
        placement = np.eye(4)
        placement[:3, :3] = np.column_stack([*_beside(unit), unit])
        high[2] = distance
        return np.concatenate([low, high, np.zeros(5)]), placement

    def _sample_within(self, uv: Floats, box: Floats) -> Patches:
        """Sample the polygon in which the plane cuts a box, evenly; nothing where it misses the box.

        Parameters
        ----------
        uv : Floats, shape (n, 2)
            In [0, 1).
        box : Floats, shape (2, 3)
            Its lowest and highest corner, finite.
        """
        corners = self._polygon(as_rows(box, "box", 2))
        if len(corners) < 3:
            return Patches(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
        a, b, c = corners[0], corners[1:-1], corners[2:]
        areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        triangle, u = choose_face(uv[:, 0], areas)
        root = np.sqrt(u)[:, None]
        v = uv[:, 1:]
        points = a + root * ((1.0 - v) * (b - a)[triangle] + v * (c - a)[triangle])
        normals = np.broadcast_to(self._unit[0], points.shape).copy()
        return Patches(points, normals, np.full(len(uv), areas.sum() / max(len(uv), 1)))

    def _polygon(self, box: Floats) -> Floats:
        """Return the corners of the polygon in which the plane cuts a box, in order round it, shape (k, 3)."""
        if not np.isfinite(box).all():
            raise InputError(f"box must be finite to sample a plane in it; got {box.tolist()}")
        unit, distance = self._unit
        across, along = _beside(unit)
        middle = 0.5 * (box[0] + box[1])
        foot = middle + (distance - float(unit @ middle)) * unit
        reach = 2.0 * float(np.linalg.norm(box[1] - box[0]))
        corners = np.array([foot + reach * (s * across + t * along) for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
        for axis in range(3):
            for side, sign in ((0, 1.0), (1, -1.0)):
                corners = _clip(corners, sign * (corners[:, axis] - box[side, axis]))
        return corners


def _beside(unit: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors that complete a unit vector to a right-handed frame."""
    helper = np.zeros(3)
    helper[int(np.argmin(np.abs(unit)))] = 1.0
    across = np.cross(helper, unit)
    across /= np.linalg.norm(across)
    return across, np.cross(unit, across)


def _clip(corners: Floats, height: Floats) -> Floats:
    """Return the part of a convex polygon where the height of its corners is not negative (Sutherland, Hodgman)."""
    kept: list[Floats] = []
    for k in range(len(corners)):
        here, before = height[k], height[k - 1]
        if (here < 0.0) != (before < 0.0):
            kept.append(corners[k - 1] + before / (before - here) * (corners[k] - corners[k - 1]))
        if here >= 0.0:
            kept.append(corners[k])
    return np.array(kept).reshape(-1, 3)
