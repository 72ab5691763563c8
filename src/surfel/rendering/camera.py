"""Camera: where a picture is taken from, and what each of its pixels sees."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from surfel.core.affine import rotation
from surfel.core.box import corners
from surfel.core.cast import (
    Floats,
    as_count,
    as_direction,
    as_number,
    as_points,
    as_positive,
    as_rows,
    as_vector,
    read_only,
)
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.shapes.base import CORNERS

FROM = (0.55, -0.72, 0.42)
"""Where a fitted camera stands, seen from what it looks at: in front, to the right and above, with z up."""

_MARGIN = 1.06
_WIDEST = 160.0
_FARTHEST = 1e150


class Projected(NamedTuple):
    """Where points fall in a picture: columns and rows of pixels, whose centres are whole numbers, and the depth."""

    x: Floats
    y: Floats
    depth: Floats


@dataclass(frozen=True)
class Camera:
    """A place to look from, and what it looks at; immutable.

    In the camera's frame x goes right, y down and z away from it. A point's depth is its z.

    Parameters
    ----------
    eye : array_like, shape (3,)
        Where the camera is.
    target : array_like, shape (3,)
        What is in the middle of the picture.
    up : array_like, shape (3,)
        What is up in the picture; not along the line of sight.
    field : float
        Angle in degrees that the height of the picture spans, below 160.
    orthographic : bool
        Parallel lines of sight; the picture spans as much as a perspective one does at the target.

    Raises
    ------
    InputError
        If a vector is not finite, eye and target are one place, or the field is out of its range.

    Examples
    --------
    >>> import surfel
    >>> camera = surfel.Camera((0, -5, 0), (0, 0, 0))
    >>> x, y, depth = camera.project([[0.0, 0.0, 0.0]], (101, 51))
    >>> x.tolist(), y.tolist(), depth.tolist()
    ([50.0], [25.0], [5.0])
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    field: float = 30.0
    orthographic: bool = False

    def __post_init__(self) -> None:
        for name in ("eye", "target"):
            x, y, z = as_vector(getattr(self, name), name).tolist()
            object.__setattr__(self, name, (x, y, z))
        if not math.isfinite(self.distance):
            raise InputError(f"eye and target are too far apart, {self.eye} and {self.target}; scale down what is seen")
        if self.distance == 0.0:
            raise InputError(f"eye and target must be two places; got {self.eye} and {self.target}")
        upward = as_direction(self.up, "up")
        along = (np.array(self.target) - self.eye) / self.distance
        if float(np.linalg.norm(np.cross(along, upward))) < 1e-9:  # straight down or up: any other axis will do
            upward = np.eye(3)[int(np.argmin(np.abs(along)))]
        object.__setattr__(self, "up", tuple(upward.tolist()))
        angle = as_positive(self.field, "field")
        if angle > _WIDEST:
            raise InputError(f"field must be at most {_WIDEST:g} degrees; got {angle:g}")
        object.__setattr__(self, "field", angle)
        if not isinstance(self.orthographic, bool | np.bool_):
            raise InputError(f"orthographic must be True or False; got {self.orthographic!r}")

    @classmethod
    def fitted(
        cls,
        bounds: ArrayLike,
        size: tuple[int, int] = (1024, 768),
        direction: ArrayLike = FROM,
        up: ArrayLike = (0.0, 0.0, 1.0),
        field: float = 30.0,
        orthographic: bool = False,
    ) -> Camera:
        """Return a camera that sees the whole of a box, as near as it can be.

        Parameters
        ----------
        bounds : array_like, shape (2, 3)
            The lowest and the highest corner of the box.
        size : tuple of int
            Width and height of the picture.
        direction : array_like, shape (3,)
            From the box to the camera.
        up, field, orthographic
            As of the camera.

        Raises
        ------
        InputError
            If the box is not finite, or an argument is out of its range.
        """
        box = as_rows(bounds, "bounds", 2)
        if not np.isfinite(box).all():
            raise InputError("bounds must be the two finite corners of a box; give eye and target instead")
        return cls.around(box[CORNERS, range(3)], size, direction, up, field, orthographic)

    @classmethod
    def around(
        cls,
        points: ArrayLike,
        size: tuple[int, int] = (1024, 768),
        direction: ArrayLike = FROM,
        up: ArrayLike = (0.0, 0.0, 1.0),
        field: float = 30.0,
        orthographic: bool = False,
    ) -> Camera:
        """Return a camera that sees all of some points, shape (m, 3), as near as it can be; see :meth:`fitted`."""
        places = as_points(points)
        if not len(places):
            places = np.zeros((1, 3))
        toward = as_direction(direction, "direction")
        width, height = as_size(size)
        low, high = corners(places)
        if max(-float(low.min()), float(high.max())) > _FARTHEST:
            raise InputError(
                f"what is seen reaches to {float(np.abs(places).max()):g} from the origin, which squares cannot hold; "
                "scale it down"
            )
        middle = 0.5 * low + 0.5 * high
        radius = float(np.linalg.norm(high - middle)) or max(1.0, float(np.abs(middle).max())) * 1e-3
        start = cls(
            _three(middle + 4.0 * radius * toward), _three(middle), _three(as_vector(up, "up")), field, orthographic
        )
        frame = start.frame
        slope = math.tan(math.radians(start.field) / 2.0)
        across = np.array([slope * width / height, slope]) / _MARGIN
        seen = (places - middle) @ frame.T
        if orthographic:
            low, high = corners(seen)
            shift, distance = 0.5 * (low + high)[:2], float((0.5 * (high - low)[:2] / across).max())
        else:
            shift, distance = _perspective_fit(seen, across)
        distance = max(distance, 1e-6 * radius) if distance > 0.0 else 2.0 * radius
        middle = middle + shift @ frame[:2]
        return replace(start, eye=_three(middle + distance * toward), target=_three(middle))

    @property
    def distance(self) -> float:
        """How far the target is."""
        return math.dist(self.eye, self.target)

    @cached_property
    def frame(self) -> Floats:
        """Right, down and ahead as unit vectors of the world, shape (3, 3)."""
        ahead = (np.array(self.target) - self.eye) / self.distance
        right = np.cross(ahead, self.up)
        right /= np.linalg.norm(right)
        return read_only(np.stack([right, np.cross(ahead, right), ahead]))

    def focal(self, height: int) -> float:
        """Return how many pixels a unit length at unit depth is high, in a picture of so many rows."""
        return 0.5 * height / math.tan(math.radians(self.field) / 2.0)

    def zoomed(self, factor: float) -> Camera:
        """Return the camera with a lens that shows the target larger by a factor."""
        slope = math.tan(math.radians(self.field) / 2.0) / as_positive(factor, "factor")
        return replace(self, field=min(math.degrees(2.0 * math.atan(slope)), _WIDEST))

    def orbited(self, degrees: float, rise: float = 0.0) -> Camera:
        """Return the camera moved round its target: about ``up``, and then higher by the angle ``rise``."""
        back = np.array(self.eye) - self.target
        back = rotation(self.up, degrees)[:3, :3] @ back
        if as_number(rise, "rise"):
            side = np.cross(self.up, back)
            back = rotation(side, -rise)[:3, :3] @ back
        return replace(self, eye=_three(np.array(self.target) + back))

    def turntable(self, frames: int = 36) -> Iterator[Camera]:
        """Yield cameras all round the target, at even angles, beginning with this one."""
        count = as_count(frames, "frames")
        for k in range(count):
            yield self.orbited(360.0 * k / count)

    def project(self, points: ArrayLike, size: tuple[int, int]) -> Projected:
        """Return where points fall in a picture of this size (width, height).

        Points beside the camera or behind it, at no positive depth, have NaN for a place in a perspective picture.
        """
        width, height = as_size(size)
        seen = (np.asarray(points, np.float64).reshape(-1, 3) - self.eye) @ self.frame.T
        focal, depth = self.focal(height), seen[:, 2]
        scale = np.full(len(depth), focal / self.distance)
        if not self.orthographic:
            scale = np.divide(focal, depth, out=np.full(len(depth), np.nan), where=depth > 0.0)
        return Projected(seen[:, 0] * scale + 0.5 * (width - 1), seen[:, 1] * scale + 0.5 * (height - 1), depth)

    def rays(self, x: ArrayLike, y: ArrayLike, size: tuple[int, int]) -> Lines:
        """Return the lines of sight through places of a picture; t is the distance from the camera, or its plane.

        Parameters
        ----------
        x, y : array_like, shape (m,)
            Columns and rows; the centre of the first pixel is (0, 0).
        size : tuple of int
            Width and height of the picture.
        """
        width, height = as_size(size)
        frame, focal = self.frame, self.focal(height)
        across = (np.asarray(x, np.float64) - 0.5 * (width - 1)) / focal
        down = (np.asarray(y, np.float64) - 0.5 * (height - 1)) / focal
        side = across[:, None] * frame[0] + down[:, None] * frame[1]
        if self.orthographic:
            origins = np.array(self.eye) + self.distance * side
            directions = np.tile(frame[2], (len(side), 1))
        else:
            origins = np.tile(np.array(self.eye), (len(side), 1))
            directions = side + frame[2]
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return Lines(origins, directions, np.ones(len(side)))


