"""Given normals that the points do not bear out: found one by one, or refused together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

import shapes_with_truth as truth
import surfel
from surfel.surface.neighbourhoods import cleaned
from surfel.surface.trusted import Trusted, trusted_normals

SHAPES = [truth.sphere, truth.torus, truth.box]


def asked(points: np.ndarray, normals: np.ndarray) -> Trusted:
    hood, _ = cleaned(points, normals)
    assert hood is not None
    return trusted_normals(hood, normals)


def random_directions(n: int, seed: int) -> np.ndarray:
    found = np.random.default_rng(seed).standard_normal((n, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def tilted(normals: np.ndarray, degrees: float, seed: int) -> np.ndarray:
    """Turn every normal by the same angle, each about an axis of its own."""
    way = np.cross(normals, random_directions(len(normals), seed))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return np.cos(np.radians(degrees)) * normals + np.sin(np.radians(degrees)) * way


def grid_of_heights(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a bent surface sampled in good order, where no two points lie close together."""
    x, y = (side.ravel() for side in np.meshgrid(*[np.linspace(-1.0, 1.0, n)] * 2))
    normals = np.column_stack([-0.6 * x, 0.4 * y, np.ones(len(x))])
    points = np.column_stack([x, y, 0.3 * x * x - 0.2 * y * y])
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("noise", [0.0, 0.007])
def test_right_normals_are_left_as_they_are(shape, noise):
    cloud = shape(8000, 1)
    step = noise * np.sqrt(cloud.area / len(cloud.points))
    points = cloud.points + step * np.random.default_rng(2).standard_normal(cloud.points.shape)
    found = asked(points, cloud.normals)
    assert found.normals is not None
    assert not found.refused
    assert found.wrong < 0.004 * len(points)
    same = (found.normals == cloud.normals).all(axis=1)
    assert same.mean() > 0.996


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("share", [0.005, 0.02])
def test_single_wrong_normals_cost_no_area(shape, share):
    """Each of them cost the area of nearly three points, in silence: 5 % of the area where one in fifty was wrong."""
    cloud = shape(20_000, 3)
    rng = np.random.default_rng(4)
    wrong = rng.random(len(cloud.points)) < share
    normals = np.where(wrong[:, None], random_directions(len(wrong), 5), cloud.normals)
    found = asked(cloud.points, normals)
    assert found.normals is not None
    clearly = wrong & (np.abs(np.einsum("ij,ij->i", normals, cloud.normals)) < 0.9)
    changed = (found.normals != normals).any(axis=1)
    assert changed[clearly].mean() > 0.8
    cosine = np.einsum("ij,ij->i", found.normals, cloud.normals)
    assert (cosine[changed & clearly] > 0.9).mean() > 0.9  # with the sign of their neighbours
    m = surfel.measure(surfel.Surfels(cloud.points, normals), lines=64)
    assert float(m.area) == pytest.approx(cloud.area, rel=0.0035)
    low, high = m.area.interval(0.95)
    assert low <= cloud.area <= high
    assert m.cleaning["wrong_normals"] == found.wrong


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("degrees", [5.0, 20.0, 30.0, 45.0])
def test_normals_that_are_all_tilted_are_refused(shape, degrees):
    cloud = shape(8000, 6)
    found = asked(cloud.points, tilted(cloud.normals, degrees, 7))
    assert found.normals is None
    assert found.refused


@pytest.mark.parametrize("kind", ["constant", "random", "tilted"])
def test_a_cloud_whose_normals_are_refused_is_measured_as_one_without(kind):
    cloud = truth.sphere(8000, 8)
    normals = {
        "constant": np.tile([0.0, 0.0, 1.0], (len(cloud.points), 1)),
        "random": random_directions(len(cloud.points), 9),
        "tilted": tilted(cloud.normals, 25.0, 10),
    }[kind]
    m = surfel.measure(surfel.Surfels(cloud.points, normals))
    bare = surfel.measure(surfel.Surfels(cloud.points))
    assert m.area.value == bare.area.value
    assert m.volume is not None
    assert m.volume.value == bare.volume.value
    assert any("the given normals do not belong to the points" in text for text in m.warnings)
    assert not any("normals" in text for text in bare.warnings)


def rounded_off(points: np.ndarray, neighbours: int) -> np.ndarray:
    """Return the normals of planes through so many neighbours, as programs for point clouds fit them."""
    near = cKDTree(points).query(points, neighbours)[1]
    offset = points[near] - points[near].mean(axis=1, keepdims=True)
    return np.linalg.eigh(np.einsum("nki,nkj->nij", offset, offset))[1][:, :, 0]


