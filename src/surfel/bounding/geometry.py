"""What a safe spline tells of itself beyond heights: slopes, curvature, normals, bounds, hits of rays, its trim."""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from surfel.bounding.bezier import cell_bounds
from surfel.bounding.evaluate import derivatives
from surfel.core.cast import Booleans, Floats, as_choice
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines

if TYPE_CHECKING:
    from surfel.bounding.height_spline import HeightSpline
    from surfel.bounding.spline import SafeSpline


def derivatives_at(spline: HeightSpline, uv: Floats, trimmed: bool) -> Floats:
    """Return F, F_u, F_v, F_uu, F_uv, F_vv, shape (k, 6); NaN outside."""
    found = derivatives(spline.coefficients, uv)
    if trimmed:
        found[np.isnan(spline(uv))] = np.nan
    return found


def hessian_at(spline: HeightSpline, uv: Floats, trimmed: bool) -> Floats:
    """Return the second derivatives as matrices, shape (k, 2, 2)."""
    found = derivatives_at(spline, uv, trimmed)
    return np.ascontiguousarray(found[:, [3, 4, 4, 5]].reshape(-1, 2, 2))


def normal_at(spline: HeightSpline, uv: Floats, trimmed: bool) -> Floats:
    """Return unit normals of the surface in world coordinates, away from the points, shape (k, 3)."""
    slopes = derivatives_at(spline, uv, trimmed)[:, 1:3] * spline.frame.scale
    normals = spline.direction - slopes @ spline.frame.rotation[:2]
    normals /= np.sqrt(np.einsum("ij,ij->i", normals, normals))[:, None]
    return np.asarray(-normals if spline.side == "below" else normals)


def bounds_of_cell(spline: HeightSpline, cell: Any) -> tuple[float, float]:
    """Return two heights between which the surface lies over one cell."""
    try:
        h, k = (operator.index(number) for number in cell)
    except (TypeError, ValueError) as error:
        raise InputError(f"cell must be two whole numbers (along u, along v); got {cell!r}") from error
    rows, columns = spline.trim.shape
    if not (0 <= h < rows and 0 <= k < columns):
        raise InputError(f"cell must lie between (0, 0) and ({rows - 1}, {columns - 1}); got ({h}, {k})")
    low, high = cell_bounds(spline.coefficients[h : h + 4, k : k + 4])
    return float(low[0, 0]), float(high[0, 0])


def intersect_rays(spline: SafeSpline, rays: Any, which: str) -> Crossings:
    """Return where rays meet the trimmed surface."""
    as_choice(which, "which", ("first", "all"))
    lines = as_rays(rays)
    return spline.sheet().crossings(lines, 0.0, first_only=which == "first")


def are_occluded(spline: SafeSpline, rays: Any, length: ArrayLike | None) -> Booleans:
    """Tell which rays the trimmed surface stops within a length."""
    lines = as_rays(rays)
    try:
        reach = np.broadcast_to(np.asarray(np.inf if length is None else length, np.float64), (len(lines),))
    except (TypeError, ValueError) as error:
        raise InputError(
            f"length must be one number, or one for each of the {len(lines)} rays; got {length!r}"
        ) from error
    if np.isnan(reach).any() or (reach < 0.0).any():
        raise InputError("length must not be negative or NaN; leave it out for rays without end")
    hits = spline.sheet().find(lines, 0.0, first_only=True)
    stopped = np.diff(hits.offsets) > 0
    stopped[stopped] = hits.t <= reach[stopped]
    return np.asarray(stopped)


def as_rays(rays: Any) -> Lines:
    """Return rays given as ``(origins, directions)`` or as Lines; directions are made unit vectors."""
    if isinstance(rays, Lines):
        return rays
    try:
        origins, directions = rays
    except (TypeError, ValueError) as error:
        raise InputError(
            f"rays must be a pair (origins, directions) of arrays (m, 3), or surfel.Lines; got {type(rays).__name__}"
        ) from error
    return Lines.of(np.atleast_2d(origins), np.atleast_2d(directions), 1.0)


def mask_of(spline: HeightSpline, places: Floats) -> Booleans:
    """Tell which places of the domain the trimmed surface answers for."""
    return np.asarray(~np.isnan(spline(places)))
