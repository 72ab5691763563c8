"""Cameras: what they see, and that their lines and their projection agree."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from surfel.rendering.camera import Camera
from surfel.shapes.base import CORNERS

SIZE = (160, 120)
BOX = np.array([[-1.0, 2.0, 0.0], [3.0, 4.0, 1.0]])


@pytest.mark.parametrize("orthographic", [False, True])
def test_lines_of_sight_and_projection_agree(orthographic):
    camera = Camera((3, -4, 2), (0.5, 0, 0), field=40, orthographic=orthographic)
    x, y = np.array([0.0, 17.25, 159.0]), np.array([119.0, 60.5, 3.0])
    lines = camera.rays(x, y, SIZE)
    t = np.array([1.5, 4.0, 9.0])
    seen = camera.project(lines.origins + t[:, None] * lines.directions, SIZE)
    np.testing.assert_allclose(seen.x, x, atol=1e-9)
    np.testing.assert_allclose(seen.y, y, atol=1e-9)
    np.testing.assert_allclose(seen.depth, t * (lines.directions @ camera.frame[2]), rtol=1e-12)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("direction", [(0.5, -0.7, 0.4), (0, 0, 1), (-1, 0, 0), (1, 1, -3)])
def test_a_fitted_camera_sees_the_whole_box_and_little_more(orthographic, direction):
    camera = Camera.fitted(BOX, SIZE, direction, orthographic=orthographic)
    x, y, depth = camera.project(BOX[CORNERS, range(3)], SIZE)
    assert (
        (orthographic or (depth > 0).all()) and (x > 0).all() and (y > 0).all() and (x < 159).all() and (y < 119).all()
    )
    assert max(np.ptp(x) / 160, np.ptp(y) / 120) > 0.85
    assert abs(x.min() + x.max() - 159) < 3 and abs(y.min() + y.max() - 119) < 3


def test_parallel_and_perspective_pictures_agree_at_the_target():
    one = Camera((0, -6, 0), (0, 0, 0), field=25)
    other = Camera((0, -6, 0), (0, 0, 0), field=25, orthographic=True)
    places = np.array([[0.7, 0.0, -0.4], [-0.2, 0.0, 0.9]])
    np.testing.assert_allclose(one.project(places, SIZE)[:2], other.project(places, SIZE)[:2], atol=1e-9)


def test_up_is_up_and_right_is_right():
    camera = Camera((0, -5, 0), (0, 0, 0))
    x, y, _ = camera.project([[1, 0, 0], [0, 0, 1]], SIZE)
    assert x[0] > 80 and y[1] < 59


def test_a_turntable_comes_round():
    cameras = list(Camera((3, 0, 1), (1, 0, 0)).turntable(4))
    assert cameras[0].eye == pytest.approx((3, 0, 1))
    assert cameras[1].eye == pytest.approx((1, 2, 1))
    assert cameras[2].eye == pytest.approx((-1, 0, 1))


def test_rising_goes_up():
    assert Camera((5, 0, 0), (0, 0, 0)).orbited(0, 30).eye == pytest.approx((5 * np.cos(np.pi / 6), 0, 2.5))


def test_zooming_makes_things_larger():
    camera = Camera((0, -5, 0), (0, 0, 0))
    near, far = (c.project([[0.1, 0, 0]], SIZE).x[0] - 79.5 for c in (camera.zoomed(7), camera))
    assert near == pytest.approx(7 * far)


def test_looking_straight_down_works():
    x, y, depth = Camera((0, 0, 5), (0, 0, 0)).project([[0, 0, 0]], SIZE)
    assert (x[0], y[0], depth[0]) == (79.5, 59.5, 5)


@pytest.mark.parametrize(
    "arguments",
    [
        ((0, 0, 0), (0, 0, 0)),
        ((0, np.nan, 0), (0, 0, 1)),
        ((0, 0), (0, 0, 1)),
        ((0, 0, 0), (0, 0, 1), (0, 0, 0)),
        ((0, 0, 0), (0, 0, 1), (0, 1, 0), 0.0),
        ((0, 0, 0), (0, 0, 1), (0, 1, 0), 170.0),
    ],
)
def test_bad_cameras_are_refused(arguments):
    with pytest.raises(surfel.InputError):
        Camera(*arguments)
