"""The orders along curves: permutations that keep what is near together, and the sort beneath them."""

from __future__ import annotations

import numpy as np
import pytest

from surfel import InputError
from surfel._numba import threads_for
from surfel.index.hilbert import hilbert_order
from surfel.index.morton import morton_order_lines
from surfel.index.radix import index_bits, sort_packed

RNG = np.random.default_rng


def steps(points):
    return np.linalg.norm(np.diff(points, axis=0), axis=1)


@pytest.mark.parametrize("bits", [2, 3, 4])
def test_the_curve_goes_from_cell_to_neighbouring_cell(bits):
    side = np.arange(2.0**bits)
    cells = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
    order = hilbert_order(RNG(0).permutation(cells), bits)
    assert np.array_equal(np.sort(order), np.arange(len(cells)))
    assert (steps(RNG(0).permutation(cells)[order]) == 1).all()


def test_rows_that_follow_each_other_are_near():
    points = RNG(0).random((30_000, 3))
    assert steps(points[hilbert_order(points)]).mean() < 1.5 * 30_000 ** (-1 / 3)


@pytest.mark.parametrize("scale", [1e-300, 1e-12, 1.0, 1e12, 1e300])
def test_scale_and_offset_change_nothing(scale):
    points = RNG(0).integers(0, 1024, size=(5000, 3)).astype(float)
    points[:2] = [[0, 0, 0], [1024, 1024, 1024]]
    factor = 2.0 ** np.round(np.log2(scale))
    assert np.array_equal(hilbert_order(points), hilbert_order(points * factor))
    assert np.array_equal(hilbert_order(points), hilbert_order(points + 2.0**30))


def test_a_stray_point_does_not_coarsen_the_rest():
    points = RNG(0).random((20_000, 3))
    order = hilbert_order(np.concatenate([points, [[1e200, 0, 0]]]))
    rest = points[order[order < 20_000]]
    assert steps(rest).mean() < 1.5 * 20_000 ** (-1 / 3)


def test_clusters_of_every_scale_are_ordered_inside():
    clusters = [RNG(s).random((1000, 3)) * 10.0 ** (-3 * s) + 3 * s for s in range(5)]
    points = np.concatenate(clusters)
    order = hilbert_order(points)
    for s in range(5):
        own = order[(order >= 1000 * s) & (order < 1000 * s + 1000)]
        breaks = np.diff(np.flatnonzero(np.isin(order, own))) != 1
        assert breaks.sum() < 8  # at most one run for each cell at a corner of the coarse grid
        assert steps(points[own]).mean() < 2 * 10.0 ** (-3 * s) * 1000 ** (-1 / 3)


def test_equal_points_stay_together_in_their_order():
    points = np.repeat(RNG(0).random((300, 3)), 50, axis=0)
    order = hilbert_order(points).reshape(300, 50)
    assert (np.diff(order, axis=1) == 1).all()
    assert np.array_equal(hilbert_order(np.ones((1000, 3))), np.arange(1000))


def test_points_that_crowd_at_every_scale_end():
    points = np.concatenate([2.0 ** -np.arange(1000.0)[:, None] * [[1.0, 0, 0]]] * 20)
    order = hilbert_order(points)
    assert np.array_equal(np.sort(order), np.arange(20_000))
    assert np.unique(np.diff(points[order, 0]) != 0, return_counts=True)[1][1] == 999


@pytest.mark.parametrize("n", [0, 1, 2, 17, 255, 256, 257, 60_000])
def test_any_number_of_points_on_any_number_of_threads(n):
    points = RNG(n).normal(size=(n, 3))
    orders = []
    for threads in (1, 2):
        with threads_for(10**6, threads):
            orders.append(hilbert_order(points))
    assert orders[0].dtype == np.int32
    assert np.array_equal(np.sort(orders[0]), np.arange(n))
    assert np.array_equal(*orders)


@pytest.mark.parametrize("bits", [0, 22, 1.5])
def test_bits_out_of_range_are_refused(bits):
    with pytest.raises(InputError, match="bits"):
        hilbert_order(np.zeros((3, 3)), bits)


def test_points_that_are_not_finite_are_refused():
    with pytest.raises(InputError, match="not finite"):
        hilbert_order([[0, 0, np.nan]])


@pytest.mark.parametrize(("n", "bits"), [(1, 1), (2, 1), (10_000, 5), (70_000, 12), (70_000, 13), (70_000, 40)])
def test_the_sort_is_stable_and_leaves_low_bits_alone(n, bits):
    keys = RNG(bits).integers(0, 2**bits, size=n)
    low = index_bits(n)
    for threads in (1, 2):
        with threads_for(10**6, threads):
            found = sort_packed(keys << low | np.arange(n), low, bits)
        assert np.array_equal(found & (2**low - 1), np.argsort(keys, kind="stable"))
        assert np.array_equal(found >> low, np.sort(keys))


def lines(m):
    directions = RNG(0).normal(size=(m, 3))
    return RNG(1).normal(size=(m, 3)), directions / np.linalg.norm(directions, axis=1)[:, None]


def test_lines_that_follow_each_other_are_near_in_direction_and_offset():
    origins, directions = lines(50_000)
    order = morton_order_lines(origins, directions, center=[0, 0, 0], radius=3)
    assert np.array_equal(np.sort(order), np.arange(50_000))
    along = directions[order]
    feet = (origins - np.sum(origins * directions, axis=1)[:, None] * directions)[order]
    angles = np.arccos(np.minimum(np.abs(np.sum(along[1:] * along[:-1], axis=1)), 1))
    assert np.degrees(angles).mean() < 15  # 57 in random order
    assert steps(feet).mean() < 0.5 * steps(feet[RNG(2).permutation(50_000)]).mean()


def test_the_sign_of_a_direction_and_the_place_along_it_do_not_matter():
    origins, directions = lines(2000)
    order = morton_order_lines(origins, directions, center=[0, 0, 0], radius=3)
    flipped = directions * RNG(3).choice([-1.0, 1.0], size=2000)[:, None]
    assert np.array_equal(order, morton_order_lines(origins, flipped, center=[0, 0, 0], radius=3))
    moved = morton_order_lines(origins + 2 * directions, directions, center=[0, 0, 0], radius=3)
    assert (moved == order).mean() > 0.9  # rounding moves a line to the next cell now and then


@pytest.mark.parametrize("m", [0, 1, 2, 500])
def test_any_number_of_lines(m):
    origins, directions = lines(m)
    order = morton_order_lines(origins, directions)
    assert order.dtype == np.int32
    assert np.array_equal(np.sort(order), np.arange(m))


def test_lines_of_one_point_and_along_the_axes():
    directions = np.concatenate([np.eye(3), -np.eye(3)])
    order = morton_order_lines(np.zeros((6, 3)), directions)
    assert {frozenset(pair) for pair in order.reshape(3, 2).tolist()} == {frozenset((a, a + 3)) for a in range(3)}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[0, 0, 0]], [[0, 0]]), "shape"),
        (([[0, 0, 0]], [[0, 0, np.nan]]), "finite"),
        (([[0, 0, np.inf]], [[0, 0, 1]]), "finite"),
        (([[0, 0, 0]], [[0, 0, 1]], [0, 0, 0], 0.0), "radius must be positive"),
    ],
)
def test_lines_that_cannot_be_used_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        morton_order_lines(*arguments)
