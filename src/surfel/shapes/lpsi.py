"""Lpsi: a cloud made ready for the counter of Liu et al. (2006): octree, gap size and the radius of the cylinder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats, as_choice, as_count, as_positive
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.index.octree import DEEPEST, PointOctree, build_octree, nearest_squares
from surfel.lines.local import Local
from surfel.shapes.clusters import CELLS, Reading, clusters_on_lines
from surfel.surface.clean import SAME, duplicate_rows

if TYPE_CHECKING:
    from surfel.shapes.surfels import Surfels

CYLINDERS = ("even", "uneven")


@dataclass(frozen=True, eq=False)
class Lpsi:
    """Points in an octree, and how far from a line they are looked for.

    Parameters
    ----------
    local : Local
        The coordinates of the octree.
    tree : PointOctree
        Of the points, each place once.
    normals : Floats, shape (n, 3)
        In the order of the tree.
    gap : float
        d_max, in the units of the cloud.
    radii : Floats, shape (leaves,)
        The radius of the cylinder in each leaf, in the coordinates of the octree.
    reading : Reading
        Of the text where it is not clear.
    """

    local: Local
    tree: PointOctree
    normals: Floats
    gap: float
    radii: Floats
    reading: Reading

    @classmethod
    def of(
        cls,
        points: Floats,
        normals: Floats,
        radii: Floats | None = None,
        *,
        radius_factor: float = 1.5,
        depth: int = 4,
        cylinder: str = "even",
        reading: Reading | None = None,
    ) -> Lpsi:
        """Make points ready.

        Parameters
        ----------
        points, normals : Floats, shape (n, 3)
            At least two places; unit normals that point outward.
        radii : Floats, shape (n,), optional
            Of the surfels. With them d_max is the largest, without it is the mean distance to the nearest neighbour
            (section 4.1).
        radius_factor : float
            lambda of equation (7): the radius of the cylinder is lambda d_max.
        depth : int
            Of the octree. It changes the time, and what is a cell for the uneven cylinder.
        cylinder : {"even", "uneven"}
            One d_max for all, or one for each boundary cell (section 5.1).
        reading : Reading, optional
            Of the text where it is not clear.

        Raises
        ------
        InputError
            If a number is out of its range, or fewer than two places are left.
        """
        factor, levels = as_positive(radius_factor, "radius_factor"), as_count(depth, "depth", 1, DEEPEST)
        as_choice(cylinder, "cylinder", CYLINDERS)
        local = Local.of(points) if len(points) else Local(np.zeros(3), 0.0)
        if local.unit == 0.0:
            raise InputError(f"the {len(points)} points lie at fewer than two places: they show no surface")
        tree, squares = _set_of((points - local.middle) / local.unit, normals, levels)
        sizes = np.sqrt(squares) if radii is None else radii[tree.order] / local.unit
        gap, gaps = _gap_sizes(tree, sizes, largest=radii is not None)
        if not gap > 0.0:
            raise InputError("the radii of the surfels are all zero; leave them out, or give true ones")
        return cls(
            local, tree, normals[tree.order], gap * local.unit,
            factor * (gaps if cylinder == "uneven" else np.full(tree.leaves, gap)), reading or Reading(),
        )  # fmt: skip

    @property
    def radius(self) -> float:
        """The largest radius of the cylinder, in the units of the cloud."""
        return float(self.radii.max()) * self.local.unit

    @property
    def cell(self) -> float:
        """The side of the smallest cells, in the units of the cloud."""
        return 2.0 * float(self.tree.half[-1]) * self.local.unit

    def cross(self, lines: Lines, *, single: bool = False) -> Crossings:
        """Return the resultant clusters of every line as crossings of weight 1."""
        offsets, t, cosine = clusters_on_lines(
            self._inner(lines), self.tree, self.normals, self.radii, self.reading, single=single, places=True
        )
        return Crossings(offsets, t * self.local.unit, cosine, np.ones(len(t)), np.zeros(len(t), np.int32))

    def counts(self, lines: Lines, *, single: bool = False) -> Floats:
        """Return how many resultant clusters each line has, shape (m,)."""
        offsets, _, _ = clusters_on_lines(
            self._inner(lines), self.tree, self.normals, self.radii, self.reading, single=single, places=False
        )
        return np.diff(offsets).astype(np.float64)

    def _inner(self, lines: Lines) -> Lines:
        return Lines((lines.origins - self.local.middle) / self.local.unit, lines.directions, lines.weights)


def counter_of(
    cloud: Surfels, radius_factor: float = 1.5, depth: int = 4, cells: str = "line", cylinder: str = "even"
) -> Lpsi:
    """Make a cloud ready: its points with normals, and its radii where it has any."""
    reading = Reading(as_choice(cells, "cells", CELLS))
    normals, rows = normals_for(cloud)
    radii = None if cloud.radii is None else cloud.radii[rows]
    return Lpsi.of(
        cloud.points[rows], normals, radii, radius_factor=radius_factor, depth=depth, cylinder=cylinder, reading=reading
    )


def normals_for(cloud: Surfels) -> tuple[Floats, NDArray[np.int64] | slice]:
    """Return unit normals, and which rows of the cloud they belong to.

    Those that were given, without the points where none is known; where no point has one, those that are fitted.
    """
    normals = cloud.normals
    if normals is None or not normals.any():
        normals = cloud.surface.patches.normals if len(cloud) else np.empty((0, 3))
    x, y, z = normals.T
    known = (x != 0.0) | (y != 0.0) | (z != 0.0)
    if known.all():
        return normals, slice(None)
    return normals[known], np.flatnonzero(known)


def _set_of(place: Floats, normals: Floats, depth: int) -> tuple[PointOctree, Floats]:
    """Return the octree of a set of points, each place once, and the squared distances to the nearest others."""
    tree = build_octree(place, depth)
    squares = nearest_squares(tree)
    doubled = duplicate_rows(tree.points, normals[tree.order], squares[:, None]) if squares.min() <= SAME * SAME else ()
    if not len(doubled):
        return tree, squares
    rows = np.delete(tree.order, doubled)
    tree = build_octree(place[rows], depth)
    return tree._replace(order=rows[tree.order]), nearest_squares(tree)


def _gap_sizes(tree: PointOctree, sizes: Floats, *, largest: bool) -> tuple[float, Floats]:
    """Return d_max of all points and of those of each leaf: the largest radius, or the mean distance."""
    if largest:
        return float(sizes.max()), np.maximum.reduceat(sizes, tree.starts)
    return float(sizes.mean()), np.add.reduceat(sizes, tree.starts) / tree.counts