@pytest.mark.parametrize("shape", [truth.box, truth.cylinder])
def test_normals_that_round_off_edges_are_refused(shape):
    """They made the area of a box 1.8 % too large, and that of a cylinder 8 %."""
    cloud = shape(12_000, 23)
    normals = rounded_off(cloud.points, 30)
    m = surfel.measure(surfel.Surfels(cloud.points, normals), lines=64)
    assert asked(cloud.points, normals).refused
    assert float(m.area) == pytest.approx(cloud.area, rel=0.004)
    low, high = m.area.interval(0.95)
    assert low <= cloud.area <= high


@pytest.mark.parametrize("shape", [truth.sphere, truth.torus])
def test_normals_of_planes_are_good_enough_where_there_are_no_edges(shape):
    cloud = shape(12_000, 24)
    m = surfel.measure(surfel.Surfels(cloud.points, rounded_off(cloud.points, 30)), lines=64)
    assert float(m.area) == pytest.approx(cloud.area, rel=0.002)


def test_one_normal_in_five_wrong_refuses_all():
    cloud = truth.torus(8000, 11)
    wrong = np.random.default_rng(12).random(8000) < 0.2
    found = asked(cloud.points, np.where(wrong[:, None], random_directions(8000, 13), cloud.normals))
    assert found.refused


@pytest.mark.parametrize(("degrees", "refused"), [(0.0, False), (1.0, False), (15.0, True), (60.0, True)])
def test_points_in_good_order_are_judged_by_their_neighbours(degrees, refused):
    points, normals = grid_of_heights(60)
    assert asked(points, tilted(normals, degrees, 14)).refused is refused


@pytest.mark.parametrize("gap", [0.1, 0.3, 1.0])
def test_both_sides_of_a_plate_keep_their_normals(gap):
    rng = np.random.default_rng(15)
    place = rng.random((12_000, 2))
    upper = rng.random(12_000) < 0.5
    points = np.column_stack([place, np.where(upper, gap * np.sqrt(2.0 / 12_000), 0.0)])
    normals = np.where(upper[:, None], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0])
    found = asked(points, normals)
    assert found.normals is not None
    assert found.wrong == 0


def test_signs_change_nothing_and_unknown_normals_stay_unknown():
    cloud = truth.torus(8000, 16)
    rng = np.random.default_rng(17)
    wrong = rng.random(8000) < 0.01
    normals = np.where(wrong[:, None], random_directions(8000, 18), cloud.normals)
    normals[::50] = 0.0
    flipped = normals * rng.choice([-1.0, 1.0], (8000, 1))
    one, two = asked(cloud.points, normals), asked(cloud.points, flipped)
    assert one.normals is not None and two.normals is not None
    assert one.wrong == two.wrong
    assert np.array_equal(np.abs(one.normals), np.abs(two.normals))
    assert not one.normals[::50].any()


def test_few_points_are_believed():
    points = np.random.default_rng(19).random((6, 3))
    normals = random_directions(6, 20)
    assert asked(points, normals).normals is normals


def test_a_tree_of_a_cloud_with_wrong_normals_is_measured_right():
    cloud = truth.sphere(10_000, 21)
    bite = surfel.Box([0.8, 0.8, 4.0])
    true = surfel.measure(surfel.Sphere(1.0) - bite, lines=100_000)
    for normals in (np.tile([0.0, 0.0, 1.0], (10_000, 1)), tilted(cloud.normals, 30.0, 22)):
        m = surfel.measure(surfel.Surfels(cloud.points, normals) - bite)
        assert float(m.area) == pytest.approx(float(true.area), rel=0.003)
        assert m.volume is not None
        assert float(m.volume) == pytest.approx(float(true.volume), rel=0.005)


def test_normals_that_were_fitted_to_refuse_others_are_used_again():
    """A cloud whose normals are refused has the same digits as one without."""
    cloud = truth.torus(6000, 4)
    wrong = random_directions(6000, 5)
    found = asked(cloud.points, wrong)
    assert found.refused
    assert found.fitted is not None
    assert found.fitted.shape == (6000, 3)
    refused, bare = surfel.Surfels(cloud.points, wrong).surface.local, surfel.Surfels(cloud.points).surface.local
    assert refused is not None
    assert bare is not None
    np.testing.assert_array_equal(refused.areas, bare.areas)
    np.testing.assert_array_equal(refused.normals, bare.normals)
