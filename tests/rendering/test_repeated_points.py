"""Points that repeat a place: one of them is drawn, as large as if it were alone."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.render import ball

import surfel
from surfel.rendering.splats import splats_of

SIZE = (64, 48)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("times", [2, 8, 20])
def test_points_that_repeat_are_drawn_as_if_alone(times, known):
    cloud = ball(1500)
    normals = cloud.normals if known else None
    once = surfel.render(surfel.Surfels(cloud.points, normals=normals), size=SIZE)
    again = None if normals is None else np.repeat(normals, times, axis=0)
    image = surfel.render(surfel.Surfels(np.repeat(cloud.points, times, axis=0), normals=again), size=SIZE)
    assert once.covered > 0.2 and np.count_nonzero(image.ids != once.ids) <= (0 if known else 6)


def test_the_first_point_of_a_place_gives_color_and_row():
    cloud = ball(1500)
    n = len(cloud)
    points, normals = np.tile(cloud.points, (9, 1)), np.tile(cloud.normals, (9, 1))
    normals[: n // 2] = 0.0  # where the first knows none, that of another is taken
    colors = np.repeat(np.array([[200, 10, 10], *[[10, 10, 200]] * 8], np.uint8), n, axis=0)
    image = surfel.render(surfel.Surfels(points, normals=normals, colors=colors), size=SIZE)
    seen = image.ids >= 0
    assert seen.mean() > 0.2 and (image.rows[seen] < n).all()
    assert (image.pixels[seen][:, 0].astype(int) > image.pixels[seen][:, 2]).all()
    splats = splats_of(surfel.Surfels(points, normals=normals))
    assert len(splats) == n
    np.testing.assert_allclose(np.abs(np.sum(splats.normals * cloud.normals[splats.rows], axis=1)), 1.0)


def test_cut_clouds_of_repeated_points():
    cloud = ball(1500)
    many = surfel.Surfels(np.repeat(cloud.points, 9, axis=0), normals=np.repeat(cloud.normals, 9, axis=0))
    other = ball(1200, 0.6, (0.8, -0.5, 0.3))
    one, two = (surfel.render(shape - other, size=SIZE) for shape in (cloud, many))
    assert one.covered > 0.2 and np.count_nonzero(one.ids != two.ids) <= 12


def test_a_point_far_from_all_others_is_drawn_no_larger_than_they_are():
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(-1, 1, 100), np.linspace(-1, 1, 100)))
    points = np.column_stack([np.concatenate([x, [0.1]]), np.concatenate([y, [0.2]]), np.append(0.05 * x, 0.6)])
    splats = splats_of(surfel.Surfels(points))
    assert splats.radii[np.argmax(splats.places()[:, 2])] <= 1.5 * np.median(splats.radii)
