"""Bundles: parallel lines in a few directions, the best lines for volumes and moments.

The integral of the length inside over all parallel lines is the volume, whatever their direction. So a few directions
do, and the low-discrepancy points are spent on two dimensions, the offsets, instead of four: at 65,536 lines the error
of a volume is 10 to 30 times smaller than with lines of all directions. Over evenly spread directions bundles are
lines of the invariant measure like any other, if coarse ones: areas are better counted with all directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.core.box import corners
from surfel.core.cast import Floats
from surfel.core.lines import Lines
from surfel.lines.sequences import unit_points

_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


@dataclass(frozen=True, eq=False)
class Bundles:
    """Parallel bundles that cover a set of points.

    Parameters
    ----------
    directions : Floats, shape (b, 3)
        Of each bundle.
    across : Floats, shape (b, 2, 3)
        Two unit vectors across each direction.
    low, size : Floats, shape (b, 2)
        The rectangle that each bundle fills.
    shift : Floats, shape (b, 2)
        Random shift of the offsets of each bundle.
    centre : Floats, shape (3,)
        A point in the middle.
    """

    directions: Floats
    across: Floats
    low: Floats
    size: Floats
    shift: Floats
    centre: Floats

    @classmethod
    def over(cls, points: Floats, number: int, seed: int, margin: float) -> Bundles:
        """Choose directions (a spherical Fibonacci set, turned at random) and the rectangles over the points.

        Parameters
        ----------
        points : Floats, shape (n, 3)
            All that is measured lies in their convex hull, grown by ``margin``.
        number : int
            How many bundles.
        seed : int
            Of the rotation and of the shifts.
        margin : float
            Added on all sides.
        """
        random = np.random.Generator(np.random.PCG64(np.random.SeedSequence((seed, 2))))
        turn = _random_rotation(random)
        step = np.arange(number)
        height = 1.0 - (step + 0.5) / number
        ring, angle = np.sqrt(1.0 - height * height), _GOLDEN_ANGLE * step
        directions = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1) @ turn.T
        across = np.stack([_frame(direction) for direction in directions])
        low, high = corners(points)
        centre = 0.5 * low + 0.5 * high
        low, high = np.empty((number, 2)), np.empty((number, 2))
        with threads_for(number * len(points)):
            _enclose(number, np.ascontiguousarray(points), centre, across, low, high)
        low, high = low - margin, high + margin
        return cls(directions, across, low, high - low, random.random((number, 2)), centre)

    def measure(self, bundle: int) -> float:
        """Return the line measure that one bundle stands for: 2 pi times its rectangle."""
        return float(2.0 * np.pi * self.size[bundle].prod())

    def lines(self, bundle: int, first: int, last: int, total: int) -> Lines:
        """Return lines ``first`` to ``last - 1`` of the ``total`` lines of a bundle."""
        one = slice(bundle, bundle + 1)
        return self._some(one, first, last, total)

    def block(self, first: int, last: int, total: int) -> Lines:
        """Return lines ``first`` to ``last - 1`` of the ``total`` lines of every bundle, bundle by bundle."""
        return self._some(slice(None), first, last, total)

    def _some(self, which: slice, first: int, last: int, total: int) -> Lines:
        points = unit_points("r4", first, last - first, 2)
        measure = 2.0 * np.pi * self.size[which].prod(axis=1)
        m = len(measure) * len(points)
        lines = Lines(np.empty((m, 3)), np.empty((m, 3)), np.empty(m))
        with threads_for(m):
            _fill(
                m, points, self.shift[which], self.low[which], self.size[which], self.centre, self.across[which],
                self.directions[which], measure, np.int64(total), lines.origins, lines.directions, lines.weights,
            )  # fmt: skip
        return lines


@rows
def _enclose(first, last, points, centre, across, low, high):
    """Write the rectangle of each bundle over the points."""
    for b in range(first, last):
        for k in range(2):
            x, y, z = across[b, k, 0], across[b, k, 1], across[b, k, 2]
            least, most = np.inf, -np.inf
            for i in range(len(points)):
                place = (points[i, 0] - centre[0]) * x + (points[i, 1] - centre[1]) * y + (points[i, 2] - centre[2]) * z
                least, most = min(least, place), max(most, place)
            low[b, k], high[b, k] = least, most


@rows
def _fill(first, last, points, shift, low, size, centre, across, directions, measure, total, origins, along, weights):
    """Write the lines of each bundle in turn, each through a shifted point of its rectangle."""
    for i in range(first, last):
        b, point = i // len(points), i % len(points)
        u, v = points[point, 0] + shift[b, 0], points[point, 1] + shift[b, 1]
        u = low[b, 0] + size[b, 0] * (u - 1.0 if u >= 1.0 else u)
        v = low[b, 1] + size[b, 1] * (v - 1.0 if v >= 1.0 else v)
        for k in range(3):
            origins[i, k] = centre[k] + u * across[b, 0, k] + v * across[b, 1, k]
            along[i, k] = directions[b, k]
        weights[i] = measure[b] / total


def _frame(direction: NDArray[np.float64]) -> Floats:
    helper = np.eye(3)[np.abs(direction).argmin()]
    first = np.cross(direction, helper)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])


def _random_rotation(random: np.random.Generator) -> Floats:
    """Return a uniformly random rotation: the orthogonal factor of a Gaussian matrix, its signs made unique."""
    q, r = np.linalg.qr(random.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q * np.sign(np.linalg.det(q)))
