"""What a reader may be asked to leave out: a box, every n-th point, classes, a resolution or a level."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from surfel.core.cast import Floats, as_count, as_positive, as_rows
from surfel.core.errors import InputError

WHOLE_TREE = frozenset({"resolution", "level"})
"""Options that only a file with levels of detail has an answer for."""


@dataclass(frozen=True)
class Options:
    """Which points of a file are wanted; the default is all of them.

    Parameters
    ----------
    bounds : ndarray of float64, shape (2, 3), optional
        The lowest and the highest corner, both inside.
    every : int
        Rows 0, every, 2 every, ... of the file, counted before anything else is left out.
    classes : frozenset of int, optional
        Wanted values of the attribute ``classification``.
    resolution : float, optional
        Levels of a COPC file down to this spacing.
    level : int, optional
        Levels of a COPC file down to this one; 0 is the coarsest.
    """

    bounds: Floats | None = None
    every: int = 1
    classes: frozenset[int] | None = None
    resolution: float | None = None
    level: int | None = None

    @property
    def asked(self) -> frozenset[str]:
        """The names of the options that leave something out."""
        given = {name for name in ("bounds", "classes", "resolution", "level") if getattr(self, name) is not None}
        return frozenset(given | ({"every"} if self.every > 1 else set()))

    def without(self, names: Iterable[str]) -> Options:
        """Return the options less those that somebody else has applied."""
        kept: dict[str, Any] = {name: getattr(self, name) for name in self.asked - frozenset(names)}
        return Options(**kept)


def options_from(
    bounds: ArrayLike | None = None,
    every: int = 1,
    classes: int | Iterable[int] | None = None,
    resolution: float | None = None,
    level: int | None = None,
) -> Options:
    """Return checked options.

    Raises
    ------
    InputError
        If one of them is not what it should be.
    """
    corners = None if bounds is None else as_rows(bounds, "bounds", 2)
    if corners is not None and not (corners[0] <= corners[1]).all():  # also where one is not a number
        raise InputError(
            f"bounds must be the lowest and the highest corner, ((x, y, z), (x, y, z)); got {corners.tolist()}"
        )
    if resolution is not None and level is not None:
        raise InputError("give resolution or level, not both")
    return Options(
        corners,
        as_count(every, "every"),
        None if classes is None else _as_classes(classes),
        None if resolution is None else as_positive(resolution, "resolution"),
        None if level is None else as_count(level, "level", least=0),
    )


def _as_classes(classes: int | Iterable[int]) -> frozenset[int]:
    wanted = [classes] if isinstance(classes, int | np.integer) else classes
    if isinstance(wanted, str | bytes) or not isinstance(wanted, Iterable):
        raise InputError(f"classes must be whole numbers, such as (2, 6); got {classes!r}")
    return frozenset(as_count(number, "a class", least=0) for number in wanted)
