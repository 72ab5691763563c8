"""Operand: a cloud as the judges see it, sorted along a curve, with what they ask about it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.box import corners
from surfel.core.cast import Booleans, Floats, as_points, as_rows, read_only
from surfel.core.errors import InputError
from surfel.index.neighbours import PointIndex

if TYPE_CHECKING:
    from surfel.inside.spheres import Spheres

Value = TypeVar("Value")

LOOKED_AT = 256
"""How many surfels tell the noise."""

# what does not depend on the normals
_OF_POINTS = ("areas", "strays", "spacings", "spacing", "bounds", "spheres", "noise")


class Operand:
    """A cloud of oriented surfels, ready to be asked what lies inside it; immutable.

    All arrays have one row for each surfel, *sorted* along the curve of the index: row r is row ``order[r]`` of what
    was given. What is derived is computed once, on first use, under a lock.

    Attributes
    ----------
    order : NDArray[np.int32], shape (n,)
        The given row of each sorted row.
    origin : Floats, shape (3,)
        What was subtracted from the points.
    points : Floats, shape (n, 3)
        Sorted, minus ``origin``.
    normals : Floats, shape (n, 3)
        Unit normals that point outward; zero where unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.operand import Operand
    >>> p = np.random.default_rng(0).standard_normal((500, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> ball = Operand.of(p, p)
    >>> len(ball), round(float(ball.areas.sum() / (4.0 * np.pi)), 1)
    (500, 1.0)
    """

    def __init__(
        self, index: PointIndex | None, normals: Floats, areas: Floats | None, spacings: Floats | None
    ) -> None:
        """Take arrays that are sorted and valid; :meth:`of` is the door."""
        self._index = index
        self.order = np.empty(0, np.int32) if index is None else index.order
        self.origin = np.zeros(3) if index is None else index.origin
        self.points = np.empty((0, 3)) if index is None else index.points
        self.normals = read_only(normals)
        self._lock = threading.RLock()
        self._known: dict[str, Any] = {}
        self._given_spacings = spacings is not None
        for name, given in (("areas", areas), ("spacings", spacings)):
            if given is not None:
                self._known[name] = read_only(given)

    @classmethod
    def of(
        cls, points: ArrayLike, normals: ArrayLike, areas: ArrayLike | None = None, spacings: ArrayLike | None = None
    ) -> Operand:
        """Sort and index a cloud.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Finite coordinates; none at all make an operand that nothing is inside of.
        normals : array_like, shape (n, 3)
            Unit normals that point outward; zero where unknown.
        areas : array_like, shape (n,), optional
            What part of the surface each surfel stands for, not negative; by default the squares of the spacings.
        spacings : array_like, shape (n,), optional
            How far apart the surfels lie, locally; by default from the distance to the eighth neighbour.

        Raises
        ------
        InputError
            If a shape does not fit, a number is not finite, or an area or a spacing is negative.
        """
        place = as_points(points)
        upright = as_rows(normals, "normals", len(place))
        if not np.isfinite(upright).all():
            raise InputError("normals must be finite; use zero where a normal is unknown")
        index = PointIndex(place) if len(place) else None
        order = np.empty(0, np.int32) if index is None else index.order
        return cls(
            index,
            np.take(upright, order, axis=0),
            None if areas is None else _not_negative(areas, "areas", len(place))[order],
            None if spacings is None else _not_negative(spacings, "spacings", len(place))[order],
        )

    @property
    def index(self) -> PointIndex:
        """The index of the points; :class:`InputError` where there are none."""
        if self._index is None:
            raise InputError("an operand without surfels has no index")
        return self._index

    @property
    def spacings(self) -> Floats:
        """How far apart the surfels lie at each of them, shape (n,)."""
        return self._once("spacings", lambda: self._local[0])

    @property
    def strays(self) -> Booleans:
        """Which surfels lie far off the surface that their neighbours show, shape (n,); none where spacings were given.

        They stand for no area, and their disks are small: space is coloured as if they were not there.
        """
        return self._once("strays", lambda: np.zeros(len(self), bool) if self._given_spacings else self._local[1])

    @property
    def _local(self) -> tuple[Floats, Booleans]:
        """The spacings and the strays as they were found together."""
        from surfel.inside.spacings import spacings_and_strays

        return self._once("local", lambda: spacings_and_strays(self._index, self.normals))

    @property
    def areas(self) -> Floats:
        """The area that each surfel stands for, shape (n,); by default none where it lies far from all others."""
        return self._once("areas", lambda: read_only(self._default_areas()))

    @property
    def spacing(self) -> float:
        """The median of the spacings; 0 where there are no surfels."""
        return self._once("spacing", lambda: float(np.median(self.spacings)) if len(self) else 0.0)

    @property
    def bounds(self) -> Floats:
        """The lowest and the highest corner of the points, minus ``origin``, shape (2, 3); inverted where empty."""
        return self._once("bounds", lambda: read_only(_bounds(self.points)))

    @property
    def spheres(self) -> Spheres:
        """Spheres round the blocks of the points, for queries in bulk."""
        from surfel.inside.spheres import spheres_of

        return self._once("spheres", lambda: spheres_of(self.points))

    @property
    def noise(self) -> float:
        """Standard deviation of the points off the surface, in spacings; 0 where there are too few to tell."""
        return self._once("noise", self._noise)

    @property
    def sharp(self) -> float:
        """Share of the surfels that lie near a sharp edge."""
        return self._agreement[0]

    @property
    def flips(self) -> float:
        """Share of the surfels whose normals contradict most of their neighbours."""
        return self._agreement[1]

    def local(self, places: ArrayLike) -> Floats:
        """Return places, given as the points were given, minus ``origin``."""
        return np.asarray(as_points(places, "queries") - self.origin)

    def with_normals(self, normals: Floats) -> Operand:
        """Return the operand with other normals (sorted rows); the index and the spacings are shared."""
        with self._lock:
            known = {name: value for name, value in self._known.items() if name in _OF_POINTS}
        like = Operand(self._index, np.array(normals), None, None)
        like._given_spacings = self._given_spacings
        like._known.update(known)
        return like

    def with_edits(self, rows: NDArray[np.int64], points: Floats, normals: Floats) -> Operand:
        """Return the operand with some surfels (sorted rows) elsewhere, minus ``origin``; spacings and areas stay."""
        places, upright = np.array(self.points), np.array(self.normals)
        places[rows], upright[rows] = points, normals
        return Operand(self.index.moved(places), upright, self.areas, self.spacings)

    def sample(self, count: int) -> NDArray[np.int32]:
        """Return at most so many rows, evenly along the curve: whatever the order in which surfels were given."""
        n = len(self)
        return ((np.arange(min(n, count)) * n) // max(min(n, count), 1)).astype(np.int32)

    def __len__(self) -> int:
        return len(self.points)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._lock = threading.RLock()

    def _default_areas(self) -> Floats:
        """Return the squares of the spacings, shared out where several surfels lie at one place."""
        squares: Floats = self.spacings**2
        squares[self.strays] = 0.0
        beside = np.flatnonzero(self.points[1:, 0] == self.points[:-1, 0])
        alike = (self.points[beside + 1] == self.points[beside]).all(axis=1)
        return squares / _shared(self.points) if len(beside) and alike.any() else squares

    def _noise(self) -> float:
        from surfel.surface.noise import noise_level

        return noise_level(self._index, self.sample(LOOKED_AT)) if self._index is not None else 0.0

    @property
    def _agreement(self) -> tuple[float, float]:
        from surfel.inside.agreement import agreement

        return self._once("agreement", lambda: agreement(self))

    def _once(self, name: str, make: Callable[[], Value]) -> Value:
        with self._lock:
            if name not in self._known:
                self._known[name] = make()
            found: Value = self._known[name]
            return found


def _shared(points: Floats) -> Floats:
    """Return by how many surfels the place of each is shared, itself included."""
    _, of_surfel, count = np.unique(points, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(count[of_surfel.ravel()], float)


def _bounds(points: Floats) -> Floats:
    if not len(points):
        return np.array([[np.inf] * 3, [-np.inf] * 3])
    return corners(points)


def _not_negative(value: ArrayLike, name: str, rows: int) -> Floats:
    array = as_rows(np.reshape(np.asarray(value), (-1, 1)), name, rows, 1)[:, 0]
    good: Booleans = np.isfinite(array) & (array >= 0.0)
    if not good.all():
        raise InputError(f"{name} must be finite and not negative; row {int(np.flatnonzero(~good)[0])} is not")
    return array
