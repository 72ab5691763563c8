"""Kernels over runs of items: every item once, whatever the threads; the limits that are set; errors that come out."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import numba
import numpy as np
import pytest

from surfel._numba import rows, threads_for


@rows
def _mark(first, last, times, value):
    for i in range(first, last):
        times[i] += value


@pytest.mark.parametrize("count", [0, 1, 2, 7, 1000])
def test_every_item_is_met_once(count):
    times = np.zeros(count, np.int64)
    _mark(count, times, 1)
    assert (times == 1).all()


@pytest.mark.parametrize("threads", [1, 2])
def test_every_item_is_met_once_on_any_number_of_threads(threads):
    times = np.zeros(100_003, np.int64)
    with threads_for(len(times), threads) as used:
        assert used <= threads
        _mark(len(times), times, 1)
    assert (times == 1).all()


def test_small_inputs_run_on_one_thread_and_the_limit_ends_with_the_block():
    with threads_for(1_000_000) as outer:
        with threads_for(10) as inner:
            assert inner == 1
        with threads_for(1_000_000) as again:
            assert again == outer
    assert outer == numba.get_num_threads()


def test_what_numba_was_told_is_kept():
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        with threads_for(1_000_000) as used:
            assert used == 1
    finally:
        numba.set_num_threads(before)


def test_many_python_threads_may_call_one_kernel_at_once():
    arrays = [np.zeros(60_000, np.int64) for _ in range(8)]

    def work(array):
        with threads_for(len(array)):
            for _ in range(5):
                _mark(len(array), array, 1)

    workers = [threading.Thread(target=work, args=(array,)) for array in arrays]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(60)
    assert all((array == 5).all() for array in arrays)


def test_an_error_inside_comes_out():
    with pytest.raises(numba.core.errors.NumbaError):
        _mark(10, np.zeros(10), "no number")


_FORK = """
import os, sys
import numpy as np
from surfel._numba import rows, threads_for

@rows
def double(first, last, values, out):
    for i in range(first, last):
        out[i] = 2.0 * values[i]

def run():
    values, out = np.arange(1000.0), np.zeros(1000)
    with threads_for(10**6, 2):
        double(1000, values, out)
    return (out == 2.0 * values).all()

assert run()
child = os.fork()
if child == 0:
    os._exit(0 if run() else 1)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_child_starts_threads_of_its_own(tmp_path):
    script = tmp_path / "fork.py"
    script.write_text(_FORK)
    environment = {**os.environ, "NUMBA_NUM_THREADS": "2"}
    assert subprocess.run([sys.executable, str(script)], env=environment, timeout=120).returncode == 0
