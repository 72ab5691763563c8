"""Clips: the planes that cut surfels off, and what they leave of each."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.cast import Floats, as_rows, read_only
from surfel.core.errors import InputError

Areas = ArrayLike | Callable[[], Floats]


class Clips:
    """Planes for each surfel of a cloud, in compressed rows; immutable.

    Of surfel i, with its centre c, the part is left where ``n . (x - c) <= d`` for all of its planes
    ``(n, d) = planes[offsets[i]:offsets[i + 1]]``. Most surfels have none.

    Parameters
    ----------
    offsets : array_like of int, shape (n + 1,)
        Where the planes of each surfel start.
    planes : array_like, shape (k, 4)
        Unit normal and distance from the centre, along the normal, of each plane.
    places : array_like, shape (n, 3), optional
        From the centre of each surfel to the middle of what is left of its cell; zero by default.
    areas : array_like, shape (n,), or callable, optional
        The part of the surface that each surfel stands for, after it was cut. A function is called on first use. None
        where it is not known.

    Raises
    ------
    InputError
        If a shape does not fit, or the offsets do not ascend from 0 to k.

    Examples
    --------
    >>> from surfel.shapes.clips import Clips
    >>> half = Clips([0, 1, 1], [[1.0, 0, 0, 0.2]])
    >>> len(half), half.counts.tolist()
    (2, [1, 0])
    """

    def __init__(
        self, offsets: ArrayLike, planes: ArrayLike, places: ArrayLike | None = None, areas: Areas | None = None
    ) -> None:
        start = np.array(offsets, np.int64)
        rows = np.array(planes, np.float64).reshape(-1, 4)
        if start.ndim != 1 or not len(start) or start[0] != 0 or start[-1] != len(rows) or (np.diff(start) < 0).any():
            raise InputError(f"offsets must ascend from 0 to the number of planes, {len(rows)}")
        if not np.isfinite(rows).all():
            raise InputError("planes must be finite")
        count = len(start) - 1
        self.offsets = read_only(start)
        self.planes = read_only(rows)
        self.places = read_only(np.zeros((count, 3)) if places is None else as_rows(places, "places", count).copy())
        self._lock = threading.RLock()
        self._areas: Areas | None = areas if areas is None or callable(areas) else self._checked(areas)

    @classmethod
    def _adopted(cls, offsets: NDArray[np.int64], planes: Floats, places: Floats, areas: Areas | None) -> Clips:
        """Take arrays that nobody else holds, of the right shapes, without a copy."""
        clips = object.__new__(cls)
        clips.offsets, clips.planes, clips.places = read_only(offsets), read_only(planes), read_only(places)
        clips._lock, clips._areas = threading.RLock(), areas
        return clips

    def _checked(self, areas: ArrayLike) -> Floats:
        found = as_rows(np.reshape(np.asarray(areas), (-1, 1)), "areas", len(self), 1)[:, 0]
        return read_only(np.array(found))

    @property
    def counts(self) -> NDArray[np.int64]:
        """How many planes each surfel has, shape (n,)."""
        return np.diff(self.offsets)

    @property
    def areas(self) -> Floats | None:
        """The area that each surfel stands for after it was cut, shape (n,); None where it is not known."""
        with self._lock:
            if callable(self._areas):
                self._areas = self._checked(self._areas())
            return self._areas  # type: ignore[return-value]

    def leaves(self, rows: NDArray[np.int64], offsets: Floats) -> NDArray[np.bool_]:
        """Tell which places the planes of the surfels ``rows`` leave, given from their centres, shape (m, 3)."""
        counts = self.counts[rows]
        which = np.repeat(np.arange(len(rows)), counts)
        plane = self.planes[_runs(self.offsets[:-1][rows], counts)]
        beyond = np.einsum("ij,ij->i", plane[:, :3], offsets[which]) > plane[:, 3]
        return np.asarray(np.bincount(which[beyond], minlength=len(rows)) == 0)

    def transformed(self, linear: Floats, normals: Floats | None) -> Clips:
        """Return the clips under a linear map; areas follow exactly where normals are known."""
        cofactor = np.linalg.inv(linear)
        turned = self.planes[:, :3] @ cofactor
        length = np.linalg.norm(turned, axis=1, keepdims=True)
        planes = np.concatenate([turned, self.planes[:, 3:]], axis=1) / length
        volume = abs(float(np.linalg.det(linear)))
        factor = volume ** (2.0 / 3.0) if normals is None else volume * np.linalg.norm(normals @ cofactor, axis=1)
        return Clips(self.offsets, planes, self.places @ linear.T, self._later(lambda areas: areas * factor))

    def __getitem__(self, rows: Any) -> Clips:
        """Return the clips of the chosen surfels."""
        chosen = np.arange(len(self))[rows]
        counts = self.counts[chosen]
        planes = self.planes[_runs(self.offsets[:-1][chosen], counts)]
        offsets = np.concatenate([[0], np.cumsum(counts)])
        return Clips(offsets, planes, self.places[chosen], self._later(lambda areas: areas[chosen]))

    def joined(self, other: Clips) -> Clips:
        """Return the clips of two clouds, one after the other."""
        areas: Areas | None = None
        if self._areas is not None and other._areas is not None:

            def areas() -> Floats:
                first, second = self.areas, other.areas
                assert first is not None and second is not None
                return np.concatenate([first, second])

        return Clips(
            np.concatenate([self.offsets, self.offsets[-1] + other.offsets[1:]]),
            np.concatenate([self.planes, other.planes]),
            np.concatenate([self.places, other.places]),
            areas,
        )

    def _later(self, change: Callable[[Floats], Floats]) -> Areas | None:
        """Return changed areas, found when they are asked for."""
        if self._areas is None:
            return None

        def found() -> Floats:
            areas = self.areas
            assert areas is not None
            return change(areas)

        return found

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __repr__(self) -> str:
        return f"Clips({len(self):,} surfels, {int((self.counts > 0).sum()):,} of them cut)"

    def __getstate__(self) -> dict[str, Any]:
        found = self.areas
        return {**{k: v for k, v in self.__dict__.items() if k != "_lock"}, "_areas": found}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _lock=threading.RLock())
        for array in (self.offsets, self.planes, self.places, self._areas):
            if isinstance(array, np.ndarray):
                read_only(array)


def _runs(starts: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the row numbers of runs that start at ``starts``."""
    before = np.concatenate([[0], np.cumsum(counts)])[:-1]
    return np.repeat(starts - before, counts) + np.arange(int(counts.sum()))
