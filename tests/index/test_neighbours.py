"""Neighbours against SciPy and against brute force, on every kind of cloud that made a prototype stumble."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial import cKDTree

from surfel import InputError
from surfel._numba import threads_for
from surfel.index.neighbours import PointIndex

RNG = np.random.default_rng


def sphere(n, seed=0):
    p = RNG(seed).normal(size=(n, 3))
    return p / np.linalg.norm(p, axis=1)[:, None]


def uneven(n):
    """A square whose density changes 30 : 1 at a line."""
    p = RNG(1).random((n, 3)) * [1, 1, 0]
    dense = RNG(2).random(n) < 30 / 31
    p[:, 0] = np.where(dense, 0.5 * p[:, 0], 0.5 + 0.5 * p[:, 0])
    return p


def grid(side):
    return np.stack(np.meshgrid(*[np.arange(float(side))] * 3), axis=-1).reshape(-1, 3)


CLOUDS = {
    "volume": RNG(0).random((3000, 3)),
    "sphere": sphere(20_000),
    "uneven": uneven(20_000),
    "plane": RNG(3).random((3000, 3)) @ np.array([[1.0, 0, 0.5], [0, 1, 0.25], [0, 0, 0]]),
    "line": RNG(4).random((3000, 1)) * [1.0, -2.0, 0.3],
    "grid": grid(14),
    "nearly a grid": grid(14)
    + 1e-10 * RNG(6).random((14**3, 3)),  # the k-th and the next differ by less than float32 can
    "knots": np.concatenate([sphere(1000), np.repeat(sphere(30, 7), 25, axis=0) + 1e-6 * sphere(750, 8)]),
    "thin plate": RNG(5).random((4000, 3)) * [1, 1, 1e-9],
    "all equal": np.full((3000, 3), 7.25),
    "each 40 times": np.repeat(sphere(200), 40, axis=0),
    "each twice": np.repeat(sphere(3000), 2, axis=0),
    "coordinates of a map": sphere(5000) * 300 + [5e5, 4e6, 120],
    "tiny": sphere(3000) * 1e-12,
    "huge": sphere(3000) * 1e12,
    "largest floats": sphere(3000) * 3e38,
    "two clusters": np.concatenate([sphere(3000), 1e-6 * sphere(3000, 1) + [50, 0, 0]]),
    "far clusters": np.concatenate([sphere(3000), sphere(3000, 1) + np.array([3e7, 1e7, 0])]),
    "clusters of every scale": np.concatenate([sphere(700, s) * 10.0**-s + s for s in range(0, 15, 2)]),
    "a cluster at zero": np.concatenate([sphere(3000), 1e-25 * sphere(500, 1)]),
    "a stray point": np.concatenate([sphere(3000), [[1e9, 0, 0]]]),
    "17 points": sphere(17),
    "18 points": sphere(18),
}


def nearest_by_scipy(points, k):
    """Distances to the k nearest others; of equal points any but the point itself may be missing from the list."""
    distances, rows = cKDTree(points).query(points, k=k + 1)
    own = rows == np.arange(len(points))[:, None]
    own[~own.any(axis=1), -1] = True
    return distances[~own].reshape(-1, k)


def squares_between(points, rows, neighbours):
    gap = points[neighbours] - points[rows][:, None]
    return (gap[..., 0] ** 2 + gap[..., 1] ** 2) + gap[..., 2] ** 2


def by_brute_force(queries, points):
    gap = queries[:, None] - points[None]
    return (gap[..., 0] ** 2 + gap[..., 1] ** 2) + gap[..., 2] ** 2


@pytest.mark.parametrize("k", [1, 16])
@pytest.mark.parametrize("name", CLOUDS)
def test_nearest_are_those_of_scipy(name, k):
    points = CLOUDS[name]
    index = PointIndex(points)
    assert np.array_equal(index.points + index.origin, points[index.order])
    squares, neighbours = index.knn(k)
    rows = np.arange(len(points))
    assert squares.shape == neighbours.shape == (len(points), k)
    assert squares.dtype == np.float64 and neighbours.dtype == np.int32
    assert (neighbours != rows[:, None]).all()
    assert (np.diff(np.sort(neighbours, axis=1), axis=1) > 0).all()
    assert np.array_equal(squares, squares_between(index.points, rows, neighbours))
    assert (np.diff(squares, axis=1) >= 0).all()
    np.testing.assert_allclose(np.sqrt(squares), nearest_by_scipy(index.points, k), rtol=1e-14)


@pytest.mark.parametrize("k", [24, 40, 64, 300])
def test_wide_neighbourhoods_are_exact(k):
    index = PointIndex(sphere(4000))
    squares, _ = index.knn(k)
    np.testing.assert_allclose(np.sqrt(squares), nearest_by_scipy(index.points, k), rtol=1e-14)


def test_all_others_can_be_asked_for():
    points = sphere(500)
    index = PointIndex(points)
    squares, _ = index.knn(499)
    expected = np.sort(by_brute_force(index.points, index.points), axis=1)[:, 1:]
    assert np.array_equal(squares, expected)


def test_neighbourhoods_too_wide_for_the_shared_search_are_exact():
    index = PointIndex(sphere(9000))
    rows = np.arange(0, 9000, 450)
    squares, _ = index.knn(8500, rows=rows)
    expected = np.sort(by_brute_force(index.points[rows], index.points), axis=1)[:, 1:8501]
    assert np.array_equal(squares, expected)


def test_equal_distances_ascend_by_row():
    index = PointIndex(grid(9))
    squares, neighbours = index.knn(26)
    tie = np.diff(squares, axis=1) == 0
    assert tie.mean() > 0.5
    assert (np.diff(neighbours, axis=1)[tie] > 0).all()


@pytest.mark.parametrize("name", ["sphere", "uneven", "coordinates of a map", "far clusters"])
def test_some_rows_get_what_they_get_among_all(name):
    index = PointIndex(CLOUDS[name])
    squares, neighbours = index.knn(24)
    n = len(index)
    for rows in (np.arange(37, 1500), RNG(0).permutation(n)[:900], np.array([n - 1, 0, 0, 5]), np.empty(0, int)):
        some_squares, some = index.knn(24, rows=rows)
        assert np.array_equal(some, neighbours[rows])
        assert np.array_equal(some_squares, squares[rows])


def test_results_can_be_written_in_place():
    index = PointIndex(sphere(1000))
    out = np.empty((1000, 5)), np.empty((1000, 5), np.int32)
    squares, neighbours = index.knn(5, out=out)
    assert squares is out[0] and neighbours is out[1]
    assert np.array_equal(neighbours, index.knn(5)[1])


@pytest.mark.parametrize("shape", [(1000, 4), (999, 5)])
def test_a_place_for_results_must_fit(shape):
    with pytest.raises(InputError, match=r"shape \(1000, 5\)"):
        PointIndex(sphere(1000)).knn(5, out=(np.empty(shape), np.empty(shape, np.int32)))
    with pytest.raises(InputError, match="int32"):
        PointIndex(sphere(1000)).knn(5, out=(np.empty((1000, 5)), np.empty((1000, 5), np.int64)))


@pytest.mark.parametrize("name", CLOUDS)
def test_the_order_of_the_input_does_not_matter(name):
    points = CLOUDS[name]
    shuffle = RNG(9).permutation(len(points))
    one, two = PointIndex(points), PointIndex(points[shuffle])
    squares, neighbours = one.knn(12)
    other_squares, others = two.knn(12)
    place, other_place = np.argsort(one.order), np.argsort(shuffle[two.order])
    assert np.array_equal(squares[place], other_squares[other_place])
    found = one.order[neighbours][place]
    other_found = shuffle[two.order[others]][other_place]
    apart = (squares[place][:, -1] > squares[place][:, -2]) & (np.diff(squares[place], axis=1) > 0).all(axis=1)
    # the k-th may tie with the one after it, which is not seen here: leave it out
    assert np.array_equal(found[apart, :-1], other_found[apart, :-1])


@pytest.mark.parametrize("name", ["sphere", "uneven", "grid", "each 40 times"])
def test_one_and_two_threads_give_the_same_bits(name):
    results = []
    for threads in (1, 2):
        with threads_for(10**6, threads):
            index = PointIndex(CLOUDS[name])
            results.append([index.order, index.points, *index.knn(20), *index.radius(0.05)])
    assert all(np.array_equal(a, b) for a, b in zip(*results, strict=True))


@pytest.mark.parametrize("k", [1, 9])
@pytest.mark.parametrize(
    "name", ["volume", "sphere", "uneven", "grid", "each 40 times", "coordinates of a map", "far clusters"]
)
def test_nearest_to_other_places_are_those_of_scipy(name, k):
    points = CLOUDS[name]
    low, high = points.min(axis=0), points.max(axis=0)
    near = points[RNG(0).integers(len(points), size=1500)]
    queries = np.concatenate([near, near * 0.999 + high * 0.001, low + (high - low) * RNG(1).normal(size=(300, 3))])
    index = PointIndex(points)
    squares, neighbours = index.knn_of(queries, k)
    there = queries - index.origin
    gap = index.points[neighbours] - there[:, None]
    assert np.array_equal(squares, (gap[..., 0] ** 2 + gap[..., 1] ** 2) + gap[..., 2] ** 2)
    expected, _ = cKDTree(index.points).query(there, k=k)
    np.testing.assert_allclose(np.sqrt(squares), expected.reshape(squares.shape), rtol=1e-13)


def test_a_place_far_away_and_in_the_middle_of_a_sphere():
    index = PointIndex(sphere(3000))
    queries = np.array([[0.0, 0, 0], [1e6, 0, 0], [1e140, 0, 0], [0, 1e-300, 0]])
    squares, _ = index.knn_of(queries, 3000)
    assert np.array_equal(squares, np.sort(by_brute_force(queries, index.points), axis=1))


@pytest.mark.parametrize("name", ["volume", "plane", "grid", "each twice", "17 points", "coordinates of a map"])
@pytest.mark.parametrize("own", [True, False])
def test_neighbours_within_a_distance_are_those_of_brute_force(name, own):
    points = CLOUDS[name]
    index = PointIndex(points)
    r = 1.0 if name == "grid" else float(np.sqrt(index.knn(10)[0][:, -1].mean()))
    rows = RNG(0).integers(len(points), size=400)
    if own:
        offsets, neighbours = index.radius(r, rows=rows)
        expected = by_brute_force(index.points[rows], index.points) <= r * r
        expected[np.arange(len(rows)), rows] = False
    else:
        queries = points[rows] + RNG(1).normal(size=(400, 3)) * r * 0.1
        offsets, neighbours = index.radius_of(queries, r)
        expected = by_brute_force(queries - index.origin, index.points) <= r * r
    assert np.array_equal(np.diff(offsets), expected.sum(axis=1))
    assert np.array_equal(neighbours, np.nonzero(expected)[1])


def test_neighbours_within_a_distance_of_all_points():
    index = PointIndex(sphere(3000))
    offsets, neighbours = index.radius(0.1)
    pairs = cKDTree(index.points).query_pairs(0.1, output_type="ndarray")
    assert offsets[-1] == len(neighbours) == 2 * len(pairs)
    assert index.radius(1e-9)[0][-1] == 0
    everything = index.radius(5.0, rows=[4])[1]
    assert np.array_equal(everything, np.delete(np.arange(3000), 4))


def test_crowds_and_clusters_do_not_take_quadratic_time():
    """A quadratic search would look at 1e10 pairs here, which takes minutes."""
    equal = PointIndex(np.zeros((100_000, 3)))
    squares, neighbours = equal.knn(16)
    assert (squares == 0).all() and (neighbours != np.arange(100_000)[:, None]).all()
    crowd = np.concatenate([np.repeat(sphere(100), 500, axis=0), sphere(50_000, 1)])
    squares, _ = PointIndex(crowd).knn(16)
    assert 50_000 <= (squares[:, -1] == 0).sum() < 50_100
    squares, _ = PointIndex(np.concatenate([sphere(50_000), 1e-7 * sphere(50_000, 1) + 1e3])).knn(16)
    assert np.isfinite(squares).all()


@pytest.mark.parametrize("n", [1, 2, 3, 15, 16, 17, 33, 128, 129, 2049])
def test_every_small_number_of_points(n):
    index = PointIndex(sphere(n))
    assert len(index) == n and index.points.shape == (n, 3)
    squares = by_brute_force(index.points, index.points)
    assert np.array_equal(index.knn_of(sphere(n)[index.order], min(n, 20))[0], np.sort(squares, axis=1)[:, :20])
    if n > 1:
        k = min(n - 1, 20)
        assert np.array_equal(index.knn(k)[0], np.sort(squares, axis=1)[:, 1 : k + 1])


def test_subtracting_the_origin_rounds_nothing():
    for low, extent in ((1e6, 1.0), (-4e6, 3.0), (0.9, 1.0), (-0.5, 1.0), (1e-20, 1.0), (0.0, 0.0)):
        points = low + extent * RNG(0).random((2000, 3))
        points[:5] = low
        index = PointIndex(points)
        assert np.array_equal(index.points + index.origin, points[index.order])
        gap = np.diff(points[index.order], axis=0)
        assert np.array_equal(np.diff(index.points, axis=0), gap)


def test_an_index_cannot_be_written_to():
    points = sphere(100)
    index = PointIndex(points)
    for array in (index.order, index.points, index.origin):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    points[:] = 0
    assert not (index.points == 0).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda i: i.knn(10), "below the number of points, 10; got 10"),
        (lambda i: i.knn(0), "at least 1; got 0"),
        (lambda i: i.knn(2.5), "whole number"),
        (lambda i: i.knn(2, rows=[10]), "between 0 and 9"),
        (lambda i: i.knn(2, rows=[-1]), "between 0 and 9"),
        (lambda i: i.knn(2, rows=[0.5]), "row numbers"),
        (lambda i: i.knn(2, rows=[[1]]), "row numbers"),
        (lambda i: i.knn_of([[0, 0, 0]], 11), "at most the number of points, 10; got 11"),
        (lambda i: i.knn_of([[0, 0, np.nan]], 1), "not finite"),
        (lambda i: i.knn_of([[0, 0, 1e200]], 1), "within 1e"),
        (lambda i: i.radius(0.0), "positive"),
        (lambda i: i.radius(np.inf), "finite"),
        (lambda i: i.radius_of([[0, 0]], 1.0), "shape"),
        (lambda i: PointIndex(np.empty((0, 3))), "got none"),
        (lambda i: PointIndex([[0, 0, 0], [np.inf, 0, 0]]), "not finite"),
        (lambda i: PointIndex([[0, 0, 0], [1e200, 0, 0]]), "1e150"),
        (lambda i: PointIndex([[0, 0, 0], [1e-200, 0, 0]]), "1e-150"),
    ],
)
def test_arguments_that_cannot_be_used_are_refused(call, message):
    with pytest.raises(InputError, match=message):
        call(PointIndex(sphere(10)))


GENERIC = """
import sys
import numpy as np
from surfel.index import simd
from surfel.index.neighbours import PointIndex
assert not simd.VECTOR
index = PointIndex(np.load(sys.argv[1]))
squares, neighbours = index.knn(20)
offsets, near = index.radius(0.03)
np.savez(sys.argv[2], order=index.order, squares=squares, neighbours=neighbours, offsets=offsets, near=near)
"""


def test_a_processor_without_wide_vectors_finds_the_same(tmp_path):
    points = np.concatenate([uneven(6000), sphere(3000), np.repeat(sphere(50, 5), 30, axis=0), grid(8)])
    np.save(tmp_path / "points.npy", points)
    arguments = [sys.executable, "-c", GENERIC, str(tmp_path / "points.npy"), str(tmp_path / "found.npz")]
    subprocess.run(arguments, check=True, env={**os.environ, "NUMBA_CPU_NAME": "generic"})
    index = PointIndex(points)
    squares, neighbours = index.knn(20)
    offsets, near = index.radius(0.03)
    with np.load(tmp_path / "found.npz") as found:
        for name, ours in (
            ("order", index.order),
            ("squares", squares),
            ("neighbours", neighbours),
            ("offsets", offsets),
            ("near", near),
        ):
            assert np.array_equal(found[name], ours), name


@pytest.mark.data
def test_the_bunny(data_file):
    trimesh = pytest.importorskip("trimesh")
    points = np.asarray(trimesh.load(data_file("meshes/bun_zipper.ply"), process=False).vertices, float)
    index = PointIndex(points)
    squares, _ = index.knn(24)
    np.testing.assert_allclose(np.sqrt(squares), nearest_by_scipy(index.points, 24), rtol=1e-14)
