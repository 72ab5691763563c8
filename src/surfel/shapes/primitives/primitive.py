"""Primitive: the contract of exact solids that are centred at the origin."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.affine import as_affine, box_under
from surfel.core.cast import Floats
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.core.patches import Patches
from surfel.shapes.base import CORNERS, MARGIN, Shape

if TYPE_CHECKING:
    from surfel.shapes.placed import Placed
    from surfel.shapes.tree import Tree

Convex = tuple[Floats, Floats]
"""The form (11,) and the placement (4, 4) of a convex primitive; see :meth:`Primitive._convex`."""

_HERE = np.eye(4)[:3]
_SIDES = 24
"""Sides of the polygon round a circle: it is 0.9 % larger."""


class Primitive(Shape):
    """An exact solid (or sheet) in its own frame.

    A convex primitive is described by ``_convex``, and the kernel that sweeps a tree crosses it. Any other one writes
    ``_cross_placed``. One whose surface can be sampled writes ``_sample`` and says so by ``sampled``.
    """

    sampled: ClassVar[bool] = False
    """Whether points can be drawn from the surface, so that its area can be found by patches."""

    @property
    def solid(self) -> bool:
        """Whether there is an inside; else the shape is a sheet."""
        return True

    @property
    def area(self) -> float | None:
        """The exact area of the surface; infinite, or None where no closed form or quadrature is known."""
        return None

    @property
    def volume(self) -> float | None:
        """The exact volume; infinite, or None where no closed form or quadrature is known."""
        return None

    def _convex(self) -> Convex | None:
        """Return what describes a convex primitive; None for any other.

        Returns
        -------
        form : Floats, shape (11,)
            Three low and three high ends of slabs along the axes, infinite where there is none; then a, b, c, d, e of
            ``a x^2 + b y^2 + c z^2 + d z + e <= 0``, all zero where there is none.
        placement : Floats, shape (4, 4)
            From the frame of the form to that of the primitive.
        """
        return None

    def _cross_placed(self, lines: Lines, inverse: Floats) -> Crossings:
        """Cross the primitive where ``inverse`` (3, 4) maps points of the world to its own frame.

        Directions are mapped without being normalised, so that t is the world's. A solid's events alternate in, out,
        in, out; one that is unbounded begins with t = -inf where the line comes from its inside, and ends likewise.
        """
        raise NotImplementedError(f"{type(self).__name__} has neither a convex form nor a crossing of its own")

    def _sample(self, uv: Floats) -> Patches:
        """Return an element of the surface for each point of the unit square; their areas sum to the area."""
        raise InputError(f"the surface of a {type(self).__name__} cannot be sampled; cross it with lines instead")

    def _bounds_under(self, matrix: Floats) -> Floats:
        """Return the box round the primitive under an affine map; tight for ellipsoids, cylinders and cones."""
        loose = box_under(matrix, self.bounds)
        convex = self._convex()
        if convex is None:
            return loose
        form, placement = convex
        tight = _box_of_round(form, matrix @ placement)
        return loose if tight is None else np.stack([np.maximum(loose[0], tight[0]), np.minimum(loose[1], tight[1])])

    def _hull(self) -> tuple[Floats, float]:
        """Return the corners of a polyhedron round the primitive; close to it where it is round."""
        convex = self._convex()
        corners = None if convex is None else _corners_round(*convex)
        points = self.bounds[CORNERS, range(3)] if corners is None else corners
        return points, MARGIN * float(np.abs(points).max())

    def transformed(self, matrix: ArrayLike) -> Placed:
        """Return the primitive under an affine map.

        Parameters
        ----------
        matrix : array_like, shape (4, 4)
            The last row is 0 0 0 1.

        Raises
        ------
        InputError
            If the matrix is not affine, not finite or singular.
        """
        from surfel.shapes.placed import Placed

        return Placed(self, as_affine(matrix))

    @cached_property
    def _alone(self) -> Tree:
        """The tree of this one leaf, whose kernel crosses convex primitives."""
        from surfel.shapes.tree import Union

        return Union(self)

    def _events(self, lines: Lines) -> Crossings:
        return self._cross_placed(lines, _HERE)

    def _cross(self, lines: Lines) -> Crossings:
        return self._alone._cross(lines)

    def _is_sheet(self) -> bool:
        return not self.solid

    def _patches(self, n: int) -> Patches:
        return self._sample(square_points(n))

    def _contains(self, points: Floats) -> NDArray[np.bool_]:
        return self._alone._contains(points)


def square_points(n: int) -> Floats:
    """Return n points of the R2 sequence in the unit square (M. Roberts, 2018), shape (n, 2)."""
    plastic = 1.324717957244746025960908854
    steps = np.array([1.0 / plastic, 1.0 / plastic**2])
    return np.asarray((0.5 + np.arange(1, n + 1)[:, None] * steps) % 1.0)


def _box_of_round(form: Floats, matrix: Floats) -> Floats | None:
    """Return the box round an ellipsoid, or round the two end disks of a cylinder or a cone, under a map."""
    a, b, c, d, e = form[6:]
    if a <= 0.0 or b <= 0.0:
        return None
    linear, shift = matrix[:3, :3], matrix[:3, 3]
    if c > 0.0:
        square = d * d / (4.0 * c) - e
        reach = np.sqrt((linear**2) @ (square / np.array([a, b, c])))
        middle = shift - linear[:, 2] * (0.5 * d / c)
        return np.stack([middle - reach, middle + reach])
    ends = []
    for z in (form[2], form[5]):
        square = max(-(c * z * z + d * z + e), 0.0) if math.isfinite(z) else math.inf
        if not math.isfinite(square):
            return None
        reach = np.sqrt((linear[:, :2] ** 2) @ (square / np.array([a, b])))
        middle = shift + linear[:, 2] * z
        ends.append((middle - reach, middle + reach))
    return np.stack([np.minimum(ends[0][0], ends[1][0]), np.maximum(ends[0][1], ends[1][1])])


def _corners_round(form: Floats, placement: Floats) -> Floats | None:
    """Return the corners of a polyhedron round a bounded ellipsoid, cylinder or cone; None for anything else."""
    box = _box_of_round(form, np.eye(4))
    if box is None or not np.isfinite(box).all():
        return None
    middle, half = 0.5 * (box[0] + box[1]), 0.5 * (box[1] - box[0])
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) / math.cos(math.pi / _SIDES)
    if form[8] > 0.0:  # circles of latitude on a slightly larger ellipsoid, and its poles
        grown = 1.0 / math.cos(math.pi / _SIDES)
        levels = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _SIDES // 2 + 1)
        unit = np.concatenate(
            [np.column_stack([ring * math.cos(v), np.full(_SIDES, grown * math.sin(v))]) for v in levels]
        )
        points = middle + unit * half * grown
    else:
        ends = []
        for z in (form[2], form[5]):
            square = max(-(form[8] * z * z + form[9] * z + form[10]), 0.0)
            ends.append(np.column_stack([ring * np.sqrt(square / form[6:8]), np.full(_SIDES, z)]))
        points = np.concatenate(ends)
    return np.asarray(points @ placement[:3, :3].T + placement[:3, 3])
