"""A terrain as cut and fill sees it: heights over a lattice, from all of its points and from either half of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel
from surfel.core.cast import Booleans, Floats, Integers
from surfel.core.errors import InputError
from surfel.index.neighbours import PointIndex
from surfel.measuring.cut_and_fill_delaunay import delaunay, on_lattice
from surfel.measuring.cut_and_fill_region import Lattice

REACH = 3.0
"""A place is seen where a point lies within so many spacings: random points leave one in 1e12 unseen."""

_LEAST_MORE = 0.25  # by which the squared sides grow at the least when the points are halved

_ROUND = 12  # neighbours that tell the local spacing, and carry a plane beyond the outermost triangles
_STEEP, _OFTEN = 8.0, 0.01  # roughness against the cloud's own, and the share of the points, that make it no terrain
_ROUGHNESS_OF = 20_000


class Heights(NamedTuple):
    """Heights at the cells of a lattice that lie in its polygon, in the order of their numbers.

    Parameters
    ----------
    all_points, first_half, second_half : Floats, shape (m,)
        From all points, and from every other one of them along a curve.
    missed : Floats, shape (m,)
        What straight lines between all points may miss of a curved surface: in the mean over some cells, not in each.
    seen : Booleans, shape (m,)
        Where there are points nearby.
    """

    all_points: Floats
    first_half: Floats
    second_half: Floats
    missed: Floats
    seen: Booleans


@dataclass(frozen=True, eq=False)
class Base:
    """A plane of which the height is ``height + slope . place``.

    Parameters
    ----------
    height : float
        At the origin of the plane across the direction.
    slope : Floats, shape (2,)
        Rise a unit of length.
    """

    height: float
    slope: Floats

    def over(self, lattice: Lattice, cells: Integers) -> Heights:
        """Return the heights at cells."""
        height = self.height + lattice.places(cells) @ self.slope
        return Heights(height, height, height, np.zeros(len(cells)), np.ones(len(cells), bool))


class Terrain:
    """Points with heights over a plane; of points at one place the mean counts.

    Parameters
    ----------
    plane : Floats, shape (n, 2)
        Where the points lie across the direction.
    heights : Floats, shape (n,)
        Along it.
    name : str
        What errors call it.

    Attributes
    ----------
    spacing : float
        Side of the square that a point has to itself, in the mean over the box of the points.
    """

    def __init__(self, plane: Floats, heights: Floats, name: str) -> None:
        if len(plane) < 3:
            raise InputError(f"{name} has {len(plane)} points in and near the region; a surface needs three")
        self.name = name
        self._low = plane.min(axis=0)
        self._size = float(np.ptp(plane, axis=0).max())
        self._index = PointIndex(np.column_stack([plane - self._low, np.zeros(len(plane))]))
        order = self._index.order
        self._places, self._heights = _distinct(on_lattice(plane[order], self._low, self._size), heights[order])
        width = np.ptp(plane, axis=0)
        self.spacing = float(np.sqrt(width[0] * width[1] / len(self._places)))
        self._steps = self._size / ((1 << 26) - 1)
        self._given = heights[order]

    @property
    def points(self) -> int:
        """How many points it has."""
        return len(self._given)

    def over(self, lattice: Lattice, cells: Integers) -> Heights:
        """Return the heights at cells, in straight lines across what was not seen.

        Under a curved surface, triangles miss what grows with the squares of their sides (for a quadric with Hessian H
        the area times sum(e . H e) / 24 over their sides e). So the squares tell how the step from half of the points
        to all of them goes on.
        """
        every = np.arange(len(self._places))
        whole, long, squares = self._interpolated(every, lattice, cells)
        (first, _, first_squares), (second, _, second_squares) = (
            self._interpolated(every[start::2], lattice, cells) for start in (0, 1)
        )
        more = max(_LEAST_MORE, 0.5 * (first_squares + second_squares) / squares - 1.0) if squares > 0.0 else 1.0
        places = np.column_stack([lattice.places(cells) - self._low, np.zeros(len(cells))])
        seen = np.ones(len(cells), bool)
        doubt = np.flatnonzero(long)
        if len(doubt):
            seen[doubt] = self._is_near(places[doubt])
        for height in (whole, first, second):
            beyond = np.flatnonzero(np.isnan(height))
            if len(beyond):
                height[beyond] = self._extended(places[beyond])
        return Heights(whole, first, second, (whole - 0.5 * (first + second)) / more, seen)

    def steep_share(self) -> float:
        """Return the share of the points that stand out from their neighbours as walls, trees and overhangs do.

        Noise is everywhere alike. What stands out by far more than half of the points do, and by more than the
        spacing, is no noise; nor is what stands out everywhere by a twentieth of the cloud's width.
        """
        n = self.points
        if n < 4 * _ROUND:
            return 0.0
        rows = np.unique(np.linspace(0, n - 1, min(n, _ROUGHNESS_OF)).astype(np.int32))
        squares, near = self._index.knn(_ROUND, rows)
        off = self._given[near] - self._given[rows, None]
        rough = np.abs(off - np.median(off, axis=1, keepdims=True)).mean(axis=1)
        spacing = np.sqrt(squares[:, -1] * (np.pi / _ROUND)) + 1e-300
        usual = float(np.median(rough))
        if usual > 0.05 * self._size and usual > REACH * self.spacing:
            return 1.0
        share = float(np.mean((rough > _STEEP * usual) & (rough > spacing)))
        return share if share > _OFTEN else 0.0

    def _interpolated(
        self, rows: NDArray[np.int64], lattice: Lattice, cells: Integers
    ) -> tuple[Floats, NDArray[np.uint8], float]:
        """Return heights on the triangles of some points, NaN outside of them, where triangles are long, and the mean
        square of the sides of those that are not.
        """
        places = np.ascontiguousarray(self._places[rows])
        triangles = delaunay(places)
        triangles = triangles[
            np.argsort(triangles[:, 0])
        ]  # as the points along the curve: neighbours follow each other
        if not len(triangles):
            raise InputError(f"the points of {self.name} in and near the region lie on one line")
        corners = (places * self._steps + (self._low - lattice.low)) / lattice.step
        height, long = np.full(lattice.shape, np.nan), np.ones(lattice.shape, np.uint8)
        limit = (REACH * self.spacing / lattice.step) ** 2  # in cells
        squares = _rasterise(triangles, corners, self._heights[rows], lattice.slot, lattice.middle, limit, height, long)
        return height.ravel()[cells], long.ravel()[cells], squares

    def _is_near(self, places: Floats) -> Booleans:
        """Tell where the nearest point is within reach, by the spacing there or that of the whole."""
        squares, nearest = self._index.knn_of(places, 1)
        rows, back = np.unique(nearest[:, 0], return_inverse=True)
        k = min(_ROUND, self.points - 1)
        local = np.sqrt(self._index.knn(k, rows.astype(np.int32))[0][:, -1] * (np.pi / k))[back]
        return np.asarray(squares[:, 0] <= (REACH * np.maximum(local, self.spacing)) ** 2)

    def _extended(self, places: Floats) -> Floats:
        """Return heights beyond the outermost triangles, on planes through the nearest points."""
        k = min(_ROUND, self.points)
        near = self._index.knn_of(places, k)[1]
        around = (self._index.points + self._index.origin)[near][:, :, :2]
        height = self._given[near]
        middle, level = around.mean(axis=1, keepdims=True), height.mean(axis=1, keepdims=True)
        off, rise = around - middle, height - level
        matrix = np.einsum("nki,nkj->nij", off, off)
        matrix += np.eye(2) * (1e-3 * np.trace(matrix, axis1=1, axis2=2) + 1e-300)[:, None, None]
        slope = np.linalg.solve(matrix, np.einsum("nki,nk->ni", off, rise)[..., None])[..., 0]
        away = places[:, :2] - middle[:, 0]
        most = np.abs(off).max(axis=(1, 2))[:, None]  # no farther than the points themselves reach
        return np.asarray(level[:, 0] + np.sum(np.clip(away, -2.0 * most, 2.0 * most) * slope, axis=1))


def _distinct(places: Floats, heights: Floats) -> tuple[Floats, Floats]:
    """Return each place once, in the order given, with the mean height there."""
    key = places[:, 0].astype(np.int64) * (1 << 27) + places[:, 1].astype(np.int64)
    _, first, back, count = np.unique(key, return_index=True, return_inverse=True, return_counts=True)
    if len(first) == len(places):
        return places, heights
    mean = np.bincount(back, heights) / count
    order = np.argsort(first)
    return np.ascontiguousarray(places[first[order]]), mean[order]


@kernel
def _rasterise(triangles, corners, heights, slot, middle, limit, height, long):
    """Write the height at every cell of the polygon that a triangle holds, and whether that has a long side.

    Returns the mean over the area of the sums of squared sides, of triangles over the lattice without a long side.
    """
    columns, cells = slot.shape
    total = squares = 0.0
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay, bx, by, cx, cy = (
            corners[a, 0],
            corners[a, 1],
            corners[b, 0],
            corners[b, 1],
            corners[c, 0],
            corners[c, 1],
        )
        first_u, last_u = max(0.0, min(min(ax, bx), cx)), min(columns - 0.5, max(max(ax, bx), cx))
        first_v, last_v = max(0.0, min(min(ay, by), cy)), min(cells - 0.5, max(max(ay, by), cy))
        if first_u > last_u or first_v > last_v:
            continue
        ux, uy, vx, vy = bx - ax, by - ay, cx - ax, cy - ay
        area = ux * vy - uy * vx
        if area <= 0.0:
            continue
        wx, wy = cx - bx, cy - by
        uu, vv, ww = ux * ux + uy * uy, vx * vx + vy * vy, wx * wx + wy * wy
        far = max(max(uu, vv), ww) > limit
        if max(max(uu, vv), ww) <= 2.0 * limit:  # the same for all points as for half of them
            total += area
            squares += area * (uu + vv + ww)
        base, rise_b, rise_c = heights[a], heights[b] - heights[a], heights[c] - heights[a]
        for i in range(int(first_u), int(last_u) + 1):
            for j in range(int(first_v), int(last_v) + 1):
                s = slot[i, j]
                if s == -2:
                    continue
                x, y = i + 0.5, j + 0.5
                if s >= 0:
                    x, y = middle[s, 0], middle[s, 1]
                x -= ax
                y -= ay
                p, q = (x * vy - y * vx) / area, (ux * y - uy * x) / area
                if p >= -1e-9 and q >= -1e-9 and p + q <= 1.0 + 1e-9:
                    height[i, j] = base + p * rise_b + q * rise_c
                    long[i, j] = 1 if far else 0
    return squares / total if total > 0.0 else 0.0
