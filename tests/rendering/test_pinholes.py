"""Pinholes between the disks of a cloud are closed; what is larger, or no hole in a cloud, stays."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from surfel.rendering.camera import Camera
from surfel.rendering.fragments import Fragments
from surfel.rendering.pinholes import close_pinholes
from surfel.rendering.placing import view_of

SIDE = 20


def picture(deep, leaf=0, row=7, behind=np.inf):
    """Return a wall one away from the eye, with some pixels at which it is not seen, and the view."""
    camera = Camera((0.0, 0.0, -1.0), (0.0, 0.0, 0.0))
    seen = Fragments.room(SIDE * SIDE)
    seen.depth[:], seen.leaf[:], seen.row[:] = 0.0, leaf, row
    seen.normal[:], seen.color[:] = (0.0, 0.0, -1.0), (10, 20, 30)
    rows = [y * SIDE + x for y, x in deep]
    seen.depth[rows], seen.leaf[rows], seen.row[rows] = behind, -1 if np.isinf(behind) else leaf, -1
    return seen, view_of(camera, (SIDE, SIDE), 1.0, 1.0), rows


@pytest.mark.parametrize("behind", [np.inf, 0.5])
@pytest.mark.parametrize(
    "deep",
    [
        [(5, 5)],
        [(5, 5), (6, 6)],
        [(8, 3), (9, 3), (10, 3)],
        [(1, 1), (18, 18)],
        [(y, x) for y in (5, 6) for x in (5, 6, 7)],
        [(5, 6), (6, 5), (6, 6), (6, 7), (7, 6)],
    ],
)
def test_small_gaps_show_the_wall(deep, behind):
    seen, view, rows = picture(deep, behind=behind)
    close_pinholes(seen, view)
    assert (seen.depth[rows] == 0.0).all() and (seen.leaf[rows] == 0).all() and (seen.row[rows] == 7).all()
    assert (seen.color[rows] == (10, 20, 30)).all()
    np.testing.assert_array_equal(seen.normal[rows], np.tile(np.float32([0.0, 0.0, -1.0]), (len(rows), 1)))


@pytest.mark.parametrize(
    "deep",
    [
        [(5, x) for x in range(5, 12)],
        [(y, x) for y in range(4, 9) for x in range(4, 9)],
        [(y, 9) for y in range(2, 17)],
        [(0, 5)],
        [(5, 0), (5, 1)],
    ],
    ids=["seven", "a hole", "a slit", "above", "left"],
)
def test_holes_and_borders_stay(deep):
    seen, view, rows = picture(deep)
    close_pinholes(seen, view)
    assert np.isinf(seen.depth[rows]).all() and (seen.leaf[rows] == -1).all()


def test_exact_solids_have_no_pinholes():
    seen, view, rows = picture([(5, 5)], row=-1)
    close_pinholes(seen, view)
    assert np.isinf(seen.depth[rows]).all()


def test_what_lies_on_a_steep_wall_is_no_hole():
    seen, view, _ = picture([])
    slope = np.float32(view.slope)
    seen.depth[:] = np.tile(np.arange(SIDE, dtype=np.float32) * 30.0 * slope, SIDE)
    before = seen.depth.copy()
    close_pinholes(seen, view)
    np.testing.assert_array_equal(seen.depth, before)


def test_a_ball_of_random_points_has_none():
    """Where the camera sees it at less than 75 degrees; three pixels side by side showed the far side."""
    camera, size = surfel.Camera((2.2, -2.9, 1.7), (0, 0, 0), field=42), (1024, 768)
    points = np.random.default_rng(0).standard_normal((100_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    image = surfel.render(surfel.Surfels(points, normals=points), camera, size)
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    lines = camera.rays(x.ravel(), y.ravel(), size)
    b = np.einsum("ij,ij->i", lines.origins, lines.directions)
    rest = b * b - np.einsum("ij,ij->i", lines.origins, lines.origins) + 1.0
    facing = np.sqrt(np.maximum(rest, 0.0)) > np.cos(np.radians(75.0))
    exact = ((-b - np.sqrt(np.maximum(rest, 0.0))) * (lines.directions @ camera.frame[2]))[facing]
    assert (np.abs(image.depth.ravel()[facing] - exact) < 0.05).all()
