"""Cut and fill against closed forms, with and without noise; coverage of the intervals; gaps, walls, bad input."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import surfel

SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
CONE = np.pi / 24.0


def cone(x, y):
    return np.maximum(0.0, 0.5 - np.hypot(x, y))


def flat(x, y):
    return 0.0 * x


def terrain(height, n, seed=0, noise=0.0, half=1.1):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-half, half, (2, n))
    return np.column_stack([x, y, height(x, y) + noise * rng.standard_normal(n)])


def holds(estimate, truth, confidence=0.99):
    low, high = estimate.interval(confidence)
    return low - 1e-12 <= truth <= high + 1e-12


def test_a_cone_on_a_base_converges_with_density():
    errors = []
    for n in (1000, 4000, 16_000):
        volumes = [surfel.cut_and_fill(0.0, terrain(cone, n, seed), SQUARE) for seed in range(4)]
        assert all(v.cut.value < 1e-4 and holds(v.fill, CONE) for v in volumes)
        errors.append(np.sqrt(np.mean([(v.fill.value / CONE - 1.0) ** 2 for v in volumes])))
    assert errors[0] < 0.006 and errors[1] < 0.5 * errors[0] and errors[2] < 0.5 * errors[1]


def test_tilted_planes_are_exact_and_their_zero_crossing_parts_cut_from_fill():
    volumes = surfel.cut_and_fill(
        terrain(lambda x, y: 0.3 * x + 0.1 * y, 500), terrain(lambda x, y: 0.1 * y - 0.3 * x, 700, 1), SQUARE
    )
    for estimate, truth in ((volumes.cut, 0.6), (volumes.fill, 0.6), (volumes.net, 0.0)):
        assert estimate.value == pytest.approx(truth, abs=1e-4)
    assert volumes.area == pytest.approx(4.0, rel=1e-12)


def test_a_concave_region_in_either_sense_and_closed():
    region = np.array([(-0.9, -0.8), (0.7, -0.9), (0.2, 0.0), (0.9, 0.9), (-0.5, 0.6)])
    x, y = region.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    area = 0.5 * cross.sum()
    moment = float(((x + np.roll(x, -1)) * cross).sum() / 6.0)
    for corners in (region, region[::-1], np.vstack([region, region[:1]])):
        volumes = surfel.cut_and_fill(-1.0, terrain(lambda x, y: 0.5 * x, 800), corners)
        assert volumes.area == pytest.approx(area, rel=1e-12)
        assert volumes.net.value == pytest.approx(area + 0.5 * moment, rel=1e-7)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_intervals_hold_the_truth(noise):
    held = []
    for seed in range(25):
        before = terrain(flat, 2000, 2 * seed, noise)
        v = surfel.cut_and_fill(before, terrain(cone, 2000, 2 * seed + 1, noise), SQUARE)
        held.append([holds(v.cut, 0.0, 0.95), holds(v.fill, CONE, 0.95), holds(v.net, CONE, 0.95)])
    assert (np.mean(held, axis=0) >= 0.84).all()  # 21 of 25; 95 % give fewer once in a hundred times


def test_noise_is_no_cut_and_fill():
    """Taking positive parts of noisy differences would give 4 * 0.02 * sqrt(2) * 0.4 = 0.045 of either."""
    found = []
    for seed in range(6):
        v = surfel.cut_and_fill(
            terrain(flat, 8000, seed, 0.02), terrain(flat, 8000, seed + 50, 0.02), SQUARE
        )  # fmt: skip
        found.append((v.cut.value, v.fill.value))
    assert np.mean(found) < 0.003


def test_hills_by_the_error_function():
    def hills(x, y):
        return 0.3 * np.exp(-8.0 * (x**2 + y**2)) - 0.2 * np.exp(-20.0 * ((x - 0.6) ** 2 + (y + 0.5) ** 2))

    v = surfel.cut_and_fill(0.0, terrain(hills, 20_000, noise=0.005), SQUARE)
    one = 0.3 * (math.sqrt(math.pi / 8.0) * math.erf(math.sqrt(8.0))) ** 2

    def side(low, high):
        return 0.5 * math.sqrt(math.pi / 20.0) * (math.erf(high * math.sqrt(20.0)) - math.erf(low * math.sqrt(20.0)))

    two = 0.2 * side(-1.6, 0.4) * side(-0.5, 1.5)
    assert holds(v.net, one - two)
    assert v.net.standard_error < 0.01 * one
    assert v.fill.value - v.cut.value == pytest.approx(v.net.value, abs=3.0 * v.net.standard_error)


def test_a_mesh_between_two_surfaces_has_the_same_volume():
    trimesh = pytest.importorskip("trimesh")
    grid = np.linspace(-1.0, 1.0, 61)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid, indexing="ij"))
    height = 0.5 + 0.2 * np.sin(3.0 * x) * np.cos(2.0 * y)
    number = np.arange(61 * 61).reshape(61, 61)
    a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    top = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    mesh = trimesh.Trimesh(np.column_stack([x, y, height]), top, process=False)
    weight = mesh.area_faces * mesh.face_normals[:, 2]
    volume = float(np.sum(weight * mesh.triangles_center[:, 2]))
    v = surfel.cut_and_fill(0.0, np.column_stack([x, y, height]), SQUARE)
    assert v.fill.value == pytest.approx(volume, rel=2e-4)


def test_any_direction_offset_and_order_of_the_points():
    cloud = terrain(cone, 3000)
    straight = surfel.cut_and_fill(0.0, cloud, SQUARE)
    region = np.column_stack([SQUARE, np.zeros(4)])
    turned = surfel.cut_and_fill(0.0, cloud[:, [2, 0, 1]], region[:, [2, 0, 1]], direction=(2.0, 0.0, 0.0))
    far = surfel.cut_and_fill(100.0, cloud + [5e5, 5.4e6, 100.0], SQUARE + [5e5, 5.4e6])
    rng = np.random.default_rng(1)
    mixed = surfel.cut_and_fill(0.0, cloud[rng.permutation(len(cloud))], SQUARE)
    for other in (turned, far, mixed):
        assert other.fill.value == pytest.approx(straight.fill.value, rel=2e-4)
    upside_down = surfel.cut_and_fill(cloud, 0.0, SQUARE)
    assert upside_down.cut.value == pytest.approx(straight.fill.value, rel=1e-12)
    assert surfel.cut_and_fill(0.0, cloud, SQUARE).fill.value == straight.fill.value


def test_a_half_space_is_a_base_plane():
    cloud = terrain(lambda x, y: 0.2 * x + 1.0, 500)
    v = surfel.cut_and_fill(surfel.HalfSpace((-0.2, 0.0, 1.0), 0.4), cloud, SQUARE)
    assert v.net.value == pytest.approx(4.0 * 0.6, rel=1e-7) and v.cut.value == 0.0
    with pytest.raises(surfel.InputError, match="along the direction"):
        surfel.cut_and_fill(surfel.HalfSpace((1.0, 0.0, 0.0), 0.4), cloud, SQUARE)


def test_gaps_are_told_and_counted():
    cloud = terrain(cone, 8000)
    off = np.hypot(cloud[:, 0] - 0.2, cloud[:, 1])
    small = surfel.cut_and_fill(0.0, cloud[off > 0.3], SQUARE)
    assert 0.01 < small.unseen < 0.08 and any("not seen" in text for text in small.warnings)
    assert holds(small.fill, CONE, 0.999) and small.fill.standard_error > 0.005 * CONE
    large = surfel.cut_and_fill(0.0, cloud[off > 0.5], SQUARE)
    assert not large.fill.reliable and "not seen" in large.fill.reason
    with pytest.raises(surfel.InputError, match="region has no points"):
        surfel.cut_and_fill(0.0, cloud[cloud[:, 0] < 0.3], SQUARE)


def test_the_rim_of_a_survey_is_no_gap():
    v = surfel.cut_and_fill(0.0, terrain(lambda x, y: 1.0 + 0.3 * x, 2000, half=0.98), SQUARE)
    assert v.unseen == 0.0 and v.net.value == pytest.approx(4.0, rel=1e-6)


def test_without_a_region_what_both_hulls_share():
    before, after = terrain(flat, 3000), terrain(lambda x, y: 0.0 * x + 1.0, 3000, 1)
    after[:, 0] += 1.0
    v = surfel.cut_and_fill(before, after)
    assert v.area == pytest.approx(1.2 * 2.2, rel=0.02) and v.net.value == pytest.approx(v.area, rel=1e-7)
    with pytest.raises(surfel.InputError, match="no ground"):
        surfel.cut_and_fill(before, after + [9.0, 0.0, 0.0])


def test_what_is_no_terrain_is_told():
    rng = np.random.default_rng(0)
    ball = rng.standard_normal((4000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    v = surfel.cut_and_fill(0.0, ball)
    assert not v.net.reliable and any("overhangs" in text for text in v.warnings)
    trees = terrain(cone, 6000, noise=0.002)
    up = rng.random(6000) < 0.04
    trees[up, 2] += rng.uniform(0.5, 2.0, up.sum())
    assert any("trees" in text for text in surfel.cut_and_fill(0.0, trees, SQUARE).warnings)
    assert surfel.cut_and_fill(0.0, terrain(cone, 6000, noise=0.02), SQUARE).warnings == ()


def test_points_on_a_grid_at_one_place_twice_and_very_uneven():
    grid = np.linspace(-1.0, 1.0, 81)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid))
    cloud = np.column_stack([x, y, cone(x, y)])
    once = surfel.cut_and_fill(0.0, cloud)
    twice = surfel.cut_and_fill(0.0, np.vstack([cloud, cloud]))
    assert once.area == pytest.approx(4.0) and once.fill.value == pytest.approx(CONE, rel=2e-4)
    assert twice.fill.value == pytest.approx(once.fill.value, rel=1e-3)
    rng = np.random.default_rng(3)
    places = np.vstack([rng.uniform(-1.1, 1.1, (4000, 2)), 0.1 * rng.uniform(-1.0, 1.0, (30_000, 2))])
    uneven = surfel.cut_and_fill(0.0, np.column_stack([places, cone(*places.T)]), SQUARE)
    assert uneven.unseen < 1e-3 and uneven.fill.value == pytest.approx(CONE, rel=3e-3)


def test_clouds_of_classes_and_the_result_as_json():
    cloud = terrain(cone, 3000)
    wood = cloud + [0.0, 0.0, 5.0]
    both = surfel.Surfels(
        np.vstack([cloud, wood]), attributes={"classification": np.repeat(np.array([2, 5], np.uint8), 3000)}
    )
    v = surfel.cut_and_fill(0.0, both[both.attributes["classification"] == 2], SQUARE)
    assert holds(v.fill, CONE)
    told = json.loads(json.dumps(v.to_dict()))
    assert set(told) >= {"cut", "fill", "net", "area", "unseen", "warnings"} and told["spacing"][0] is None
    assert "fill" in str(v) and v.points == (0, 3000)


@pytest.mark.parametrize(
    ("arguments", "cure"),
    [
        ((0.0, 1.0, SQUARE), "both are planes"),
        ((0.0, np.zeros((2, 3)), SQUARE), "three"),
        ((0.0, np.zeros((5, 2)), SQUARE), "shape"),
        ((0.0, surfel.Sphere(1.0), SQUARE), "surfel.sample"),
        ((0.0, terrain(flat, 99), [(0, 0), (1, 1)]), "three corners"),
        ((0.0, terrain(flat, 99), [(0, 0), (1, 1), (2, 2)]), "no area"),
        ((0.0, terrain(flat, 99), [(-1, -1), (1, 1), (1, -1), (-1, 1.5)]), "cross itself"),
        ((0.0, terrain(flat, 99), [(0, 0), (1, 0), (math.nan, 1)]), "finite"),
        ((0.0, terrain(flat, 99), "abc"), "polygon"),
        ((0.0, terrain(flat, 99), SQUARE + 50.0), "needs three"),
        ((math.nan, terrain(flat, 99), SQUARE), "finite"),
        ((0.0, terrain(flat, 99), SQUARE, (0.0, 1.0, 0.0)), r"\(k, 3\)"),
        ((0.0, terrain(flat, 99), SQUARE, (0.0, 0.0, 0.0)), "zero"),
        ((0.0, np.column_stack([np.arange(9.0), np.zeros(9), np.zeros(9)])), "one line"),
    ],
)
def test_refusals(arguments, cure):
    with pytest.raises(surfel.InputError, match=cure):
        surfel.cut_and_fill(*arguments)


@pytest.mark.data
def test_lidar_ground_against_itself(data_file):
    scan = surfel.read(data_file("lidar/Topography.laz"), classes=2)
    v = surfel.cut_and_fill(scan[::2], scan[1::2])
    assert holds(v.net, 0.0) and abs(v.net.value) < 0.05 * v.area
