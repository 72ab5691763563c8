"""The kernels of the judges against slow, obvious versions."""

from __future__ import annotations

import numpy as np
import pytest

from shapes_with_truth import box, sphere
from surfel.inside.judges import brute, imls, indicator, mls, named, nearest, two_cluster, two_nearest, winding
from surfel.inside.operand import Operand


def near_of(cloud, place, k):
    square = ((cloud.points - place) ** 2).sum(axis=1)
    rows = np.argsort(square, kind="stable")[:k]
    return rows, square[rows]


def over(cloud, rows, place):
    return ((place - cloud.points[rows]) * cloud.normals[rows]).sum(axis=1)


def by_two(cloud, place):
    rows, _ = near_of(cloud, place, 2)
    (first, second), (a, b) = over(cloud, rows, place), rows
    if (first < 0.0) == (second < 0.0):
        return first
    convex = (cloud.normals[b] - cloud.normals[a]) @ (cloud.points[b] - cloud.points[a]) > 0.0
    return max(first, second) if convex else min(first, second)


def by_mean(cloud, place, k=10):
    rows, square = near_of(cloud, place, k)
    return np.average(over(cloud, rows, place), weights=np.exp(-square / (0.35 * square[-1])))


def by_clusters(cloud, place, k=10):
    rows, square = near_of(cloud, place, k)
    normals, points = cloud.normals[rows], cloud.points[rows]
    cosine = normals @ normals[0]
    other = normals[np.argmin(cosine)]
    if cosine.min() > 0.85:
        return by_mean(cloud, place, k)
    weight = np.exp(-square / (0.5 * square[-1]))
    of_first = normals @ normals[0] >= normals @ other
    planes = []
    for group in (of_first, ~of_first):
        normal = (normals[group] * weight[group, None]).sum(axis=0)
        planes.append((normal / np.linalg.norm(normal), np.average(points[group], weights=weight[group], axis=0)))
    first, second = ((place - middle) @ normal for normal, middle in planes)
    if (first < 0.0) == (second < 0.0):
        return first
    if cosine.min() < -0.7:
        return float(over(cloud, rows[:1], place)[0])
    convex = (planes[1][0] - planes[0][0]) @ (planes[1][1] - planes[0][1]) > 0.0
    return max(first, second) if convex else min(first, second)


@pytest.fixture(scope="module")
def cube():
    return box(1500, seed=2, sides=(1.0, 0.8, 0.1))


@pytest.fixture(scope="module")
def beside(cube):
    rng = np.random.default_rng(3)
    return cube.points[rng.integers(1500, size=400)] + rng.normal(0.0, 0.05, (400, 3))


@pytest.mark.parametrize(
    ("judge", "oracle"),
    [(two_nearest.judge, by_two), (imls.judge, by_mean), (two_cluster.judge, by_clusters)],
    ids=["two-nearest", "imls", "two-cluster"],
)
def test_neighbour_judges_do_what_their_formulas_say(judge, oracle, cube, beside):
    operand = Operand.of(cube.points, cube.normals)
    found = judge(operand, beside, skip=False).value
    assert np.allclose(found, [oracle(cube, place) for place in beside], rtol=1e-9, atol=1e-12)


def test_nearest_and_brute_force_agree_with_all_distances(cube, beside):
    operand = Operand.of(cube.points, cube.normals)
    expected = [over(cube, near_of(cube, place, 1)[0], place)[0] for place in beside]
    for judge in (brute.judge, lambda o, q: nearest.judge(o, q, skip=False)):
        assert np.array_equal(judge(operand, beside).value, np.array(expected))


@pytest.mark.parametrize("n", [1, 1023, 1024, 1025, 2500])
def test_brute_force_finds_the_nearest_wherever_it_stands(n):
    rng = np.random.default_rng(n)
    points, places = rng.standard_normal((n, 3)), rng.standard_normal((70, 3))
    rows, squares = brute.nearest_of_all(points, places)
    all_squares = ((places[:, None] - points[None]) ** 2).sum(axis=2)
    assert np.array_equal(rows, all_squares.argmin(axis=1))
    assert np.allclose(squares, all_squares.min(axis=1), rtol=1e-14)


def test_mls_judge_measures_the_distance_to_the_surface():
    cloud = sphere(4000, seed=4)
    place = cloud.points[:500] * np.random.default_rng(5).uniform(0.9, 1.1, (500, 1))
    found = mls.judge(Operand.of(cloud.points, cloud.normals), place, degree=3, k=24, steps=20)
    assert np.abs(found.value - (np.linalg.norm(place, axis=1) - 1.0)).max() < 2e-4


@pytest.mark.parametrize(("beta", "error"), [(2.0, 0.05), (8.0, 2e-3), (1e6, 1e-12)])
def test_winding_number_is_the_sum_over_all_surfels(beta, error):
    cloud = box(3000, seed=6)
    areas = np.random.default_rng(7).uniform(0.5, 1.5, 3000) * 6.0 / 3000
    operand = Operand.of(cloud.points, cloud.normals, areas)
    places = np.random.default_rng(8).uniform(-1.5, 1.5, (300, 3))
    step = cloud.points[None] - places[:, None]
    square = (step**2).sum(axis=2) + winding.SOFT * areas
    expected = (areas * np.einsum("qnx,nx->qn", step, cloud.normals) / (4.0 * np.pi * square**1.5)).sum(axis=1)
    assert np.abs(winding.winding_numbers(operand, places, beta=beta) - expected).max() < error


def test_winding_number_far_away_is_zero():
    operand = Operand.of(*(sphere(500).points,) * 2)
    far = np.array([[1e6, 0.0, 0.0], [0.0, -1e100, 0.0], [3.0, 1e140, 2.0]])
    assert np.abs(winding.winding_numbers(operand, far)).max() < 1e-12


def test_indicator_jumps_by_one():
    cloud = sphere(20_000, seed=9)
    found = indicator.judge(Operand.of(cloud.points, cloud.normals), [[0.0, 0.0, 0.0], [0.0, 0.0, 1.2], [0.0, 0, 9.0]])
    assert found.value[1] - found.value[0] == pytest.approx(1.0, abs=0.06)
    assert found.value[2] == np.inf


@pytest.mark.parametrize("name", ["imls", "winding", "indicator"])
def test_scattered_flips_are_outvoted(name):
    cloud = sphere(8000, seed=10)
    rng = np.random.default_rng(11)
    flipped = cloud.normals * np.where(rng.random(8000) < 0.2, -1.0, 1.0)[:, None]
    place = rng.uniform(-1.2, 1.2, (4000, 3))
    inside = np.linalg.norm(place, axis=1) < 1.0
    operand = Operand.of(cloud.points, flipped)
    assert np.mean(named(name)(operand, place).inside != inside) < 0.03
    assert np.mean(named("nearest")(operand, place, skip=False).inside != inside) > 0.15
