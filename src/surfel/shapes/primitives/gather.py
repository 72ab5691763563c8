"""Events of many lines, written into slots of equal size, become compressed rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.core.cast import Floats, read_only
from surfel.core.crossings import Crossings
from surfel.core.lines import Lines


def readable(lines: Lines) -> tuple[Floats, Floats]:
    """Return read-only views of origins and directions: numba compiles a kernel once more for what may be written."""
    origins, directions = lines.origins.view(), lines.directions.view()
    return read_only(np.ascontiguousarray(origins)), read_only(np.ascontiguousarray(directions))


def gather(counts: NDArray[np.int32], t: Floats, cosine: Floats) -> Crossings:
    """Return crossings of weight 1 and leaf 0.

    Parameters
    ----------
    counts : NDArray[np.int32], shape (m,)
        Events of each line.
    t, cosine : Floats, shape (m, s)
        The first ``counts[l]`` of row l are the events of line l, in order.
    """
    offsets = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(counts, out=offsets[1:])
    events = int(offsets[-1])
    found = np.empty(events), np.empty(events)
    with threads_for(len(counts)):
        _copy(len(counts), offsets, t, cosine, *found)
    return Crossings(offsets, *found, np.ones(events), np.zeros(events, np.int32))


@rows
def _copy(first, last, offsets, t, cosine, found_t, found_cosine):
    for line in range(first, last):
        start = offsets[line]
        for k in range(offsets[line + 1] - start):
            found_t[start + k] = t[line, k]
            found_cosine[start + k] = cosine[line, k]
