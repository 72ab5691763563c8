"""What must not change the measurement: signs, order, place, turn, scale, duplicates, threads.

Permutation and rigid motion are promised for clouds in general position. On a lattice, or on points that are all
equally far from their centroid, equal distances are resolved by rounding, and the area may change within its error.
"""

from __future__ import annotations

import functools

import numba
import numpy as np
import pytest

import shapes_with_truth as truth
import surfel

RELATIVE = 1e-9


def _measured(points, normals=None, lines=2048, **options):
    return surfel.measure(surfel.Surfels(points, normals=normals), lines=lines, **options)


def _area(points, normals=None):
    return _measured(points, normals, lines=16).area.value


CLOUDS = {
    "torus": (truth.torus, 0.0, False),
    "torus with normals": (truth.torus, 0.0, True),
    "noisy torus": (truth.torus, 0.3, False),
    "even sphere": (truth.even_sphere, 0.0, False),
    "even sphere with normals": (truth.even_sphere, 0.0, True),
    "half sphere": (truth.half_sphere, 0.0, False),
    "noisy box": (truth.box, 0.1, False),
    "cylinder": (truth.cylinder, 0.0, False),
}


@functools.cache
def _cloud(name):
    shape, sigma, given = CLOUDS[name]
    cloud = shape(3000, 31)
    normals = cloud.normals if given else None
    points = cloud.noisy(sigma, 32)
    return points, normals, _area(points, normals)


@pytest.fixture(params=CLOUDS)
def cloud(request):
    return _cloud(request.param)


def test_the_order_of_the_points(cloud):
    points, normals, area = cloud
    order = np.random.default_rng(0).permutation(len(points))
    assert _area(points[order], None if normals is None else normals[order]) == pytest.approx(area, rel=RELATIVE)


@pytest.mark.parametrize("seed", [1, 2])
def test_rigid_motion(cloud, seed):
    points, normals, area = cloud
    turn = truth.rotation(seed)
    moved = points @ turn.T + [3.0, -2.0, 0.7]
    assert _area(moved, None if normals is None else normals @ turn.T) == pytest.approx(area, rel=RELATIVE)


def test_mirroring(cloud):
    points, normals, area = cloud
    mirror = np.array([-1.0, 1.0, 1.0])
    assert _area(points * mirror, None if normals is None else normals * mirror) == pytest.approx(area, rel=RELATIVE)


@pytest.mark.parametrize("factor", [2.0**-40, 0.25, 8.0])
def test_scaling_by_powers_of_two_is_exact(cloud, factor):
    points, normals, area = cloud
    assert _area(points * factor, normals) == area * factor**2


@pytest.mark.parametrize("factor", [1e-9, 0.3, 3.7])
def test_scaling_by_any_factor(cloud, factor):
    points, normals, area = cloud
    assert _area(points * factor, normals) == pytest.approx(area * factor**2, rel=RELATIVE)


def test_doubled_points_change_nothing(cloud):
    points, normals, area = cloud
    twice = np.concatenate([points, points[::2]])
    m = _measured(twice, None if normals is None else np.concatenate([normals, normals[::2]]), 16)
    assert m.area.value == pytest.approx(area, rel=RELATIVE)
    assert m.cleaning["duplicates"] == len(points[::2])
    assert any("repeat" in text for text in m.warnings)


@pytest.mark.parametrize("shape", [truth.torus, truth.box, truth.crossing_squares, truth.half_sphere])
@pytest.mark.parametrize("turned", [False, True])
def test_flipped_normals_change_no_bit(shape, turned):
    cloud = shape(2500, 8)
    turn = truth.rotation(4) if turned else np.eye(3)
    points, normals = cloud.points @ turn.T, cloud.normals @ turn.T
    ours = surfel.Surfels(points, normals=normals)
    m = surfel.measure(ours, lines=2048)
    for seed in range(3):
        signs = np.where(np.random.default_rng(seed).random(len(points)) < 0.5, -1.0, 1.0)[:, None]
        theirs = surfel.Surfels(points, normals=normals * signs)
        np.testing.assert_array_equal(theirs.patches().areas, ours.patches().areas)
        other = surfel.measure(theirs, lines=2048)
        assert other.area.value == m.area.value and other.area.standard_error == m.area.standard_error
        assert (other.volume is None) == (m.volume is None) and other.leak == m.leak
        if m.volume is not None:
            assert other.volume.value == m.volume.value


@pytest.mark.parametrize("method", ["patches", "lines"])
def test_the_same_seed_gives_the_same_bits_on_one_and_two_threads(method):
    points = truth.torus(60_000, 2).points  # enough for kernels to run on threads
    told = []
    before = numba.get_num_threads()
    try:
        for threads in (1, 2, 2):
            numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
            m = surfel.measure(surfel.Surfels(points), method=method, lines=60_000, seed=5).to_dict()
            told.append({k: v for k, v in m.items() if "seconds" not in k})
    finally:
        numba.set_num_threads(before)
    assert told[0] == told[1] == told[2]


def test_another_seed_changes_the_lines_but_not_the_patches():
    points = truth.torus(2000, 2).points
    one, two = (_measured(points, seed=seed) for seed in (1, 2))
    assert one.area.value == two.area.value
    assert one.volume.value != two.volume.value
    assert (one.seed, two.seed) == (1, 2)


def test_far_from_the_origin_only_the_rounding_of_the_coordinates_counts():
    far = np.array([512_345.0, 4_812_345.0, 287.0])
    points = truth.torus(3000, 3).points * 20.0
    rounded = (points + far) - far
    near, utm = _measured(rounded), _measured(rounded + far)
    assert utm.area.value == pytest.approx(near.area.value, rel=RELATIVE)
    assert utm.volume.value == pytest.approx(near.volume.value, rel=1e-3)
    np.testing.assert_allclose(utm.centroid.value - far, near.centroid.value, atol=0.01)


def test_line_counts_stay_within_their_interval_under_rigid_motion():
    points, turn = truth.torus(3000, 4).points, truth.rotation(3)
    ours, theirs = (_measured(p, method="lines", lines=16_384) for p in (points, points @ turn.T + 2.0))
    error = np.hypot(ours.volume.standard_error, theirs.volume.standard_error)
    assert abs(ours.volume.value - theirs.volume.value) < 4.0 * error
    assert abs(ours.area.value - theirs.area.value) < 4.0 * ours.area.standard_error


def test_two_parts_far_apart_add_up():
    ring, ball = truth.torus(2500, 1), truth.even_sphere(2500, 2)
    apart = np.concatenate([ring.points, ball.points + [40.0, 0.0, 0.0]])
    whole = _measured(apart, lines=32_768)
    parts = [_measured(part.points, lines=8192) for part in (ring, ball)]
    assert whole.area.value == pytest.approx(sum(part.area.value for part in parts), rel=0.002)
    assert whole.volume.value == pytest.approx(sum(part.volume.value for part in parts), rel=0.01)
    assert whole.closed
