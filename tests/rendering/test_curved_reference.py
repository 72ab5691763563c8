"""The reference: curved sheets against closed forms, and runs of lines near surfels against all of them."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.render import ball

import surfel
from surfel.rendering.near_lines import balls_round, next_runs

SIZE = (320, 240)
CAMERA = surfel.Camera((2.2, -2.9, 1.7), (0, 0, 0), field=42)


def test_a_ball_is_as_round_and_as_deep_as_the_sphere_though_its_points_lie_far_apart():
    truth = surfel.render(surfel.Sphere(1.0), CAMERA, SIZE, smooth=False)
    found = surfel.render(ball(500), CAMERA, SIZE, smooth=False, reference=True)
    assert np.count_nonzero((found.ids >= 0) != (truth.ids >= 0)) <= 0.0005 * np.count_nonzero(truth.ids >= 0)
    both = (found.ids >= 0) & (truth.ids >= 0)
    assert np.abs(found.depth[both] - truth.depth[both]).mean() < 5e-4  # triangles: 5e-3


def test_edges_are_sharp():
    points = surfel.sample(surfel.Cylinder(radius=0.5, height=1.8), 3000)
    cloud = surfel.Surfels(points.points, normals=points.normals)
    truth = surfel.render(surfel.Cylinder(radius=0.5, height=1.8), CAMERA, SIZE, smooth=False).ids >= 0
    found = surfel.render(cloud, CAMERA, SIZE, smooth=False, reference=True).ids >= 0
    assert np.count_nonzero(found != truth) <= 0.005 * np.count_nonzero(truth)  # triangles: 0.013


def test_a_sheet_ends_where_its_points_do():
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30)))
    sheet = surfel.Surfels(np.column_stack([x, y, 0.1 * x * x]), normals=np.column_stack([-0.2 * x, 0 * x, 1 + 0 * x]))
    camera = surfel.Camera((0, 0, 5), (0, 0, 0), up=(0, 1, 0), field=42, orthographic=True)
    seen = surfel.render(sheet, camera, SIZE, smooth=False, reference=True).ids >= 0
    rows, columns = np.nonzero(seen)
    pixel = 1.0 / camera.focal(SIZE[1]) * camera.distance
    for places in (rows, columns):
        assert (np.ptp(places) + 1) * pixel == pytest.approx(2.0, abs=2.5 * pixel)
    assert seen.sum() * pixel**2 == pytest.approx(4.0, rel=0.02)


def test_the_nearer_of_two_sheets_that_a_tree_keeps_is_seen():
    tree = ball(2000) - ball(1500, 0.7, (0.5, -0.7, 0.3))
    exact = surfel.Sphere(1) - surfel.Sphere(0.7).translated((0.5, -0.7, 0.3))
    found = surfel.render(tree, CAMERA, SIZE, smooth=False, reference=True)
    truth = surfel.render(exact, CAMERA, SIZE, smooth=False)
    assert np.count_nonzero(found.ids != truth.ids) <= 0.003 * np.count_nonzero(truth.ids >= 0)


def test_runs_are_those_of_all_balls_one_by_one():
    rng = np.random.default_rng(3)
    centres, radii = rng.uniform(-1, 1, (203, 3)), rng.uniform(0.05, 0.2, 203)
    origins, along = rng.uniform(-2, 2, (300, 3)), rng.standard_normal((300, 3))
    along[:3] = np.eye(3)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    after = rng.uniform(-2, 1, 300)
    begin, end, least = next_runs(balls_round(centres, radii), origins, along, after)
    hit = 0
    for k in range(300):
        middle = (centres - origins[k]) @ along[k]
        square = radii**2 - (((centres - origins[k]) ** 2).sum(axis=1) - middle**2)
        half = np.sqrt(np.maximum(square, 0.0))
        some = np.flatnonzero((square > 0.0) & (middle + half > after[k]))
        if not len(some):
            assert np.isinf(begin[k])
            continue
        hit += 1
        some = some[np.argsort((middle - half)[some])]
        stop, small = -np.inf, np.inf
        for i in some:
            if middle[i] - half[i] > stop and np.isfinite(stop):
                break
            stop, small = max(stop, middle[i] + half[i]), min(small, radii[i])
        np.testing.assert_allclose(
            [begin[k], end[k], least[k]], [max((middle - half)[some[0]], after[k]), stop, small], atol=1e-9
        )
    assert hit > 40


@pytest.mark.parametrize("count", [0, 1, 3, 8, 12])
def test_few_points_give_a_picture(count):
    cloud = surfel.Surfels(ball(20).points[:count], normals=ball(20).normals[:count])
    assert surfel.render(cloud, CAMERA, (40, 30), reference=True).ids.shape == (30, 40)
