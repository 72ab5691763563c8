"""Colour: what lies inside a cloud, cell by cell, from its border, the components of free space, and the votes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inlined, kernel, rows, threads_for
from surfel.core.cast import Booleans, Floats
from surfel.inside.border import Bricks
from surfel.inside.components import Components
from surfel.inside.grid import ALL_IN, ALL_OUT, BORDER, IN, Frame, Grid
from surfel.inside.leaks import Films, close_leaks, hinted, part_something, share_at_rims
from surfel.inside.operand import Operand
from surfel.inside.owners import Owners, own_cells
from surfel.inside.sight import look
from surfel.inside.space import Space, space_round
from surfel.inside.votes import FEW, Ballot, count_votes, first_voters, flipped_beside

_FULL = np.uint64(0xFFFFFFFFFFFFFFFF)
_NONE = np.uint64(0)


class Coloured(NamedTuple):
    """A cloud's coloured space, and what was found out on the way.

    Parameters
    ----------
    grid : Grid
        The space.
    owners : Owners
        The cells that hold surfels, of the re-oriented cloud.
    operand : Operand
        The cloud with flipped normals turned.
    flipped : Booleans, shape (n,)
        Which of the sorted surfels were turned.
    conflict : float
        Share of the votes (by area) that contradict the colours, with normals as they were given, or are cast beside a
        film.
    leaky : bool
        Whether inside and outside hang together through a hole, so that films had to part them, or nothing did.
    doubt : NDArray[np.uint64], shape (bricks, 8), or None
        Bits of border cells that no surfel is near but the level of the winding number; None where there are none.
    radii : Floats, shape (n,)
        Of the disks that make the border.
    """

    grid: Grid
    owners: Owners
    operand: Operand
    flipped: Booleans
    conflict: float
    leaky: bool
    doubt: NDArray[np.uint64] | None
    radii: Floats


def colour_space(operand: Operand) -> Coloured:
    """Colour the space round a cloud of at least one surfel.

    The border is what the disks of the surfels meet. The free cells fall into components; the surfels vote which are
    inside. Where the votes for a component disagree, space leaks: films over the holes part it, and the votes are
    counted again.
    """
    space, films, ballot, flipped = _settled(space_round(operand), operand)
    if flipped.any():
        operand = turned(operand, flipped)
        owners = own_cells(space.frame, space.bricks, operand.points, operand.normals)
        space = space._replace(owners=owners)
    grid = paint(space.frame, space.bricks, space.parts, hinted(space, films, ballot.colours))
    doubt = films.doubt if films.number else None
    leaky = doubt is not None or bool(ballot.leaky.any())
    return Coloured(grid, space.owners, operand, flipped, ballot.conflict, leaky, doubt, space.radii)


def _settled(space: Space, operand: Operand) -> tuple[Space, Films, Ballot, Booleans]:
    """Count votes and close leaks: first by some of the surfels, and by all of them where that is not enough."""
    voters, films = first_voters(operand), Films.none(space)
    everyone = np.arange(len(operand), dtype=np.int32)
    sight = at_first = look(space, operand, voters)
    ballot = count_votes(operand, sight, space.parts.number)
    for asked, wide in ((voters, False), (voters, True), (everyone, True)):
        if not ballot.leaky.any():
            break
        if len(asked) > len(voters):
            voters, sight = asked, look(space, operand, asked)
        parted, more = close_leaks(space, films, ballot.leaky, sight, operand, wide=wide)
        after = look(parted, operand, voters)
        found = count_votes(operand, after, parted.parts.number, checked=True)
        if part_something(operand, sight, ballot.leaky, after, found.colours):
            space, films, sight, ballot = parted, more, after, found
        else:
            ballot = count_votes(operand, sight, space.parts.number, checked=True)
    if ballot.flipped.sum() > FEW * len(voters) and len(voters) < len(operand):
        voters, sight = everyone, look(space, operand, everyone)
        ballot = count_votes(operand, sight, space.parts.number, checked=films.number > 0)
    if films.number:
        beside = share_at_rims(space, films, at_first, operand)
        ballot = ballot._replace(conflict=min(ballot.conflict + beside, 1.0))
    flipped = ballot.flipped if len(voters) == len(operand) else flipped_beside(space, operand, ballot, voters)
    return space, films, ballot, flipped


def turned(operand: Operand, flipped: Booleans) -> Operand:
    """Return an operand with some of its normals turned round."""
    return operand.with_normals(np.where(flipped[:, None], -operand.normals, operand.normals))


def paint(frame: Frame, bricks: Bricks, parts: Components, colours: NDArray[np.int8]) -> Grid:
    """Give every free cell the colour of its component; bricks of one colour need no words."""
    table = _uniform_table(bricks.table, parts.of_brick, colours)
    border, inside = bricks.border, np.zeros_like(bricks.border)
    state = np.zeros(len(border), np.int32)
    with threads_for(64 * len(border)):
        _paint(len(border), border, inside, parts.start, parts.parts, parts.of_part, colours, state)
    _empty(table, state)
    if (table == len(border)).any():  # free space that nobody voted for: one brick of border stands for all of it
        border = np.concatenate([border, np.full((1, 8), _FULL)])
        inside = np.concatenate([inside, np.zeros((1, 8), np.uint64)])
    return Grid(frame.low, frame.step, table, border, inside, clearance(table))


def _uniform_table(
    numbers: NDArray[np.int32], of_brick: NDArray[np.int32], colours: NDArray[np.int8]
) -> NDArray[np.int32]:
    """Return the table with the colours of the bricks that no disk comes near."""
    known = int(numbers.max()) + 1
    entry = np.array([ALL_OUT, ALL_IN, known], np.int32)[colours]
    return np.where(of_brick >= 0, entry[np.maximum(of_brick, 0)], numbers).astype(np.int32)


@rows
def _paint(first, last, border, inside, start, parts, of_part, colours, state):
    for brick in range(first, last):
        for part in range(start[brick], start[brick + 1]):
            colour = colours[of_part[part]]
            for layer in range(8):
                if colour == IN:
                    inside[brick, layer] |= parts[part, layer]
                elif colour == BORDER:
                    border[brick, layer] |= parts[part, layer]
        state[brick] = uniform_state(border, inside, brick)


@inlined
def uniform_state(border, inside, brick):
    """Return ALL_OUT or ALL_IN where a brick's cells have that one colour, else 0."""
    some_border, some_inside, all_inside = _NONE, _NONE, _FULL
    for layer in range(8):
        some_border |= border[brick, layer]
        some_inside |= inside[brick, layer]
        all_inside &= inside[brick, layer]
    if some_border == _NONE and some_inside == _NONE:
        return ALL_OUT
    return ALL_IN if some_border == _NONE and all_inside == _FULL else 0


