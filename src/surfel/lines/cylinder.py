"""An enclosing cylinder of small surface, and lines through it: for what is long and round.

The axes tried are those of the oriented box, the principal axes and z. About a given axis the smallest cylinder is
exact: the smallest circle round the points seen along the axis, and the slab that they fill.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import inlined, rows
from surfel._vec import dot
from surfel.core.cast import Floats, as_points
from surfel.core.errors import InputError
from surfel.lines.box import oriented_box
from surfel.lines.circle import circle
from surfel.lines.enclosing import smallest_ball
from surfel.lines.local import Local

_CHUNK = 65_536
_SAME = 1e-9  # a smaller gain is rounding: the axis tried first is kept


class EnclosingCylinder(NamedTuple):
    """A cylinder: centre (3,), unit axes as the rows of a matrix (3, 3), the last along it, radius, half its height."""

    centre: Floats
    axes: Floats
    radius: float
    half_height: float

    @property
    def surface(self) -> float:
        """The area of its side and its two ends."""
        return 2.0 * math.pi * self.radius * (self.radius + 2.0 * self.half_height)

    @property
    def volume(self) -> float:
        """The area of one end times the height."""
        return 2.0 * math.pi * self.radius**2 * self.half_height

    def grown(self, margin: float) -> EnclosingCylinder:
        """Return the cylinder with ``margin`` added on every side."""
        return EnclosingCylinder(self.centre, self.axes, self.radius + margin, self.half_height + margin)


def enclosing_cylinder(points: ArrayLike) -> EnclosingCylinder:
    """Return a cylinder of small surface that holds all points.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        At least one finite point; equal, collinear and coplanar points are as good as any.

    Returns
    -------
    EnclosingCylinder
        The best of seven axes; about its axis it is the smallest. Not proven to be the smallest of all.

    Raises
    ------
    InputError
        If there is no point, or the points are not (n, 3) and finite.

    Examples
    --------
    >>> from surfel.lines.cylinder import enclosing_cylinder
    >>> found = enclosing_cylinder([(3, 0, 9), (-3, 0, 9), (0, 3, -9), (0, -3, -9)])
    >>> round(found.radius, 6), round(found.half_height, 6)
    (3.0, 9.0)
    """
    cloud = as_points(points)
    if len(cloud) == 0:
        raise InputError("points must hold at least one point; got none")
    middle, unit = Local.of(cloud)
    if unit == 0.0:
        return EnclosingCylinder(cloud[0].copy(), np.eye(3), 0.0, 0.0)
    local = np.asarray((cloud - middle) / unit)
    best: EnclosingCylinder | None = None
    for axis in (*oriented_box(cloud).axes, *_principal_axes(local), np.array([0.0, 0.0, 1.0])):
        found = _about(local, _frame(axis))
        if best is None or found.surface < best.surface * (1.0 - _SAME):
            best = found
    assert best is not None
    return EnclosingCylinder(middle + unit * best.centre, best.axes, unit * best.radius, unit * best.half_height)


def _about(local: Floats, axes: Floats) -> EnclosingCylinder:
    """Return the smallest cylinder along the last of the axes."""
    turned = np.concatenate([local[first : first + _CHUNK] @ axes.T for first in range(0, len(local), _CHUNK)])
    low, high = float(turned[:, 2].min()), float(turned[:, 2].max())
    turned[:, 2] = 0.0
    disk = smallest_ball(turned)  # of points in one plane: their smallest circle
    centre = np.array([disk.centre[0], disk.centre[1], 0.5 * (low + high)])
    return EnclosingCylinder(centre @ axes, axes, disk.radius, 0.5 * (high - low))


def _principal_axes(local: Floats) -> Floats:
    """Return the eigenvectors of the second moments as rows."""
    offset = local - local.mean(axis=0)
    return np.ascontiguousarray(np.linalg.eigh(offset.T @ offset / len(local))[1].T)


def _frame(axis: Floats) -> Floats:
    """Return a right-handed frame as rows, the last of them along the axis."""
    helper = np.eye(3)[np.abs(axis).argmin()]
    first = np.cross(helper, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis])


@rows
def fill_cylinder(first, last, points, centre, axes, radius, half, origins, directions):
    """Write a line through a cylinder for each point."""
    for i in range(first, last):
        foot, along = _entry(points[i, 0], points[i, 1], points[i, 2], points[i, 3], radius, half)
        for k in range(3):
            origins[i, k] = centre[k] + dot(foot[0], foot[1], foot[2], axes[0, k], axes[1, k], axes[2, k])
            directions[i, k] = dot(along[0], along[1], along[2], axes[0, k], axes[1, k], axes[2, k])


@inlined
def _entry(x0, x1, x2, x3, radius, half):
    """Return the point nearest to the centre and the direction of a line that enters a cylinder, in its frame.

    x0 runs from the middle of the lower end over its rim, up the side and over the upper rim to the middle of the
    upper end, without a jump; x1 goes round. Directions have the density cos(psi) / pi about the inward normal.
    """
    c, s = circle(x1)
    a, b = circle(x3)
    a, b = math.sqrt(x2) * a, math.sqrt(x2) * b  # a round the axis, b along the path of x0
    inward = math.sqrt(1.0 - x2)
    place = x0 * 2.0 * (radius + 2.0 * half)  # in units of pi times the radius
    if place < radius:
        rho, z = math.sqrt(place * radius), -half
        out, up = b, inward
    elif place < radius + 4.0 * half:
        rho, z = radius, 0.5 * (place - radius) - half
        out, up = -inward, b
    else:
        rho, z = math.sqrt(max(2.0 * (radius + 2.0 * half) - place, 0.0) * radius), half
        out, up = -b, -inward
    px, py = rho * c, rho * s
    dx, dy = out * c - a * s, out * s + a * c
    back = dot(px, py, z, dx, dy, up)
    return (px - back * dx, py - back * dy, z - back * up), (dx, dy, up)
