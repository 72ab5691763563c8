"""The one interface of the methods that surfel is compared with."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from surfel.shapes.base import Shape


class Reading(NamedTuple):
    """What a baseline tells: the area, how many elements it took (lines, triangles, facets), and the seconds spent."""

    area: float
    elements: int
    seconds: float


class Baseline(Protocol):
    """A method that finds an area with a given effort."""

    def __call__(self, shape: Shape, effort: int) -> Reading:
        """Return what the method tells about a shape; more effort, less error."""
        ...
