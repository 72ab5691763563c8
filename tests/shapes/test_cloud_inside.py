"""What lies inside a cloud: strays, signs of normals, hollows, leaks, open and thin clouds, and surfaces that meet."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
from surfel import Surfels
from surfel.shapes.cloud_inside import events_at, is_open, lies_on


def places_about(points, seed=9, count=4000):
    rng = np.random.default_rng(seed)
    low, high = points.min(axis=0) - 0.2, points.max(axis=0) + 0.2
    return rng.uniform(low, high, (count, 3))


def in_torus(places):
    return np.hypot(np.hypot(places[:, 0], places[:, 1]) - 1.0, places[:, 2]) < 0.35


def signs(n, share, seed=2):
    return np.where(np.random.default_rng(seed).random(n) < share, -1.0, 1.0)[:, None]


RING = truth.torus(8000, 3)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 1.0])
def test_the_signs_of_normals_do_not_matter(share):
    cloud = Surfels(RING.points, RING.normals * signs(8000, share))
    places = places_about(RING.points)
    assert np.mean(cloud.contains(places) != in_torus(places)) < 0.004
    assert not cloud._inside.leaky


@pytest.mark.parametrize("given", [True, False])
def test_strays_do_not_matter(given):
    rng = np.random.default_rng(4)
    lost = rng.uniform([-2.0, -2.0, -1.0], [2.0, 2.0, 1.0], (80, 3))
    points, normals = np.concatenate([RING.points, lost]), np.concatenate([RING.normals, rng.standard_normal((80, 3))])
    cloud = Surfels(points, normals if given else None)
    places = places_about(RING.points)
    assert cloud.surface.cleaning["strays"] > 60
    assert np.mean(cloud.contains(places) != in_torus(places)) < 0.006


@pytest.mark.parametrize("normals", ["right", "away from the middle", "none"])
@pytest.mark.parametrize("radii", [(1.0, 0.5), (1.0, 0.75, 0.45)])
def test_hollows_are_outside_whatever_is_known_of_normals(radii, normals):
    spheres = [truth.sphere(int(8000 * r * r), k).points for k, r in enumerate(radii)]
    points = np.concatenate([p * r for p, r in zip(spheres, radii, strict=True)])
    away = np.concatenate(spheres)
    right = np.concatenate([p * (-1.0) ** k for k, p in enumerate(spheres)])
    cloud = Surfels(points, {"right": right, "away from the middle": away, "none": None}[normals])
    places = places_about(points)
    inside = sum(np.linalg.norm(places, axis=1) < r for r in radii) % 2 == 1
    assert np.mean(cloud.contains(places) != inside) < 0.004


def test_parity_agrees_away_from_the_surface():
    cloud = Surfels(RING.points, RING.normals)
    places = places_about(RING.points, seed=5)
    off = np.abs(np.hypot(np.hypot(places[:, 0], places[:, 1]) - 1.0, places[:, 2]) - 0.35)
    clear = off > 1.5 * cloud.surface.spacing
    assert (cloud.contains(places) == cloud.surface.contains(places))[clear].mean() > 0.999


def test_sharp_edges_are_judged_as_edges():
    """By the parity of triangles that cut the edges off, 4 % are wrong here."""
    box = truth.box(20_000, 1)
    cloud = Surfels(box.points, box.normals)
    rng = np.random.default_rng(2)
    places = rng.uniform(-0.5, 0.5, (4000, 3))
    kept = rng.integers(3, size=4000)
    for step in (1, 2):
        places[np.arange(4000), (kept + step) % 3] = rng.choice([-0.5, 0.5], 4000)
    places += rng.normal(0.0, 0.7 * box.spacing, places.shape)
    inside = (np.abs(places) < 0.5).all(axis=1)
    assert np.mean(cloud.contains(places) != inside) < 0.005 < np.mean(cloud.surface.contains(places) != inside)


def test_thin_parts_are_no_holes_but_holes_are():
    thin = truth.torus(1000, 2, 1.0, 0.06)
    cloud = Surfels(thin.points, thin.normals)
    assert cloud.surface.leak > 0.03 and not is_open(cloud) and not cloud._is_sheet()
    for cap in (truth.half_sphere(3000), truth.capless_sphere(6000, 0.03), truth.capless_sphere(3000, 0.1)):
        cloud = Surfels(cap.points, cap.normals)
        assert is_open(cloud) and cloud._is_sheet() and not cloud.with_solid(True)._is_sheet()
    assert Surfels(thin.points, solid=False)._is_sheet()


def test_events_say_what_lies_behind_and_at_a_place():
    box = truth.box(6000, 3, (1.0, 0.8, 0.6))
    cloud = Surfels(box.points, box.normals)
    places = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.9], [0.1, 0.1, 0.3], [0.1, 0.1, 0.3], [0.1, 0.1, 0.3]])
    normals = np.array([[0.0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 0, -1], [1, 0, 0]])
    found = events_at(cloud, places, normals)
    assert found.counts[:4].tolist() == [1, 0, 2, 1]  # inside, outside, on it, on it from the other side
    assert found.t[: found.offsets[4]].tolist() == [-1.0, -1.0, 0.0, 0.0]
    assert lies_on(cloud, places, normals).tolist() == [False, False, True, True, False]
    assert (events_at(cloud, places, None).counts <= 1).all()  # without normals nothing lies on it


def test_clouds_that_show_no_surface_have_no_inside():
    for points in (np.empty((0, 3)), [[0.0, 0, 0]], [[0.0, 0, 0]] * 9, [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]):
        cloud = Surfels(points, solid=True)
        assert cloud.contains([[0.0, 0.0, 0.0], [0.3, 0.3, 0.0]]).tolist() == [False, False]


def test_the_same_bits_on_one_and_two_threads():
    from surfel._numba import threads_for

    found = []
    for threads in (1, 2):
        with threads_for(10**9, threads):
            cloud = Surfels(RING.points, RING.normals * signs(8000, 0.3))
            found.append(cloud.contains(places_about(RING.points)))
    assert np.array_equal(*found)
