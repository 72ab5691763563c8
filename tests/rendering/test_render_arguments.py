"""Strange cameras and strange input: a picture, or an error that says what to do."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.render import ball

import surfel
from surfel import Camera

SIZE = (64, 48)
SHAPES = {
    "cloud": ball(2000),
    "box": surfel.Box(2),
    "mixed": ball(2000) - surfel.Box(0.9),
    "clouds": ball(2000) - ball(1500, 0.5, (0.9, 0, 0)),
}


@pytest.mark.parametrize("name", list(SHAPES))
def test_a_camera_inside_sees_walls_all_round(name):
    assert surfel.render(SHAPES[name], Camera((0.1, 0.05, 0.62), (0.2, 0.1, 0.9)), SIZE).covered == 1.0


@pytest.mark.parametrize("name", list(SHAPES))
def test_a_camera_that_looks_away_sees_nothing(name):
    assert surfel.render(SHAPES[name], Camera((0, -5, 0), (0, -10, 0)), SIZE).covered == 0.0


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("name", list(SHAPES))
def test_a_camera_at_a_million_lengths_sees_as_a_near_one(name, orthographic):
    near = Camera((0, -2e3, 0), (0, 0, 0), field=0.1, orthographic=True)
    far = Camera((0, -2e6, 0), (0, 0, 0), field=0.0001, orthographic=orthographic)
    one, other = surfel.render(SHAPES[name], near, SIZE), surfel.render(SHAPES[name], far, SIZE)
    assert one.covered > 0.15 and np.count_nonzero(one.ids != other.ids) <= 12
    both = (one.ids >= 0) & (one.ids == other.ids)
    assert np.median(np.abs((one.depth[both] - 2e3) - (other.depth[both] - 2e6))) < 1e-3


def test_so_far_that_all_is_one_pixel():
    assert surfel.render(SHAPES["cloud"], Camera((0, -1e6, 0), (0, 0, 0)), SIZE).covered < 0.01


@pytest.mark.parametrize("size", [(0, 10), (10, 0), (-3, 4), (5,), 7, (3.5, 2), (1, 1 << 20)])
def test_impossible_sizes_are_refused(size):
    with pytest.raises(surfel.InputError, match=r"size|width|height"):
        surfel.render(SHAPES["box"], size=size)


def test_the_smallest_picture():
    assert np.asarray(surfel.render(SHAPES["clouds"], size=(1, 1))).shape == (1, 1, 3)


def test_points_that_are_not_finite_are_left_out():
    cloud = ball(1000)
    points, normals = cloud.points.copy(), cloud.normals.copy()
    points[3], normals[5] = np.nan, np.nan
    image = surfel.render(surfel.Surfels(points, normals=normals), size=SIZE)
    assert image.covered > 0.2 and np.isfinite(image.normals).all()


@pytest.mark.parametrize("points", [np.empty((0, 3)), [[1, 2, 3]], [[1, 2, 3]] * 5, [[0, 0, 0], [0, 0, 1]]])
def test_clouds_of_few_points(points):
    image = surfel.render(surfel.Surfels(points), size=SIZE)
    assert (image.covered > 0.0) == (len(points) > 0)


def test_far_from_the_origin_and_tiny():
    at_home = surfel.render(ball(2000), size=SIZE)
    for moved in (ball(2000).translated((4e5, -3e5, 1e5)), ball(2000).scaled(1e-9)):
        assert np.count_nonzero(surfel.render(moved, size=SIZE).ids != at_home.ids) <= 6


def test_what_has_no_end_needs_a_camera():
    plane = surfel.HalfSpace((0, 0, 1), 0)
    with pytest.raises(surfel.InputError, match="no end"):
        surfel.render(plane, size=SIZE)
    assert surfel.render(plane, Camera((0, -5, 3), (0, 0, 0)), SIZE).covered == 1.0


def test_empty_trees_are_empty_pictures():
    assert surfel.render(surfel.Box(1) - surfel.Box(2), size=SIZE).covered == 0.0
    assert surfel.render([], size=SIZE).covered == 0.0


def test_a_tree_that_subtracts_a_sheet_is_refused():
    with pytest.raises(surfel.InputError, match="sheet"):
        surfel.render(surfel.Box(1) - ball(500).with_solid(False), size=SIZE)


@pytest.mark.parametrize(
    ("named", "said"),
    [
        ({"camera": (1, 2, 3)}, "camera"),
        ({"background": (1, 2)}, "background"),
        ({"background": (1, 2, 300)}, "background"),
        ({"method": "magic"}, "method"),
    ],
)
def test_bad_arguments_are_named(named, said):
    with pytest.raises(surfel.InputError, match=said):
        surfel.render(SHAPES["box"], size=SIZE, **named)


def test_points_without_a_cloud_are_told_what_to_do():
    with pytest.raises(surfel.InputError, match="Surfels"):
        surfel.render(np.zeros((5, 3)), size=SIZE)


def test_pictures_are_arrays_files_and_pngs(tmp_path):
    from PIL import Image

    image = surfel.render(surfel.Torus(1, 0.4), size=SIZE, background=(10, 20, 30))
    assert np.asarray(image).shape == (48, 64, 3) and np.asarray(image).dtype == np.uint8
    assert np.asarray(image, dtype=float).max() <= 255.0
    assert image.pixels[0, 0].tolist() == [10, 20, 30]
    image.save(tmp_path / "torus.png")
    assert np.array_equal(np.asarray(Image.open(tmp_path / "torus.png")), image.pixels)
    assert image._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(surfel.InputError, match="format"):
        image.save(tmp_path / "torus.nonsense")
    assert list(tmp_path.iterdir()) == [tmp_path / "torus.png"]
    with pytest.raises(ValueError, match="read-only"):
        image.pixels[0, 0] = 0
    with pytest.raises(surfel.InputError, match="no pixel"):
        image.point_at(64, 0)


def test_a_safe_spline_is_shown_as_its_sheet_over_the_points():
    cloud = ball(8000)
    top = cloud[cloud.points[:, 2] > 0.5]
    lid = surfel.bound(top.points, shape=(4, 4))
    image = surfel.render([lid, top], Camera((0.5, -1, 6), (0, 0, 0.7), field=30), SIZE)
    assert np.count_nonzero(image.ids == 0) > 5 * np.count_nonzero(image.ids == 1)
