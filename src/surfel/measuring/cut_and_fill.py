"""cut_and_fill(): the volume between two terrains, or a terrain and a base plane, inside a polygon."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import compile_seconds
from surfel.core.cast import Floats, as_direction, as_number, as_points
from surfel.core.errors import InputError
from surfel.core.estimate import Estimate
from surfel.io.las_crs import refuse_degrees
from surfel.measuring.cut_and_fill_polygon import polygon_of, shared_hull
from surfel.measuring.cut_and_fill_region import Lattice
from surfel.measuring.cut_and_fill_sums import Differences, Sums, add_up
from surfel.measuring.cut_and_fill_terrain import Base, Terrain
from surfel.shapes.primitives.half_space import HalfSpace
from surfel.shapes.surfels import Surfels

TOO_MUCH_UNSEEN = 0.25
"""Share of the region without points from which nothing is said."""

_TOO_MUCH_TO_RELY_ON = 0.05
_WORTH_A_WORD = 1e-3
_FLAT = 1e-6  # the cosine between a base plane's normal and the direction below which it is upright
_BLOCK_OF_POINTS = (6.0, 24.0)  # the side of the blocks that tell the errors, in spacings


@dataclass(frozen=True, eq=False)
class CutAndFill:
    """The volume between two surfaces, and what is known of it.

    Parameters
    ----------
    cut : Estimate
        Where the ground sank: what was taken away. Never negative.
    fill : Estimate
        Where it rose: what was added. Never negative.
    net : Estimate
        Fill less cut.
    area : float
        Of the region, across the direction.
    unseen : float
        Share of the region where a survey has no points.
    spacing : tuple of float
        Of the points before and after; NaN for a base plane.
    points : tuple of int
        That were used, before and after; 0 for a base plane.
    cell : float
        Side of the squares that were added up.
    method : str
        How heights were found between points.
    seconds : float
        Spent, compilation apart.
    warnings : tuple of str
        What the numbers should be read with.
    """

    cut: Estimate
    fill: Estimate
    net: Estimate
    area: float
    unseen: float = 0.0
    spacing: tuple[float, float] = (math.nan, math.nan)
    points: tuple[int, int] = (0, 0)
    cell: float = math.nan
    method: str = "triangles"
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain Python objects, ready for JSON; what is not finite is None."""
        return {
            "cut": self.cut.to_dict(),
            "fill": self.fill.to_dict(),
            "net": self.net.to_dict(),
            "area": self.area,
            "unseen": self.unseen,
            "spacing": [value if math.isfinite(value) else None for value in self.spacing],
            "points": list(self.points),
            "cell": self.cell,
            "method": self.method,
            "seconds": self.seconds,
            "warnings": list(self.warnings),
        }

    def __str__(self) -> str:
        lines = [f"{name:4s} {getattr(self, name)}" for name in ("cut", "fill", "net")]
        return "\n".join([*lines, f"area {self.area:.6g}", *(f"warning: {text}" for text in self.warnings)])


Surface = Surfels | ArrayLike | float | HalfSpace


def cut_and_fill(
    before: Surface, after: Surface, region: ArrayLike | None = None, direction: ArrayLike = (0.0, 0.0, 1.0)
) -> CutAndFill:
    """Return the volume between two terrains, or between a terrain and a base plane, inside a polygon.

    Both surfaces are heights over the plane across ``direction``, in straight lines between the points (triangles of
    Delaunay). The errors join how densely and how regularly both surveys sample and the noise of their heights: they
    come from what two halves of the points say of the same blocks of ground. Noise does not count as cut or fill: one
    half tells where the ground rose, the other one by how much.

    Places that a survey does not see are bridged by straight lines, counted into the errors, and told.

    Parameters
    ----------
    before, after : Surfels, array_like of shape (n, 3), float, or HalfSpace
        What the ground was and what it is. A number is the height of a base plane along ``direction``, a half-space
        stands for the plane that bounds it. At least one must be a cloud. Of LiDAR take the points on the ground.
    region : array_like, shape (k, 2) or (k, 3), optional
        The corners of a polygon in order, concave ones included: x and y for the default direction; else points of
        space, of which only the place across the direction counts. By default the hull of the points, where there
        are two clouds what both hulls share.
    direction : array_like, shape (3,)
        Along which heights are measured.

    Returns
    -------
    CutAndFill
        In cubic units of the input.

    Raises
    ------
    InputError
        If an argument cannot be used, both surfaces are planes, or the surveys see less than three quarters of the
        region.

    Examples
    --------
    >>> import numpy as np, surfel
    >>> x, y = np.random.default_rng(0).uniform(-1, 1, (2, 5000))
    >>> pile = np.column_stack([x, y, np.maximum(0.0, 0.5 - np.hypot(x, y))])
    >>> volumes = surfel.cut_and_fill(0.0, pile, [(-1, -1), (1, -1), (1, 1), (-1, 1)])
    >>> low, high = volumes.fill.interval(0.95)
    >>> bool(low < np.pi / 24 < high), volumes.cut.value < 1e-4
    (True, True)
    """
    started, compiled = time.perf_counter(), compile_seconds()
    frame = _frame(as_direction(direction, "direction"))
    surfaces = [_taken(each, name, frame) for each, name in ((before, "before"), (after, "after"))]
    clouds = [each for each in surfaces if not isinstance(each, Base)]
    if not clouds:
        raise InputError("before or after must be a cloud; both are planes")
    polygon = shared_hull(clouds) if region is None else polygon_of(region, frame)
    ground = [each if isinstance(each, Base) else _terrain(each, name, polygon)
              for each, name in zip(surfaces, ("before", "after"), strict=True)]  # fmt: skip
    terrains = [each for each in ground if isinstance(each, Terrain)]
    lattice = Lattice.over(polygon, min(each.spacing for each in terrains))
    cells = np.flatnonzero(lattice.slot.ravel() > -2)
    sums = add_up(lattice, cells, _difference(ground, lattice, cells), *_block(terrains, lattice.area))
    result = _told(sums, lattice, ground)
    seconds = time.perf_counter() - started - (compile_seconds() - compiled)
    return replace(result, seconds=seconds)


