"""Combination: what :func:`surfel.combine` returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from surfel.core.cast import Floats
from surfel.shapes.surfels import Surfels


@dataclass(frozen=True, eq=False)
class Combination:
    """The surfels that a Boolean expression keeps, and what was found out on the way.

    Parameters
    ----------
    surfels : Surfels
        The result: with normals, radii, and the colors and attributes of the operands. The attribute ``leaf`` tells
        which operand each surfel comes from. Surfels at the cut carry clip planes.
    kept : tuple of int
        How many surfels each operand gave to it.
    cut : int
        How many surfels the cut passes.
    leaky : bool
        Whether inside and outside hang together in one of the clouds, through a hole or an open border.
    conflict : float
        The largest share of the surface of a cloud, by area, that contradicts the colors of space or lies beside a
        hole; 0 where none was asked.
    warnings : tuple of str
        What should be known about the result.
    judges : tuple of (judge, reason) or None
        For each operand that is a cloud, and was asked, which judge told its inside, and why.
    seconds : float
        How long it took, compilation apart.
    compile_seconds : float
        How long kernels were compiled.
    """

    surfels: Surfels
    kept: tuple[int, ...]
    cut: int
    leaky: bool
    conflict: float
    warnings: tuple[str, ...]
    judges: tuple[tuple[str, str] | None, ...]
    seconds: float
    compile_seconds: float = 0.0
    _trace: Callable[[], list[Floats]] = field(default=list, repr=False)

    @cached_property
    def curve(self) -> list[Floats]:
        """Where the surfaces of the operands meet on the result: ordered polylines, each of shape (m, 3).

        One that is closed repeats its first point. Found on first use.
        """
        return self._trace()

    def plot(self) -> Any:
        """Return a figure of matplotlib (extra ``plot``): the surfels, and the curve along which the operands meet.

        Raises
        ------
        MissingExtraError
            If matplotlib is not installed.
        """
        from surfel.booleans.figures import plot_combination

        return plot_combination(self)

    def to_dict(self) -> dict[str, object]:
        """Return what is not an array, for JSON."""
        return {
            "surfels": len(self.surfels),
            "kept": list(self.kept),
            "cut": self.cut,
            "leaky": self.leaky,
            "conflict": self.conflict,
            "judges": [None if judge is None else {"judge": judge[0], "reason": judge[1]} for judge in self.judges],
            "seconds": self.seconds,
            "warnings": list(self.warnings),
        }
