"""Near the surface: a judge tells places inside from outside, and surfels on the surface from both."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.index.hilbert import hilbert_order
from surfel.inside.coincidence import DISTANCE, on_sheets, on_surface
from surfel.inside.colour import Coloured
from surfel.inside.decision import SHEETS, SKIPPING, Decision
from surfel.inside.judges import named
from surfel.inside.sheets import OverSheets, over_sheets


def judged(coloured: Coloured, judge: str, places: Floats, *, in_order: bool) -> tuple[Floats, OverSheets | None]:
    """Return the values of local places near the surface, negative inside, and what sheets found where they judge.

    Places in a hole, where no surfel is, are told by the winding number.

    Parameters
    ----------
    coloured : Coloured
        The cloud.
    judge : str
        One of the judges, or ``sheets``.
    places : Floats, shape (m, 3)
        Minus the operand's origin.
    in_order : bool
        Whether neighbours follow each other.
    """
    operand, found = coloured.operand, None
    if not len(places):
        return np.empty(0), None
    if judge == SHEETS:
        found = over_sheets(operand, places, None if in_order else hilbert_order(places))
        value = found.value
    else:
        skipping = {"skip": False} if judge in SKIPPING else {}
        value = named(judge)(operand, places + operand.origin, **skipping).value
    if coloured.doubt is not None:
        from surfel.inside.leaks import in_doubt

        open_ = in_doubt(coloured.grid, coloured.doubt, places)
        value[open_] = named("winding")(operand, places[open_] + operand.origin).value
    return value, found


def on_which(
    coloured: Coloured, decision: Decision, places: Floats, normals: Floats, value: Floats, found: OverSheets | None
) -> tuple[NDArray[np.int8], NDArray[np.int64]]:
    """Return which of those judged surfels that may be on the surface are, and which may be."""
    operand = coloured.operand
    if found is not None:
        close = np.flatnonzero(np.abs(value) < 2.0 * DISTANCE * operand.spacings[found.near[:, 0]])
        return on_sheets(operand, places, normals, found.squares, found.near, close), close
    close = np.arange(len(places))
    if decision.has_distances:
        close = np.flatnonzero(np.abs(value) < DISTANCE * float(operand.spacings.max(initial=0.0)))
    return on_surface(operand, places[close] + operand.origin, normals[close]), close
