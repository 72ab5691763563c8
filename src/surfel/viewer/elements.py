"""Elements: the disks by which a part is shown, in the coordinates that it came in."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.rendering.splats import splats_of
from surfel.shapes.base import Shape
from surfel.shapes.primitives.box import Box
from surfel.shapes.sample import sample
from surfel.shapes.surfels import Surfels

MOST = 200_000
"""Disks of one part; of larger clouds some are shown, and these larger, so that a browser keeps up."""

_OF_SOLIDS = 10_000
_ON_THE_BOX = 1e-6


class Elements(NamedTuple):
    """Disks of a part: places, unit normals, radii, and colors where it has any; one row for each."""

    points: Floats
    normals: Floats
    radii: Floats
    colors: NDArray[np.uint8] | None

    def rows(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Elements:
        """Return some of them."""
        colors = None if self.colors is None else self.colors[chosen]
        return Elements(self.points[chosen], self.normals[chosen], self.radii[chosen], colors)


def elements_of(shape: Shape, box: Floats, most: int = MOST) -> Elements:
    """Return the disks of a shape.

    Parameters
    ----------
    shape : Shape
        A cloud gives its surfels; what is exact is sampled evenly.
    box : Floats, shape (2, 3)
        Where a shape without end is to be seen.
    most : int
        How many disks a cloud may have.

    Raises
    ------
    InputError
        If a surface cannot be sampled.
    """
    if isinstance(shape, Surfels):
        return _of_cloud(shape, most)
    if np.isfinite(np.asarray(shape.bounds)).all():
        points, normals = sample(shape, _OF_SOLIDS, kind="blue")[:2]
    else:
        points, normals = _in_box(shape, box)
    return _of_cloud(Surfels(points, normals), most)


def _of_cloud(cloud: Surfels, most: int) -> Elements:
    splats = splats_of(cloud)
    if splats is None:
        return Elements(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), None)
    whole = Elements(splats.places(), splats.upright(), splats.radii, splats.colors)
    return thinned(whole, np.zeros(len(whole.points), np.bool_), most)[0]


def thinned(whole: Elements, precious: NDArray[np.bool_], most: int) -> tuple[Elements, NDArray[np.intp]]:
    """Return about ``most`` of the disks, and their rows: all that are precious, and every so many of the others.

    What is left out is covered by larger disks.
    """
    others = np.flatnonzero(~precious)
    room = max(1, most - (len(precious) - len(others)))
    step = -(-len(others) // room)
    if step <= 1:
        return whole, np.arange(len(precious))
    rows = np.sort(np.concatenate([np.flatnonzero(precious), others[::step]]))
    some = whole.rows(rows)
    return some._replace(radii=np.where(precious[rows], 1.0, np.sqrt(step)) * some.radii), rows


def _in_box(shape: Shape, box: Floats) -> tuple[Floats, Floats]:
    """Sample what a box holds of a shape without end, and leave out the faces of the box."""
    middle, span = box.mean(axis=0), box[1] - box[0]
    points, normals = sample(shape & Box(span).translated(middle), _OF_SOLIDS, kind="blue")[:2]
    off = np.abs(np.abs(points - middle) - 0.5 * span).min(axis=1)
    mine = off > _ON_THE_BOX * float(span.max())
    return points[mine], normals[mine]
