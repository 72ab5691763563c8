"""Several tasks at a time, each with its share of the threads: for work that its own kernels cannot spread."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from surfel._numba import threads_for

Item = TypeVar("Item")
Result = TypeVar("Result")

_UNEVEN = 1.5
"""Where the largest task is more than so many times its thread's share of all, kernels had better have all threads."""


def together(work: Callable[[Item], Result], items: Sequence[Item], sizes: Sequence[int]) -> list[Result]:
    """Return ``work(item)`` for each of some items of like size, in their order, several at a time on threads.

    A chain of short kernels leaves a second thread idle most of the time; two such chains side by side do not. Where
    the items are few, small or uneven, one comes after the other.

    Parameters
    ----------
    work : callable
        What is done to each; its kernels use the share of the threads that is left to it.
    items : sequence
        What it is done to.
    sizes : sequence of int
        How much work each of them is, in the items of :func:`surfel._numba.threads_for`.

    Raises
    ------
    Exception
        The first one, in the order of the items, that ``work`` raises.

    Examples
    --------
    >>> from surfel.core.together import together
    >>> together(abs, [-1, -2, 3], [1, 1, 1])
    [1, 2, 3]
    """
    with threads_for(sum(sizes)) as threads:
        side_by_side = min(threads, len(items))
        if side_by_side < 2 or max(sizes) * side_by_side > _UNEVEN * sum(sizes):
            return [work(item) for item in items]
        share = threads // side_by_side

        def alone(item: Item) -> Result:
            with threads_for(sum(sizes), share):
                return work(item)

        with ThreadPoolExecutor(side_by_side, thread_name_prefix="surfel-task") as pool:
            return list(pool.map(alone, items))
