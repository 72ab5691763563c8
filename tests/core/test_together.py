"""Tasks side by side: the results, their order, the threads that each is left, and errors."""

from __future__ import annotations

import threading

import pytest

from surfel._numba import threads_for
from surfel.core.together import together

LARGE = 10**6


def limit_and_thread(_):
    with threads_for(10**9) as threads:
        return threads, threading.current_thread().name


def side_by_side(sizes, threads):
    """Return the threads that the kernels of each task may use, and whether any ran on a thread of its own."""
    with threads_for(10**9, threads) as most:
        found = together(limit_and_thread, range(len(sizes)), sizes)
    return [limit for limit, _ in found], any(name.startswith("surfel-task") for _, name in found), most


def test_results_stand_in_the_order_of_the_items():
    assert together(lambda k: k * k, range(20), [LARGE] * 20) == [k * k for k in range(20)]
    assert together(str, [], []) == []


def test_tasks_share_the_threads():
    limits, apart, most = side_by_side([LARGE, LARGE], 2)
    if most < 2:
        pytest.skip("only one thread is to be had here")
    assert apart and limits == [1, 1]


@pytest.mark.parametrize("sizes", [[10, 10], [LARGE, LARGE // 10], [LARGE]])
def test_small_uneven_and_single_tasks_come_one_after_the_other(sizes):
    _, apart, _ = side_by_side(sizes, 2)
    assert not apart


def test_uneven_tasks_have_all_threads():
    limits, _, most = side_by_side([LARGE, LARGE // 10], 2)
    assert limits == [most, most]


def test_one_thread_is_no_other():
    _, apart, _ = side_by_side([LARGE] * 4, 1)
    assert not apart


def test_the_first_error_comes_out():
    def work(k):
        if k:
            raise ValueError(f"task {k}")
        return k

    with pytest.raises(ValueError, match="task 1"):
        together(work, range(3), [LARGE] * 3)
