"""Measurement: what measuring gives, and how it is told."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from surfel.core.cast import as_count
from surfel.core.errors import InputError
from surfel.core.estimate import Estimate

_FEWEST = 512  # lines that a picture of convergence begins with


@dataclass(frozen=True, eq=False)
class Measurement:
    """Area, volume and moments of a shape, each with its error, and what was done to get them.

    Parameters
    ----------
    area : Estimate
        Of the surface, in squared units of the input; its interval joins sampling, noise and line errors.
    volume : Estimate or None
        None for a sheet.
    centroid : Estimate or None
        Of the solid at unit density; value of shape (3,).
    inertia : Estimate or None
        About the centroid at unit density; value of shape (3, 3).
    areas : tuple of Estimate
        The area of each leaf of the tree.
    sides : str
        ``"one"``: each piece of surface counts once.
    closed : bool
        Whether the surface bounds a solid.
    leak : float
        Share of the lines that cross an odd number of sheets, among those that hit.
    spacing : float
        Typical distance between neighbouring points, in units of the input; NaN where there are no points.
    noise : float
        Standard deviation of the points off the surface, in spacings.
    cleaning : mapping of str to int
        What was dropped, by reason; and how many normals were unknown or wrong, which were fitted.
    method : str
        How the area was found.
    lines : int
        How many lines were cast in all.
    seed : int
        Of the random shifts.
    points : int
        Of the cloud, before cleaning.
    seconds : float
        Spent, compilation apart.
    compile_seconds : float
        Spent compiling kernels, once after installing.
    warnings : tuple of str
        What the numbers should be read with.
    """

    area: Estimate
    volume: Estimate | None = None
    centroid: Estimate | None = None
    inertia: Estimate | None = None
    areas: tuple[Estimate, ...] = ()
    sides: str = "one"
    closed: bool = False
    leak: float = math.nan
    spacing: float = math.nan
    noise: float = math.nan
    cleaning: Mapping[str, int] = field(default_factory=dict)
    method: str = "patches"
    lines: int = 0
    seed: int = 0
    points: int = 0
    seconds: float = 0.0
    compile_seconds: float = 0.0
    warnings: tuple[str, ...] = ()
    _again: Callable[[int], Measurement] | None = field(default=None, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_again": None}  # the shape does not travel with its measures

    def convergence(self, steps: int = 6) -> tuple[Measurement, ...]:
        """Measure again with a half, a quarter, ... of the lines, and return all results, the fewest lines first.

        Together they cost as much as the measurement did.

        Parameters
        ----------
        steps : int
            How many results to return at most, this one included.

        Raises
        ------
        InputError
            If ``steps`` is no count, or the measurement was read from a file or came from another process.
        """
        number = as_count(steps, "steps")
        if self._again is None:
            raise InputError("the shape is not known any more; call surfel.measure on it again, here")
        fewer = [self.lines >> k for k in range(1, number) if self.lines >> k >= _FEWEST]
        return (*(self._again(lines) for lines in reversed(fewer)), self)

    def to_dict(self) -> dict[str, Any]:
        """Return plain Python objects, ready for JSON; what is not known or not finite is None."""

        def told(estimate: Estimate | None) -> dict[str, Any] | None:
            return None if estimate is None else estimate.to_dict()

        def number(value: float) -> float | None:
            return float(value) if math.isfinite(value) else None

        return {
            "points": self.points,
            "method": self.method,
            "lines": self.lines,
            "area": told(self.area),
            "volume": told(self.volume),
            "centroid": told(self.centroid),
            "inertia": told(self.inertia),
            "areas": [told(leaf) for leaf in self.areas],
            "sides": self.sides,
            "closed": self.closed,
            "leak": number(self.leak),
            "spacing": number(self.spacing),
            "noise": number(self.noise),
            "cleaning": dict(self.cleaning),
            "seed": self.seed,
            "seconds": number(self.seconds),
            "compile_seconds": number(self.compile_seconds),
            "warnings": list(self.warnings),
        }

    def plot(self, units: str = "") -> Any:
        """Return a figure of matplotlib (extra ``plot``): how area and volume converge, with their 95 % intervals.

        For that the shape is measured again with fewer lines (:meth:`convergence`). Where that cannot be done, as after
        a journey from another process, the intervals are drawn alone.

        Parameters
        ----------
        units : str
            A label for lengths.

        Raises
        ------
        MissingExtraError
            If matplotlib is not installed.
        """
        from surfel.measuring.figures import plot_measurement

        return plot_measurement(self, units)

    def _repr_html_(self) -> str:
        from html import escape

        known = [("area", self.area), ("volume", self.volume), ("centroid", self.centroid)]
        cells = [(name, str(estimate)) for name, estimate in known if estimate is not None]
        cells += [("closed", f"{self.closed} (leak {self.leak:.2%})"), ("method", self.method)]
        cells += [("warning", text) for text in self.warnings]
        return "<table>" + "".join(f"<tr><th>{k}</th><td>{escape(v)}</td></tr>" for k, v in cells) + "</table>"

    def __str__(self) -> str:
        lines = [f"area     {self.area}"]
        if self.volume is not None:
            lines.append(f"volume   {self.volume}")
        if self.centroid is not None:
            lines.append(f"centroid {self.centroid}")
        lines.append(f"closed   {self.closed} (leak {self.leak:.2%})")
        lines.extend(f"warning: {text}" for text in self.warnings)
        return "\n".join(lines)
