"""Which judge tells places near the surface of a cloud apart, why, and what its values are."""

from __future__ import annotations

from typing import NamedTuple

from surfel.inside.judges import choose
from surfel.inside.operand import Operand

SHEETS = "sheets"
"""The judge by curved sheets (:mod:`surfel.inside.sheets`), which ``auto`` takes where normals can be trusted."""

SKIPPING = ("nearest", "two-nearest", "two-cluster", "imls")
"""Judges by neighbours, which look for far places to skip unless they are told not to."""

_BY_SHEETS = ("nearest", "two-nearest", "two-cluster")  # in their place, near the surface, sheets do better


class Decision(NamedTuple):
    """Which judge tells places near the surface apart, and why that one."""

    judge: str
    reason: str

    @classmethod
    def of(cls, operand: Operand) -> Decision:
        """Return the judge that suits a cloud, by its noise, flips and edges."""
        chosen = choose(operand)
        return cls(SHEETS if chosen.name in _BY_SHEETS else chosen.name, chosen.reason)

    @property
    def has_distances(self) -> bool:
        """Whether the judge's values are distances: not those of judges for noise."""
        return self.judge in (SHEETS, *SKIPPING)
