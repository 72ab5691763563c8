"""The polygon of a cut and fill: as it was given, or what the hulls of the surveys share."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.measuring.cut_and_fill_region import refuse_crossings, signed_area


def polygon_of(region: ArrayLike, frame: Floats) -> Floats:
    """Return the corners in the plane across the direction."""
    try:
        corners = np.asarray(region, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"region must be the corners of a polygon, shape (k, 2) or (k, 3) ({error})") from error
    if corners.ndim != 2 or corners.shape[1] not in (2, 3) or len(corners) < 3:
        raise InputError(f"region must have shape (k, 2) or (k, 3) with three corners or more; got {corners.shape}")
    if not np.isfinite(corners).all():
        raise InputError("region must be finite")
    if corners.shape[1] == 2:
        if not np.array_equal(frame, np.eye(3)):
            raise InputError("region must be points of space, shape (k, 3), where direction is not (0, 0, 1)")
        plane = np.ascontiguousarray(corners)
    else:
        plane = np.ascontiguousarray((corners @ frame.T)[:, :2])
    if np.array_equal(plane[0], plane[-1]):
        plane = plane[:-1].copy()
    if len(plane) < 3 or abs(signed_area(plane)) <= 1e-12 * float(np.prod(np.ptp(plane, axis=0))):
        raise InputError("region has no area")
    refuse_crossings(plane)
    return plane


def shared_hull(clouds: list[Floats]) -> Floats:
    """Return the convex hull of the points across the direction; of two clouds what the hulls share."""
    from scipy.spatial import ConvexHull, QhullError

    hulls = []
    for points in clouds:
        try:
            plane = points[:, :2]
            hulls.append(plane[ConvexHull(plane - plane[0]).vertices])
        except QhullError:
            raise InputError("the points lie on one line across the direction; they span no region") from None
    polygon = hulls[0]
    for other in hulls[1:]:
        polygon = _shared(polygon, other)
    if len(polygon) < 3 or signed_area(polygon) <= 0.0:
        raise InputError("before and after share no ground: their hulls do not overlap")
    return np.ascontiguousarray(polygon)


def _shared(polygon: Floats, other: Floats) -> Floats:
    """Clip one convex polygon by another one, both counterclockwise."""
    for a, b in zip(other, np.roll(other, -1, axis=0), strict=True):
        if not len(polygon):
            break
        side = (b[0] - a[0]) * (polygon[:, 1] - a[1]) - (b[1] - a[1]) * (polygon[:, 0] - a[0])
        kept = []
        for i in range(len(polygon)):
            j = (i + 1) % len(polygon)
            if side[i] >= 0.0:
                kept.append(polygon[i])
            if (side[i] > 0.0) != (side[j] > 0.0) and side[i] != side[j]:
                kept.append(polygon[i] + (polygon[j] - polygon[i]) * (side[i] / (side[i] - side[j])))
        polygon = np.array(kept).reshape(-1, 2)
    return polygon
