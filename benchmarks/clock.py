"""Processor time on one thread: the time on the clock where the machine is quiet, and still of use where it is not."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable


def processor_seconds(work: Callable[[], object]) -> float:
    """Return the processor time of one run on one thread."""
    from surfel._numba import threads_for

    with threads_for(0):
        start = time.process_time()
        work()
        return time.process_time() - start


def median_seconds(work: Callable[[], object], repeats: int = 7) -> float:
    """Return the median of several runs, after one that does not count."""
    work()
    return statistics.median(processor_seconds(work) for _ in range(repeats))
