"""Long loops over rows cut into parts for a few threads: numpy and the system let go of the interpreter's lock."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from itertools import pairwise

import numpy as np

_MOST = 4
_FEW = 200_000
"""Below so many rows the start of threads costs more than they save."""


def in_parts(work: Callable[[int, int], None], count: int, step: int) -> None:
    """Call ``work(first, last)`` for runs of ``step`` rows until all are done, on several threads if they are many.

    Each run has to write to places of its own; then the result is the same on any number of threads.
    """
    runs = iter(pairwise([*range(0, count, step), count]))

    def share() -> None:
        with np.errstate(all="ignore"):
            for first, last in runs:
                work(first, last)

    threads = min(_MOST, _cores()) if count >= _FEW else 1
    if threads == 1:
        share()
        return
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(threads - 1) as pool:
        helpers = [pool.submit(share) for _ in range(threads - 1)]
        try:
            share()
        finally:
            deque(runs, maxlen=0)  # on an error or Ctrl-C the helpers find nothing left to do
        for helper in helpers:
            helper.result()


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
