"""Votes: surfels say which free space is outside and which inside; so space is coloured and flips show."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel
from surfel.core.cast import Booleans, Floats
from surfel.inside.grid import BORDER, IN, OUT
from surfel.inside.operand import Operand
from surfel.inside.sheets import over_sheets
from surfel.inside.sight import Sight, look
from surfel.inside.space import Space

MINORITY = 0.02
"""Share of the votes for a component, against its majority, from which it is leaky."""

SLIGHT = 0.005
"""A minority of less than this share of the whole area is no leak; a component that small is left to the judge."""

HEAVIEST = 8.0
"""No vote weighs more than so many times the median: a stray may stand for any area."""

SCARCE = 2.5
"""A component with fewer votes than this, of mean area, is left to the judge as well."""

SAMPLE = 8
"""Every so many surfels vote first; where nothing leaks and hardly any are flipped, that is it."""

FEWEST = 16_000
"""Where there are fewer surfels than this, all of them vote."""

FEW = 5e-4
"""Share of the first to vote, flipped, up to which only those beside these are looked at as well."""

BESIDE = 64
"""How far along the order that is."""


class Ballot(NamedTuple):
    """What the votes say.

    Parameters
    ----------
    colours : NDArray[np.int8], shape (components,)
        OUT, IN, or BORDER for those that too little is known of.
    flipped : Booleans, shape (n,)
        Surfels that have the inside before them and the outside behind.
    conflict : float
        Share of the votes, by area, that contradict the colours, with normals as they were given.
    leaky : Booleans, shape (components,)
        Components whose votes disagree although flipped surfels were turned: space seeps through a hole.
    """

    colours: NDArray[np.int8]
    flipped: Booleans
    conflict: float
    leaky: Booleans


def first_voters(operand: Operand) -> NDArray[np.int32]:
    """Return the sorted rows of the surfels that vote first: one in :data:`SAMPLE` of larger clouds."""
    return np.arange(0, len(operand), SAMPLE if len(operand) >= FEWEST else 1, dtype=np.int32)


def count_votes(operand: Operand, sight: Sight, components: int, *, checked: bool = False) -> Ballot:
    """Colour the components by the areas of the surfels that see them along their normals.

    A surfel votes for the first free cell before it as outside and for the first one behind it as inside, if it sees
    them past cells of its own sheet alone. The component round everything is outside, and one is inside if most of
    those who see it see it from that one. Then surfels that see an inside component before them and an outside one
    behind are flipped, and vote again turned round. Where votes disagree still and it is to be ``checked``, those who
    looked through another sheet unawares have no vote.

    Returns
    -------
    Ballot
        ``flipped`` has a row for each of those who voted.
    """
    guarded, areas = sight.guarded, capped_areas(operand, sight.chosen)
    flipped = np.zeros(len(areas), bool)
    votes = _count(guarded, areas, flipped, components)
    colours = _majority(votes, _facing_out(guarded, areas, components))
    _find_flipped(colours, sight.seen, flipped)
    votes = _count(guarded, areas, flipped, components)
    colours = _majority(votes)
    everything = float(areas.sum())
    if checked and _leaky(votes, everything).any():
        guarded = guarded.copy()
        guarded[_contradicted(operand, sight, colours, flipped)] = -1
        votes = _count(guarded, areas, flipped, components)
        colours = _majority(votes)
    minority, total = _minority(votes), votes.sum(axis=1)
    slight = (minority > MINORITY * total) & (total < SLIGHT * everything)
    slight |= total < SCARCE * areas.mean()
    slight[0] = False
    colours[slight] = BORDER
    against, total_area = _contradictions(guarded, areas, colours)
    conflict = against / total_area if total_area > 0.0 else 0.0
    return Ballot(colours, flipped, conflict, _leaky(votes, everything))


def capped_areas(operand: Operand, chosen: NDArray[np.int32]) -> Floats:
    """Return the areas of some surfels, none of them larger than :data:`HEAVIEST` times the median."""
    areas: Floats = operand.areas[chosen]
    return np.minimum(areas, HEAVIEST * np.median(areas[areas > 0.0])) if areas.any() else areas


def flipped_beside(space: Space, operand: Operand, ballot: Ballot, voters: NDArray[np.int32]) -> Booleans:
    """Tell which of all surfels are flipped, given that a few of the voters are: those beside these look as well."""
    flipped = np.zeros(len(operand), bool)
    if ballot.flipped.any():
        beside = voters[ballot.flipped][:, None] + np.arange(-BESIDE, BESIDE)
        asked = np.unique(np.clip(beside, 0, len(operand) - 1)).astype(np.int32)
        turned = np.zeros(len(asked), bool)
        _find_flipped(ballot.colours, look(space, operand, asked).seen, turned)
        flipped[asked[turned]] = True
    return flipped


def _minority(votes: Floats) -> Floats:
    minority: Floats = votes.min(axis=1)
    minority[0] = votes[0, 1]  # whatever the majority says, space round everything is outside
    return minority


def _leaky(votes: Floats, everything: float) -> Booleans:
    minority, total = _minority(votes), votes.sum(axis=1)
    return np.asarray((minority > MINORITY * total) & (minority > SLIGHT * everything))


def _majority(votes: Floats, facing: Floats | None = None) -> NDArray[np.int8]:
    """Return the colours that most votes say; inside where ``facing`` says so for more than half of them."""
    total = votes.sum(axis=1)
    colours = np.where(votes[:, 1] > votes[:, 0], IN, OUT).astype(np.int8)
    if facing is not None:
        colours[facing > 0.5 * total] = IN
    colours[total == 0.0] = BORDER
    colours[0] = OUT
    return colours


def _facing_out(guarded: NDArray[np.int32], areas: Floats, components: int) -> Floats:
    """Return for each component the areas of the surfels between it and the space round everything."""
    one, two = np.minimum(guarded[:, 0], guarded[:, 1]), np.maximum(guarded[:, 0], guarded[:, 1])
    across = (one == 0) & (two > 0)
    facing: Floats = np.bincount(two[across], areas[across], components).astype(float)
    return facing


def _contradicted(operand: Operand, sight: Sight, colours: NDArray[np.int8], flipped: Booleans) -> Booleans:
    """Tell which votes against the majority are wrong by the surfels nearest to the cell that was seen.

    On a thin plate a surfel may look past cells that hold no centre of the other side, and see the outside behind it.
    """
    inward = np.array([False, True]) ^ flipped[:, None]
    minority = (sight.guarded >= 0) & (inward != (colours[sight.guarded] == IN))
    row, side = np.nonzero(minority)
    chosen = sight.chosen[row]
    sign = np.where(side == 0, 1.0, -1.0) * sight.depth[row, side]
    places = operand.points[chosen] + sign[:, None] * operand.normals[chosen]
    if flipped.any():
        normals = operand.normals.copy()
        normals[sight.chosen[flipped]] *= -1.0
        operand = operand.with_normals(normals)
    minority[row, side] = (over_sheets(operand, places).value < 0.0) != inward[row, side]
    return np.asarray(minority)


@kernel
def _count(seen, areas, flipped, components):
    """Add up the votes for outside and inside, in the order of the surfels."""
    votes = np.zeros((components, 2))
    for n in range(len(seen)):
        for side in range(2):
            component = seen[n, side]
            if component >= 0:
                votes[component, side ^ flipped[n]] += areas[n]
    return votes


@kernel
def _contradictions(guarded, areas, colours):
    """Return the area of the votes that contradict the colours, and of all votes for what has one."""
    against = total = 0.0
    for n in range(len(guarded)):
        for side in range(2):
            component = guarded[n, side]
            if component >= 0 and colours[component] != BORDER:
                total += areas[n]
                if (colours[component] == IN) != (side == 1):
                    against += areas[n]
    return against, total


@kernel
def _find_flipped(colours, seen, flipped):
    for n in range(len(seen)):
        front, back = seen[n, 0], seen[n, 1]
        flipped[n] = front >= 0 and back >= 0 and colours[front] == IN and colours[back] == OUT