@kernel
def _empty(table, state):
    """Let the table say so where a brick turned out to be of one colour."""
    for i in range(table.shape[0]):
        for j in range(table.shape[1]):
            for k in range(table.shape[2]):
                brick = table[i, j, k]
                if 0 <= brick < len(state) and state[brick] < 0:
                    table[i, j, k] = state[brick]


@kernel
def clearance(table):
    """Return the Chebyshev distance of each brick to the nearest one with words, up to 255, by two sweeps."""
    nx, ny, nz = table.shape
    gap = np.empty(table.shape, np.uint8)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                gap[i, j, k] = 0 if table[i, j, k] >= 0 else 255
    for sweep in range(2):
        step = 1 if sweep == 0 else -1
        for a in range(nx):
            i = a if sweep == 0 else nx - 1 - a
            for b in range(ny):
                j = b if sweep == 0 else ny - 1 - b
                for c in range(nz):
                    k = c if sweep == 0 else nz - 1 - c
                    least = np.int64(gap[i, j, k])
                    if least == 0:
                        continue
                    for u in range(-1, 2):
                        for v in range(-1, 2):
                            for w in range(-1, 2):
                                if (u, v, w) >= (0, 0, 0):
                                    continue
                                p, q, s = i + step * u, j + step * v, k + step * w
                                if 0 <= p < nx and 0 <= q < ny and 0 <= s < nz:
                                    least = min(least, np.int64(gap[p, q, s]) + 1)
                    gap[i, j, k] = least
    return gap
