"""What the kernels of polynomial surfaces keep of a few chords at a time, allocated once for a run of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner
from surfel.core.cast import Booleans, Floats, Integers
from surfel.roots.bernstein import STACK

_POINTS = 256  # evaluated at a time
_WAITING = 24  # pieces for each chord: more than 2 * 8 halvings leave behind


class Block(NamedTuple):
    """A few chords and what is found on them; u runs from 0 to 1 along a chord.

    Parameters
    ----------
    ends, along : Floats, shape (b, 3)
        Where each begins, and the way to its end, in the frame of the form.
    lengths, tolerances : Floats, shape (b,)
        The length in the world; the rounding of a coordinate.
    negative : Booleans, shape (b, 2)
        Whether the polynomial is negative at the two ends.
    number : Integers, shape (b,)
        How many roots there are.
    roots, cosines : Floats, shape (b, room)
        The roots u, ascending, and the cosines of the line with the gradient there.
    """

    ends: Floats
    along: Floats
    lengths: Floats
    tolerances: Floats
    negative: Booleans
    number: Integers
    roots: Floats
    cosines: Floats


class Scratch(NamedTuple):
    """Room to work in.

    Parameters
    ----------
    points, powers : Floats, shape (3, w) and (3, most + 1, w)
        Places in the frame of the form, and the powers of their coordinates.
    values, slopes, group : Floats, shape (w,), (3, w) and (w,)
        The polynomial there, its gradient, and a part of a sum.
    parts, solved : Floats
        For :func:`~surfel.roots.bernstein.roots_of`.
    pieces, halves : Floats, shape (s, 3)
        Pieces of chords that wait to be solved: chord, from u, to u.
    listed : NDArray[np.int64], shape (w, 2)
        Roots that are polished together: chord, number.
    """

    points: Floats
    powers: Floats
    values: Floats
    slopes: Floats
    group: Floats
    parts: Floats
    solved: Floats
    pieces: Floats
    halves: Floats
    listed: NDArray[np.int64]


@inner
def new_block(form, room):
    """Allocate for as many chords as have 256 nodes between them, but four at least."""
    chords = max(4, _POINTS // len(form.nodes))
    return Block(
        np.empty((chords, 3)),
        np.empty((chords, 3)),
        np.empty(chords),
        np.empty(chords),
        np.empty((chords, 2), np.bool_),
        np.empty(chords, np.int64),
        np.empty((chords, room)),
        np.empty((chords, room)),
    )


@inner
def new_scratch(form, chords):
    """Allocate room to work on ``chords`` chords."""
    width = max(chords * len(form.nodes), _POINTS)
    most = max(form.degrees[0], form.degrees[1], form.degrees[2])
    return Scratch(
        np.empty((3, width)),
        np.empty((3, most + 1, width)),
        np.empty(width),
        np.empty((3, width)),
        np.empty(width),
        np.empty((STACK, len(form.nodes) + 2)),
        np.empty(len(form.nodes)),
        np.empty((_WAITING * chords, 3)),
        np.empty((width, 3)),
        np.empty((width, 2), np.int64),
    )