def as_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return width and height, or say what is wrong with them."""
    try:
        width, height = size
    except (TypeError, ValueError) as error:
        raise InputError(f"size must be two whole numbers, width and height; got {size!r}") from error
    return as_count(width, "width", 1, 1 << 14), as_count(height, "height", 1, 1 << 14)


def _three(vector: Floats) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _perspective_fit(seen: Floats, across: Floats) -> tuple[Floats, float]:
    """Return a shift in the picture's plane and a distance from which all points are just in the picture.

    Each point at depth z over the middle needs ``|x - shift| <= slope (distance + z)``: linear in both unknowns. Along
    the axis that has room left, the points are moved to the middle.
    """
    from_low = (seen[:, :2] / across - seen[:, 2:]).max(axis=0)  # (x - s) / a - z <= d
    from_high = (-seen[:, :2] / across - seen[:, 2:]).max(axis=0)  # (s - x) / a - z <= d
    distance = float((0.5 * (from_low + from_high)).max())
    low, high = across * (from_low - distance), across * (distance - from_high)
    depth = np.maximum(distance + seen[:, 2:], max(1e-12 * abs(distance), 1e-300))
    for _ in range(50):
        shift = 0.5 * (low + high)
        place = (seen[:, :2] - shift) / depth
        right = place.max(axis=0) > -place.min(axis=0)
        low, high = np.where(right, shift, low), np.where(right, high, shift)
    return 0.5 * (low + high), distance
