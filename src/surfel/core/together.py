"""Several tasks at a time, each with its share of the threads: for work that its own kernels cannot spread."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

import numba

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
        results: dict[int, Result] = {}
        errors: dict[int, Exception] = {}
        left = iter(range(len(items)))

        def some() -> None:
            with threads_for(sum(sizes), share):
                for number in left:
                    try:
                        results[number] = work(items[number])
                    except Exception as error:
                        errors[number] = error

        helpers = [_pool().submit(some) for _ in range(side_by_side - 1)]
        try:
            some()
        finally:
            deque(left, maxlen=0)  # on Ctrl-C the helpers find nothing left to do
            for helper in helpers:
                if not helper.cancel():  # one that did not start yet has nothing to do
                    helper.result()
        if errors:
            raise errors[min(errors)]
        return [results[number] for number in range(len(items))]


@cache
def _pool() -> ThreadPoolExecutor:
    """Return the helpers; not those of kernels, which tasks wait for."""
    return ThreadPoolExecutor(max(1, int(numba.config.NUMBA_NUM_THREADS)), thread_name_prefix="surfel-task")


if hasattr(os, "register_at_fork"):  # not on Windows, which cannot fork
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a forked child has none of its parent's threads
