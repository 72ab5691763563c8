"""Eights: every operation against numpy, lane by lane, in all ways in which eights and floats can meet."""

from __future__ import annotations

import operator

import numpy as np
import pytest

from surfel._numba import kernel
from surfel.rendering.eights import (
    LANES,
    add_fours,
    equal,
    load,
    load_fours,
    pick,
    ramp,
    root,
    some,
    store,
    store_fours,
)

A = np.array([1.5, -2.0, 0.0, 3.25, -0.0, 1e20, -7.0, 0.125], np.float32)
B = np.array([0.5, -2.0, 4.0, -1.0, 2.0, 1e-3, 7.0, 0.125], np.float32)
ONE = np.float32(-2.0)


def of_pairs(operation):
    """Return a kernel that writes eight by eight, eight by float, and float by eight."""

    @kernel
    def run(a, b, one, out):
        first, second = load(a, np.uint64(0)), load(b, np.uint64(0))
        store(out, np.uint64(0), operation(first, second))
        store(out, np.uint64(8), operation(first, one))
        store(out, np.uint64(16), operation(one, second))

    return run


def of_comparison(operation):
    """Return a kernel that writes 1 where a comparison holds and -1 elsewhere, in the same three ways."""

    @kernel
    def run(a, b, one, out):
        first, second = load(a, np.uint64(0)), load(b, np.uint64(0))
        yes, no = np.float32(1.0), np.float32(-1.0)
        store(out, np.uint64(0), pick(operation(first, second), yes, no))
        store(out, np.uint64(8), pick(operation(first, one), yes, no))
        store(out, np.uint64(16), pick(operation(one, second), yes, no))

    return run


def pairs(operation) -> np.ndarray:
    with np.errstate(all="ignore"):
        return np.concatenate([operation(A, B), operation(A, ONE), operation(ONE, B)])


@pytest.mark.parametrize("name", ["add", "sub", "mul", "truediv"])
def test_arithmetic_is_that_of_single_floats(name):
    operation, out = getattr(operator, name), np.empty(3 * LANES, np.float32)
    of_pairs(operation)(A, B, ONE, out)
    np.testing.assert_array_equal(out, pairs(operation))


@pytest.mark.parametrize("name", ["lt", "gt", "le", "eq"])
def test_comparisons_are_those_of_single_floats(name):
    operation, out = getattr(operator, name), np.empty(3 * LANES, np.float32)
    of_comparison(operation)(A, B, ONE, out)
    np.testing.assert_array_equal(out > 0.0, pairs(operation))


@kernel
def _others(a, b, out):
    first, second = load(a, np.uint64(0)), load(b, np.uint64(0))
    both = (first < second) & (second > np.float32(0.0))
    store(out, np.uint64(0), -first)
    store(out, np.uint64(8), root(second))
    store(out, np.uint64(16), ramp())
    store(out, np.uint64(24), pick(both, first, np.float32(9.0)))
    store(out, np.uint64(32), pick(both, np.float32(9.0), second))


def test_signs_roots_ramps_and_choices():
    out = np.empty(5 * LANES, np.float32)
    _others(A, np.abs(B), out)
    b = np.abs(B)
    both = (b > A) & (b > 0.0)
    np.testing.assert_array_equal(out[:8], -A)
    assert np.signbit(out[2]) and not np.signbit(out[4])  # of zeros, too
    np.testing.assert_array_equal(out[8:16], np.sqrt(b))
    np.testing.assert_array_equal(out[16:24], np.arange(8))
    np.testing.assert_array_equal(out[24:32], np.where(both, A, np.float32(9.0)))
    np.testing.assert_array_equal(out[32:], np.where(both, np.float32(9.0), b))


@kernel
def _moved(source, at, to, target):
    store(target, to, load(source, at))


def test_eights_are_read_and_written_anywhere_and_nowhere_else():
    source, target = np.arange(20, dtype=np.float32), np.full(20, -1.0, np.float32)
    _moved(source, np.uint64(3), np.uint64(5), target)
    np.testing.assert_array_equal(target[5:13], source[3:11])
    assert (target[:5] == -1.0).all() and (target[13:] == -1.0).all()


@kernel
def _moved_in_fours(source, at, beside, to, next_to, target):
    store_fours(target, to, next_to, load_fours(source, at, beside))


def test_fours_come_from_two_places_and_go_to_two():
    source, target = np.arange(20, dtype=np.float32), np.full(20, -1.0, np.float32)
    _moved_in_fours(source, np.uint64(3), np.uint64(14), np.uint64(12), np.uint64(1), target)
    np.testing.assert_array_equal(target[12:16], source[3:7])
    np.testing.assert_array_equal(target[1:5], source[14:18])
    assert (np.delete(target, [1, 2, 3, 4, 12, 13, 14, 15]) == -1.0).all()
    _moved_in_fours(source, np.uint64(0), np.uint64(4), np.uint64(6), np.uint64(8), target)
    np.testing.assert_array_equal(target[6:12], [0, 1, 4, 5, 6, 7])  # where both meet, the second stays


@kernel
def _added_in_fours(target, at, beside, source):
    add_fours(target, at, beside, load(source, np.uint64(0)))


def test_fours_are_added_one_after_the_other():
    source, target = np.arange(1, 9, dtype=np.float32), np.full(20, 100.0, np.float32)
    _added_in_fours(target, np.uint64(3), np.uint64(12), source)
    np.testing.assert_array_equal(target[3:7], [101, 102, 103, 104])
    np.testing.assert_array_equal(target[12:16], [105, 106, 107, 108])
    assert (np.delete(target, [3, 4, 5, 6, 12, 13, 14, 15]) == 100.0).all()
    _added_in_fours(target, np.uint64(8), np.uint64(10), source)
    np.testing.assert_array_equal(target[8:12], [101, 102, 108, 110])  # where both meet, both count


@kernel
def _equal(numbers, at, other):
    return equal(numbers, at, other)


@kernel
def _either(a, one, other):
    return some((load(a, np.uint64(0)) < one) | (load(a, np.uint64(0)) > other))


@pytest.mark.parametrize("lane", range(LANES))
def test_every_lane_counts_where_numbers_are_equal_or_one_of_two_holds(lane):
    numbers = np.tile(np.arange(-3, 5, dtype=np.int32), 2)
    assert _equal(numbers, np.uint64(0), np.uint64(8))
    numbers[8 + lane] += 1
    assert not _equal(numbers, np.uint64(0), np.uint64(8))
    values = np.zeros(LANES, np.float32)
    assert not _either(values, np.float32(-1.0), np.float32(1.0))
    for value in (-2.0, 2.0):
        values[lane] = value
        assert _either(values, np.float32(-1.0), np.float32(1.0))


@kernel
def _any_below(a, one):
    return some(load(a, np.uint64(0)) < one)


@pytest.mark.parametrize("lane", range(LANES))
def test_some_sees_every_lane(lane):
    values = np.zeros(LANES, np.float32)
    assert not _any_below(values, np.float32(0.0))
    values[lane] = -1.0
    assert _any_below(values, np.float32(0.0))


def test_what_is_no_number_compares_as_false():
    values = np.full(LANES, np.nan, np.float32)
    assert not _any_below(values, np.float32(np.inf))
