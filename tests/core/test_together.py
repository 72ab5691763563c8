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


def at_the_same_time(meeting):
    def work(_):
        meeting.wait()
        return limit_and_thread(_)

    return work


def side_by_side(sizes, threads):
    """Return the threads that the kernels of each task may use, and whether any ran on a thread of its own."""
    with threads_for(10**9, threads) as most:
        found = together(limit_and_thread, range(len(sizes)), sizes)
    return [limit for limit, _ in found], any(name.startswith("surfel-task") for _, name in found), most


def test_results_stand_in_the_order_of_the_items():
    assert together(lambda k: k * k, range(20), [LARGE] * 20) == [k * k for k in range(20)]
    assert together(str, [], []) == []


def test_tasks_share_the_threads():
    with threads_for(10**9, 2) as most:
        if most < 2:
            pytest.skip("only one thread is to be had here")
        found = together(at_the_same_time(threading.Barrier(2, timeout=10.0)), range(2), [LARGE, LARGE])
    assert [limit for limit, _ in found] == [1, 1]
    assert sum(name.startswith("surfel-task") for _, name in found) == 1


def test_tasks_within_tasks_end_though_all_threads_are_taken():
    def outer(_):
        return together(lambda k: k, range(4), [LARGE] * 4)

    assert together(outer, range(8), [LARGE] * 8) == [list(range(4))] * 8


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
