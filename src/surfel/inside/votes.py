"""Votes: every surfel says which free space lies before it and which behind it; so space is coloured and flips show."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel, rows, threads_for
from surfel.core.cast import Booleans, Floats
from surfel.inside.grid import BORDER, IN, OUT, bit_of
from surfel.inside.operand import Operand
from surfel.inside.owners import owner_of
from surfel.inside.sheets import over_sheets
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

_COHERENT = 0.3  # mean normals shorter than this say nothing
_OPPOSED = -0.2  # cosine, with the surfel's own cell, at which another sheet is taken to begin
_STRIDE = 0.35  # steps of the walk, in cells


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


class Sight(NamedTuple):
    """What some surfels see before (0) and behind (1) them.

    Parameters
    ----------
    chosen : NDArray[np.int32], shape (m,)
        Which surfels.
    guarded, seen : NDArray[np.int32], shape (m, 2)
        The first free component, -1 for none; ``guarded`` only where their own sheet alone lies before it.
    depth : Floats, shape (m, 2)
        How far off it is.
    cells : NDArray[np.int32], shape (m, 2, 3)
        The cell of it that is seen; the one looked at last where nothing is.
    """

    chosen: NDArray[np.int32]
    guarded: NDArray[np.int32]
    seen: NDArray[np.int32]
    depth: Floats
    cells: NDArray[np.int32]


def first_voters(operand: Operand) -> NDArray[np.int32]:
    """Return the sorted rows of the surfels that vote first: one in :data:`SAMPLE` of larger clouds."""
    return np.arange(0, len(operand), SAMPLE if len(operand) >= FEWEST else 1, dtype=np.int32)


def look(space: Space, operand: Operand, chosen: NDArray[np.int32]) -> Sight:
    """Let some surfels look before and behind them."""
    n = len(chosen)
    guarded, seen, depth = np.empty((n, 2), np.int32), np.empty((n, 2), np.int32), np.empty((n, 2))
    cells = np.empty((n, 2, 3), np.int32)
    frame = space.frame
    with threads_for(4 * n):
        _look(
            n, chosen, operand.points, operand.normals, frame.low, frame.step, *space.bricks[:2], *space.parts[:4],
            *space.owners, guarded, seen, depth, cells,
        )  # fmt: skip
    depth *= frame.step
    return Sight(chosen, guarded, seen, depth, cells)


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


def cells_seen(sight: Sight, side: int, of_components: Booleans) -> NDArray[np.int32]:
    """Return the cells of some components that surfels see before (0) or behind (1) them."""
    found: NDArray[np.int32] = _cells_seen(sight.guarded, sight.cells, np.int64(side), of_components)
    return found


@kernel
def _cells_seen(guarded, cells, side, of_components):
    found = np.empty((len(guarded), 3), np.int32)
    count = 0
    for n in range(len(guarded)):
        component = guarded[n, side]
        if component >= 0 and of_components[component]:
            for axis in range(3):
                found[count, axis] = cells[n, side, axis]
            count += 1
    return found[:count]


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


@rows
def _look(
    first, last, chosen, points, normals, low, step, table, border, start, parts, of_part, of_brick, base, owned,
    of_surfel, means, guarded, seen, depth, cells,
):  # fmt: skip
    """Write the first free component before and behind each surfel, how far off it is, and where its own sheet alone
    lies before it once more.

    A plane's border ends within (|dx| + |dy| + |dz|) cells along its normal. Nothing is seen farther than a stride
    beyond that. The walk is written out here: as a function it would count references to a dozen arrays at each call.
    """
    inverse = 1.0 / step
    nx, ny, nz = 8 * table.shape[0], 8 * table.shape[1], 8 * table.shape[2]
    for row in range(first, last):
        n = chosen[row]
        x, y, z = (
            (points[n, 0] - low[0]) * inverse,
            (points[n, 1] - low[1]) * inverse,
            (points[n, 2] - low[2]) * inverse,
        )
        own = of_surfel[n]
        mx, my, mz = means[own, 0], means[own, 1], means[own, 2]
        square = mx * mx + my * my + mz * mz
        far = abs(normals[n, 0]) + abs(normals[n, 1]) + abs(normals[n, 2]) + _STRIDE
        for side in range(2):
            sign = 1.0 if side == 0 else -1.0
            dx, dy, dz = sign * normals[n, 0], sign * normals[n, 1], sign * normals[n, 2]
            clear = square > _COHERENT * _COHERENT
            component = np.int64(-1)
            t = 0.0
            last_cell = np.int64(-1)
            i = j = k = np.int64(-1)
            while t < far and far > 0.5 and component < 0:
                t += _STRIDE
                i, j, k = np.int64(x + t * dx), np.int64(y + t * dy), np.int64(z + t * dz)
                cell = (i << 40) | (j << 20) | k
                if cell == last_cell:
                    continue
                last_cell = cell
                if min(min(i, j), k) < 0 or i >= nx or j >= ny or k >= nz:
                    component = 0
                    break
                brick = table[i >> 3, j >> 3, k >> 3]
                if brick < 0:
                    component = of_brick[i >> 3, j >> 3, k >> 3]
                    break
                bit = bit_of(j & 7, k & 7)
                if border[brick, i & 7] & bit == np.uint64(0):
                    for part in range(start[brick], start[brick + 1]):
                        if parts[part, i & 7] & bit:
                            component = of_part[part]
                            break
                    break
                other = owner_of(owned[brick, i & 7], base[brick, i & 7], bit)
                if other >= 0 and clear:
                    across = means[other, 0] * mx + means[other, 1] * my + means[other, 2] * mz
                    clear = across >= _OPPOSED * square
            seen[row, side] = component
            depth[row, side] = t
            cells[row, side, 0], cells[row, side, 1], cells[row, side, 2] = i, j, k
            guarded[row, side] = component if clear else -1