def _frame(direction: Floats) -> Floats:
    """Return orthonormal rows of which the third is the direction; for (0, 0, 1) the identity."""
    axis = np.zeros(3)
    axis[int(np.argmin(np.abs(direction)))] = 1.0
    first = axis - (axis @ direction) * direction
    first /= np.sqrt(first @ first)
    return np.stack([first, np.cross(direction, first), direction]) + 0.0


def _taken(surface: Surface, name: str, frame: Floats) -> Floats | Base:
    """Return a base plane, or points in the frame: place across the direction, and height."""
    if isinstance(surface, HalfSpace):
        normal = frame @ np.asarray(surface.normal)
        if abs(normal[2]) <= _FLAT * float(np.sqrt(normal @ normal)):
            raise InputError(f"{name} is a plane along the direction; it has no height over the region")
        return Base(surface.offset / float(normal[2]), -normal[:2] / normal[2])
    if isinstance(surface, Surfels):
        crs = surface.provenance.get("crs")
        if crs:
            refuse_degrees(str(crs))
        points = surface.points
    elif np.ndim(surface) == 0 and not hasattr(surface, "bounds"):
        return Base(as_number(surface, name), np.zeros(2))
    elif hasattr(surface, "bounds"):
        raise InputError(
            f"{name} must be a cloud, an array of points, a height or a HalfSpace; got {type(surface).__name__} "
            "(surfel.sample makes a cloud of a solid or a mesh)"
        )
    else:
        points = as_points(surface, name)
    if len(points) < 3:
        raise InputError(f"{name} has {len(points)} points; a surface needs three")
    return np.ascontiguousarray(points @ frame.T)


def _terrain(points: Floats, name: str, polygon: Floats) -> Terrain:
    """Take the points in the polygon's box, and some round it."""
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    width = np.ptp(points[:, :2], axis=0)
    margin = max(0.02 * float((high - low).max()), 12.0 * math.sqrt(float(width[0] * width[1]) / len(points)))
    near = ((points[:, :2] >= low - margin) & (points[:, :2] <= high + margin)).all(axis=1)
    return Terrain(np.ascontiguousarray(points[near, :2]), np.ascontiguousarray(points[near, 2]), name)


def _difference(ground: list[Terrain | Base], lattice: Lattice, cells: Any) -> Differences:
    before, after = (each.over(lattice, cells) for each in ground)
    return Differences(
        after.all_points - before.all_points,
        after.first_half - before.first_half,
        after.second_half - before.second_half,
        after.missed - before.missed,
        before.seen & after.seen,
    )


def _block(terrains: list[Terrain], area: float) -> tuple[float, float]:
    """Return the spacing, and the side of the blocks that tell the errors: large beside it, small beside the region."""
    spacing = max(each.spacing for each in terrains)
    return spacing, float(np.clip(math.sqrt(area) / spacing / 8.0, *_BLOCK_OF_POINTS))


def _told(sums: Sums, lattice: Lattice, ground: list[Terrain | Base]) -> CutAndFill:
    """Say what was found, and refuse what cannot be answered for."""
    share = sums.unseen / lattice.area
    if share > TOO_MUCH_UNSEEN:
        raise InputError(f"{share:.0%} of the region has no points in one of the surveys; take a smaller region")
    warnings: list[str] = []
    reason = ""
    if share > _WORTH_A_WORD:
        warnings.append(f"{share:.1%} of the region was not seen by one of the surveys; it was bridged, see the errors")
    if share > _TOO_MUCH_TO_RELY_ON:
        reason = f"{share:.0%} of the region was not seen"
    for each in ground:
        steep = each.steep_share() if isinstance(each, Terrain) else 0.0
        if steep:
            warnings.append(
                f"{steep:.0%} of the points of {each.name} stand out from their neighbours as walls, trees or "  # type: ignore[union-attr]
                "overhangs do, which have no single height; take ground points alone, or measure a solid"
            )
            if steep == 1.0:
                reason = "a surface has more than one height a place"
    first, second = ((each.spacing, each.points) if isinstance(each, Terrain) else (math.nan, 0) for each in ground)
    cut, fill, net = (
        replace(each, reliable=False, reason=reason) if reason else each for each in (sums.cut, sums.fill, sums.net)
    )
    return CutAndFill(
        cut=cut,
        fill=fill,
        net=net,
        area=lattice.area,
        unseen=share,
        spacing=(first[0], second[0]),
        points=(first[1], second[1]),
        cell=lattice.step,
        warnings=tuple(warnings),
    )
