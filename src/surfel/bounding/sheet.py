"""A safe spline as a shape: an exact sheet over the trimmed domain, which lines cross and patches cover."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from surfel.bounding.evaluate import derivatives
from surfel.bounding.facing import cosines, in_domain
from surfel.bounding.occupancy import HIGH, LEFT, LOW, RIGHT, WHOLE
from surfel.bounding.rays import Hits, Sheet, find_hits
from surfel.core.cast import Floats, read_only
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.core.patches import Patches
from surfel.shapes.primitives.primitive import Primitive

if TYPE_CHECKING:
    from surfel.bounding.spline import SafeSpline

_SAME = 1e-11
_FIRST_ORDER, _LAST_ORDER, _MOST_PLACES = 4, 32, 4_000_000
_TURNS = {LEFT: (-1.0, 0.0), RIGHT: (1.0, 0.0), LOW: (0.0, -1.0), HIGH: (0.0, 1.0)}
"""From the middle of a cell to that of the side at which a quarter lies, in half cells."""


class SplineSheet(Primitive):
    """The trimmed graph of a safe spline as an exact sheet.

    Its normals point away from the points that the spline bounds. Made by :meth:`SafeSpline.sheet`; ``transformed``
    and the operators of shapes work on it as on any primitive.

    Parameters
    ----------
    spline : SafeSpline
        The surface.
    """

    sampled: ClassVar[bool] = True

    def __init__(self, spline: SafeSpline) -> None:
        self.spline = spline

    @property
    def solid(self) -> bool:
        """False: a sheet has no inside."""
        return False

    @cached_property
    def bounds(self) -> Floats:
        """The lowest and the highest corner of an axis-aligned box round the trimmed surface, shape (2, 3)."""
        kept = np.argwhere(self.spline.trim)
        low, high = (table[kept[:, 0], kept[:, 1]] for table in (self._cells.low, self._cells.high))
        corners = [
            self.spline.frame.to_world(kept + np.array([i, j]), heights)
            for i in (0.0, 1.0)
            for j in (0.0, 1.0)
            for heights in (low, high)
        ]
        least, most = np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))
        slack = 1e-14 * np.maximum(np.abs(least), np.abs(most))
        return read_only(np.stack([least - slack, most + slack]))

    @cached_property
    def area(self) -> float:
        """The area of the trimmed surface, by Gauss quadrature of each cell, to about eleven digits."""
        order = _FIRST_ORDER
        known = self._area_by(order)
        while 2 * order <= _LAST_ORDER and (2 * order) ** 2 * np.count_nonzero(self.spline.trim) <= _MOST_PLACES:
            order *= 2
            before, known = known, self._area_by(order)
            if abs(known - before) <= _SAME * known:
                break
        return known

    def find(self, lines: Lines, start: float, *, first_only: bool) -> Hits:
        """Find where lines meet the sheet, from a t on; see :func:`surfel.bounding.rays.find_hits`."""
        return find_hits(self._cells, *self._in_domain(lines), start, first_only=first_only)

    def crossings(self, lines: Lines, start: float, *, first_only: bool, inverse: Floats | None = None) -> Crossings:
        """Return where lines meet the sheet as crossings: with the cosine between line and normal."""
        placed, frame = self._in_domain(lines), self.spline.frame
        hits = find_hits(self._cells, *placed, start, first_only=first_only)
        turn = frame.rotation if inverse is None else frame.rotation @ inverse[:, :3]
        axes = self._outward * turn * np.array([[-frame.scale[0]], [-frame.scale[1]], [1.0]])
        cosine = cosines(self.spline.coefficients, *placed, hits, axes, self._outward)
        return Crossings(hits.offsets, hits.t, cosine, np.ones(len(hits.t)), np.zeros(len(hits.t), np.int32))

    @cached_property
    def _cells(self) -> Sheet:
        return Sheet.of(self.spline.coefficients, self.spline.trim)

    @property
    def _outward(self) -> float:
        return -1.0 if self.spline.side == "below" else 1.0

    def _in_domain(self, lines: Lines) -> tuple[Floats, Floats]:
        """Return origins and directions of lines in domain coordinates; t stays what it is."""
        return in_domain(lines.origins, lines.directions, self.spline.frame)

    def _gradients(self, uv: Floats) -> tuple[Floats, Floats]:
        """Return heights and outward normals, not of unit length but with 1 along the direction, both over uv."""
        found = derivatives(self.spline.coefficients, np.ascontiguousarray(uv))
        frame = self.spline.frame
        slopes = found[:, 1:3] * frame.scale
        return self._outward * (frame.direction - slopes @ frame.rotation[:2]), found[:, 0]

    def _stretch(self, normals: Floats) -> Floats:
        """Return by how much the surface is larger than its domain, cells to square units."""
        return np.asarray(np.sqrt(np.einsum("ij,ij->i", normals, normals)) / np.prod(self.spline.frame.scale))

    def _area_by(self, order: int) -> float:
        uv, weights = _gauss_places(self.spline.trim, order)
        return float(weights @ self._stretch(self._gradients(uv)[0]))

    def _cross_placed(self, lines: Lines, inverse: Floats) -> Crossings:
        own = Lines(
            np.ascontiguousarray(lines.origins @ inverse[:, :3].T + inverse[:, 3]),
            np.ascontiguousarray(lines.directions @ inverse[:, :3].T),
            lines.weights,
        )
        return self.crossings(own, -np.inf, first_only=False, inverse=inverse)

    def _cross(self, lines: Lines) -> Crossings:
        return self.crossings(lines, -np.inf, first_only=False)

    def _sample(self, uv: Floats) -> Patches:
        places = _spread(self.spline.trim, uv)
        normals, heights = self._gradients(places)
        areas = self._stretch(normals)
        points = self.spline.frame.to_world(places, heights)
        unit = normals / np.sqrt(np.einsum("ij,ij->i", normals, normals))[:, None]
        return Patches(points, unit, areas * (self.area / areas.sum()))

    def _contains(self, points: Floats) -> NDArray[np.bool_]:
        raise InputError(
            "a safe spline is a sheet: it has no inside; compare heights, s(points) with s.to_domain(points)"
        )

    def __repr__(self) -> str:
        return f"{self.spline!r}.sheet()"


def _gauss_places(trim: NDArray[np.uint8], order: int) -> tuple[Floats, Floats]:
    """Return places and weights of a quadrature over what is kept: whole cells at once, others by their quarters."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    a, b = (grid.ravel() for grid in np.meshgrid(nodes, nodes, indexing="ij"))
    both = np.outer(weights, weights).ravel()
    whole = np.argwhere(trim == WHOLE)
    places: list[Floats] = [np.asarray(whole[:, None, :] + np.stack([a, b], axis=1), np.float64).reshape(-1, 2)]
    shares: list[Floats] = [np.tile(both, len(whole))]
    for quarter in _TURNS:
        some = np.argwhere((trim != WHOLE) & (trim & quarter != 0))
        inside = _in_quarter(np.full(len(a), quarter), a, b)
        places.append((some[:, None, :] + inside).reshape(-1, 2))
        shares.append(np.tile(0.5 * a * both, len(some)))  # a runs from the middle out, where the quarter is wider
    return np.concatenate(places), np.concatenate(shares)


def _in_quarter(quarters: NDArray[np.int64], a: Floats, b: Floats) -> Floats:
    """Map the unit square onto a quarter of the unit cell: a from its middle to its side, b along the side (Duffy)."""
    turns = np.zeros((16, 2))
    for quarter, turn in _TURNS.items():
        turns[quarter] = turn
    out = turns[quarters]
    across = np.stack([-out[:, 1], out[:, 0]], axis=1)
    return np.asarray(0.5 + 0.5 * a[:, None] * (out + (2.0 * b[:, None] - 1.0) * across))


def _spread(trim: NDArray[np.uint8], uv: Floats) -> Floats:
    """Map the unit square onto what is kept of the domain, areas to areas: quarter by quarter along the first axis."""
    quarters = [(h, k, quarter) for h, k in np.argwhere(trim).tolist() for quarter in _TURNS if trim[h, k] & quarter]
    table = np.array(quarters, np.int64)
    along = uv[:, 0] * len(table)
    which = np.minimum(along.astype(np.int64), len(table) - 1)
    chosen = table[which]
    return np.asarray(chosen[:, :2] + _in_quarter(chosen[:, 2], np.sqrt(along - which), uv[:, 1]))
