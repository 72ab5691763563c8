"""Leaks: where space before and behind the surfels hangs together, films over the holes part it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Booleans, Floats
from surfel.inside.films import find_film
from surfel.inside.grid import BORDER, IN, OUT, Frame, Grid
from surfel.inside.operand import Operand
from surfel.inside.outvoted import outvoted
from surfel.inside.rims import Cells, find_rims, grown
from surfel.inside.sight import Sight, cells_seen
from surfel.inside.space import Space, bits_at, component_of, set_bits, with_border
from surfel.inside.votes import SLIGHT, capped_areas

SCATTERED = 0.01
"""Share of outvoted surfels from which on they are turned before a film is looked for: it would lie off by as much."""

RIM = 3
"""Votes are doubtful that are cast into a film; where none is, those nearest to one, within so many steps."""


class Films(NamedTuple):
    """All films of a space.

    Parameters
    ----------
    doubt : NDArray[np.uint64], shape (bricks, 8)
        Bits of their cells: border that no surfel is near.
    beside : NDArray[np.int32], shape (k, 3)
        Free cells near them.
    inside : Booleans, shape (k,)
        Whether the winding number there is above 1/2.
    """

    doubt: NDArray[np.uint64]
    beside: Cells
    inside: Booleans

    @classmethod
    def none(cls, space: Space) -> Films:
        """Return that there are none yet."""
        return cls(np.zeros_like(space.bricks.border), np.empty((0, 3), np.int32), np.zeros(0, bool))

    @property
    def number(self) -> int:
        """How many cells belong to films."""
        return int(np.bitwise_count(self.doubt).sum())


def close_leaks(
    space: Space, films: Films, leaky: Booleans, sight: Sight, operand: Operand, *, wide: bool
) -> tuple[Space, Films]:
    """Part leaky components by films over their holes; these become border, and doubt.

    A film is where the winding number of the cloud is 1/2. It is looked for from the rims on, which are where
    what surfels see before them comes close to what others see behind them; from ``wide`` rims more are found.
    """
    against = outvoted(operand, sight.chosen)
    guarded = sight.guarded.copy()
    guarded[against] = -1  # beside flipped surfels, rims would seem to be everywhere
    agreed = sight._replace(guarded=guarded)
    leak = find_rims(space, leaky, *(cells_seen(agreed, side, leaky) for side in (0, 1)), wide=wide)
    if not len(leak.rims):
        return space, films
    film = find_film(space.frame, leak, _turned(operand) if against.mean() > SCATTERED else operand)
    space = with_border(space, film.cells)
    doubt = np.concatenate([films.doubt, np.zeros((len(space.bricks.border) - len(films.doubt), 8), np.uint64)])
    set_bits(film.cells, space.bricks.table, doubt)
    beside, inside = np.concatenate([films.beside, film.beside]), np.concatenate([films.inside, film.inside])
    return space, Films(doubt, beside, inside)


def _turned(operand: Operand) -> Operand:
    """Return the operand with outvoted surfels turned."""

    def turn() -> Operand:
        against = outvoted(operand, np.arange(len(operand), dtype=np.int32))
        return operand.with_normals(np.where(against[:, None], -operand.normals, operand.normals))

    return operand._once("turned", turn)


def part_something(operand: Operand, before: Sight, leaky: Booleans, after: Sight, colours: NDArray[np.int8]) -> bool:
    """Tell whether films divide what surfels saw in leaky components; those round a stray do not."""
    was = (before.guarded >= 0) & leaky[before.guarded] & (after.guarded >= 0)
    now = colours[after.guarded]
    areas = capped_areas(operand, before.chosen)
    shares = [float((areas[:, None] * (was & (now == colour))).sum()) for colour in (IN, OUT)]
    return min(shares) > SLIGHT * float(areas.sum())


def hinted(space: Space, films: Films, colours: NDArray[np.int8]) -> NDArray[np.int8]:
    """Return the colours, with those of components that too few surfels see taken from what was found beside films."""
    if not (films.number and (colours == BORDER).any()):
        return colours
    bricks, parts = space.bricks, space.parts
    component = component_of(films.beside, bricks.table, *parts[:4])
    known = component >= 0
    sides = np.bincount(component[known], np.where(films.inside[known], 1.0, -1.0), parts.number)
    unknown = (colours == BORDER) & (sides != 0.0)
    return np.where(unknown, np.where(sides > 0.0, IN, OUT), colours).astype(np.int8)


def share_at_rims(space: Space, films: Films, sight: Sight, operand: Operand) -> float:
    """Return the share of the votes, before there were films, that are cast into one, or right beside it."""
    table, words = space.bricks.table, films.doubt
    everything = np.full_like(words, np.iinfo(np.uint64).max)
    areas = operand.areas[sight.chosen][:, None]
    valid = sight.guarded >= 0
    cells = sight.cells.reshape(-1, 3)
    beside = valid & bits_at(cells, table, words).reshape(-1, 2)
    for _ in range(RIM):
        if beside.any():
            break
        words = grown(table, everything, words)
        beside = valid & bits_at(cells, table, words).reshape(-1, 2)
    total = float((areas * valid).sum())
    return float((areas * beside).sum()) / total if total > 0.0 else 0.0


def in_doubt(grid: Grid, doubt: NDArray[np.uint64], places: Floats) -> Booleans:
    """Tell which places, in the operand's coordinates, lie in cells of the doubt."""
    frame = Frame(grid.low, grid.step, grid.table.shape)
    found: Booleans = bits_at(_cells_at(frame, places), grid.table, doubt)
    return found


def _cells_at(frame: Frame, places: Floats) -> Cells:
    cells = np.floor((places - frame.low) / frame.step)
    return np.asarray(np.clip(cells, -1, 8 * np.array(frame.bricks)).astype(np.int32))
