"""Answers in sorted order brought into that of the cloud: only what is not outside and far has to be moved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel.inside.classes import Classes


def unsorted(found: Classes, order: NDArray[np.int32]) -> Classes:
    """Return the classes of places in the order in which they were given: sorted row r was row ``order[r]``."""
    kind, near = np.zeros_like(found.kind), np.zeros_like(found.near)
    with threads_for(len(order) // 4):
        _scatter(len(order), order, found.kind, found.near, kind, near)
    judged = order[found.judged].astype(np.int64)
    ascending = np.argsort(judged)
    return Classes(kind, near, judged[ascending], found.value[ascending])


@rows
def _scatter(first, last, order, kind, near, to_kind, to_near):
    for i in range(first, last):
        if kind[i] != 0:
            to_kind[order[i]] = kind[i]
        if near[i]:
            to_near[order[i]] = True
