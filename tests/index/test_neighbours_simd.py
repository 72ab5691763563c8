"""The vector forms of the small list functions against their plain forms and against numpy."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from surfel.index import simd

RNG = np.random.default_rng
vector_only = pytest.mark.skipif(not simd.VECTOR, reason="this processor or LLVM has no vector compress")


@numba.njit
def sort_keys(keys, count, spare, ordered):
    simd.sort_keys(keys, count, spare, ordered)


@numba.njit
def within_plain(xs, ys, zs, count, x, y, z, limit, mask, keys):
    return simd.within_plain(xs, ys, zs, count, x, y, z, limit, mask, keys)


@numba.njit
def children_plain(nodes, node, base, lx, ly, lz, hx, hy, hz, square, found, kept):
    return simd.children_plain(nodes, node, base, lx, ly, lz, hx, hy, hz, square, found, kept)


if simd.VECTOR:

    @numba.njit
    def within_vector(xs, ys, zs, count, x, y, z, limit, mask, keys):
        return simd.within_vector(xs, ys, zs, count, x, y, z, limit, mask, keys)

    @numba.njit
    def children_vector(nodes, node, base, lx, ly, lz, hx, hy, hz, square, found, kept):
        return simd.children_vector(nodes, node, base, lx, ly, lz, hx, hy, hz, square, found, kept)


def case(seed, count):
    rng = RNG(seed)
    points = rng.normal(size=(3, count + 16)).astype(np.float32)
    points[:, count - 3 : count] = np.inf  # how the last block is filled up
    place = rng.normal(size=3).astype(np.float32)
    return points, place, np.float32(rng.uniform(0.01, 8)).view(np.int32)


@pytest.mark.parametrize("count", [16, 48, 256, 1008])
def test_the_filter_keeps_what_is_within_the_limit(count):
    for seed in range(20):
        points, place, limit = case(seed, count)
        keys = np.zeros(count + 16, np.int32)
        kept = within_plain(*points, count, *place, limit, np.int32(1023), keys)
        gap = points[:, :count] - place[:, None]
        squares = (gap[0] * gap[0] + gap[1] * gap[1]) + gap[2] * gap[2]
        expected = (squares.view(np.int32) & ~1023) | np.arange(count, dtype=np.int32)
        assert np.array_equal(keys[:kept], expected[expected <= limit])


@vector_only
@pytest.mark.parametrize("count", [16, 48, 256, 1008])
def test_both_filters_give_the_same_bits(count):
    for seed in range(20):
        points, place, limit = case(seed, count)
        one, two = np.zeros(count + 16, np.int32), np.zeros(count + 16, np.int32)
        kept = within_plain(*points, count, *place, limit, np.int32(1023), one)
        assert within_vector(*points, count, *place, limit, np.int32(1023), two) == kept
        assert np.array_equal(one[:kept], two[:kept])


def test_keys_are_sorted_whatever_their_number():
    for count in [*range(1, 140), 255, 256, 257, 500, 1000]:
        room = count + simd.RUN
        keys = np.zeros(room, np.int32)
        keys[:count] = RNG(count).permutation(2**20)[:count]
        keys[count:] = -5  # what lies behind must not come in
        ordered = np.zeros(room, np.int32)
        before = keys.copy()
        sort_keys(keys, count, np.zeros(room, np.int32), ordered)
        assert np.array_equal(ordered[:count], np.sort(before[:count])), count


def boxes(seed):
    rng = RNG(seed)
    low = rng.normal(size=(5, 3, 8))
    high = low + rng.random((5, 3, 8))
    low[4, :, 5:], high[4, :, 5:] = np.inf, -np.inf  # children that do not exist
    corner = rng.normal(size=3)
    return np.concatenate([low, high], axis=1), low, high, corner, corner + rng.random(3)


@pytest.mark.parametrize("form", ["plain", pytest.param("vector", marks=vector_only)])
def test_children_in_reach_are_found(form):
    function = children_plain if form == "plain" else children_vector
    seen = 0
    for seed in range(30):
        nodes, low, high, corner, opposite = boxes(seed)
        for node in range(5):
            gap = np.maximum(np.maximum(low[node] - opposite[:, None], corner[:, None] - high[node]), 0)
            near = np.flatnonzero((gap**2).sum(axis=0) <= 1.5)
            found = np.full(20, -1, np.int32)
            kept = function(nodes.ravel(), node, 80, *corner, *opposite, 1.5, found, 3)
            assert kept == 3 + len(near)
            assert np.array_equal(found[3:kept], 80 + near)
            assert (found[:3] == -1).all()
            seen += len(near)
    assert 100 < seen < 1100


def test_a_generic_processor_is_not_taken_for_this_one(monkeypatch):
    monkeypatch.setattr(numba.config, "CPU_NAME", "generic")
    assert not simd.compresses()


def test_an_old_compiler_is_not_asked_for_what_it_lacks(monkeypatch):
    monkeypatch.setattr(simd.llvm, "llvm_version_info", (15, 0, 7))
    assert not simd.compresses()
