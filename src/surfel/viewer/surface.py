"""The safe surface over what is on the stage."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.box import corners
from surfel.core.cast import Floats
from surfel.shapes.base import Shape
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree

if TYPE_CHECKING:
    from surfel.bounding.spline import SafeSpline
    from surfel.viewer.viewer import Settings

_STEPS = 64


class Lid(NamedTuple):
    """Triangles of a surface, and what is told of it."""

    corners: Floats | None
    faces: NDArray[np.int32] | None
    text: str


def lid_of(tree: Shape, settings: Settings) -> Lid:
    """Fit a safe surface to the points of all clouds of an expression, where they are now."""
    from surfel.bounding.doors import bound

    leaves = tree.leaves if isinstance(tree, Tree) else (tree,)
    clouds = [leaf.points for leaf in leaves if isinstance(leaf, Surfels) and len(leaf)]
    if not clouds:
        return Lid(None, None, "No cloud, no safe surface.")
    points = np.concatenate(clouds)
    n = settings.coefficients
    spline = bound(points, shape=(n, n), side=settings.side, mode=settings.mode)
    violations, _ = spline.verify(points)
    text = f"Safe surface: {violations} of {len(points):,} points beyond it, mean gap {spline.report.gap_mean:.4g}."
    return Lid(*_triangles(spline, points), text)


def _triangles(spline: SafeSpline, points: Floats) -> tuple[Floats, NDArray[np.int32]]:
    """Return a grid of triangles on the surface, over where it is trimmed to."""
    low, high = corners(points)
    x, y = (np.linspace(low[k], high[k], _STEPS) for k in (0, 1))
    place = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    height = spline(np.column_stack([place, np.full(len(place), low[2])]))
    corner = np.arange(_STEPS * _STEPS).reshape(_STEPS, _STEPS)
    a, b, c, d = corner[:-1, :-1].ravel(), corner[1:, :-1].ravel(), corner[1:, 1:].ravel(), corner[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    faces = faces[np.isfinite(height)[faces].all(axis=1)]
    return np.column_stack([place, np.nan_to_num(height)]), faces.astype(np.int32)
