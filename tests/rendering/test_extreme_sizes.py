"""Sizes and distances far beyond what float32 depths hold: an error that says so, never a crash or a blank picture."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.render import ball

import surfel
from surfel import Camera
from surfel.rendering.fragments import Fragments
from surfel.rendering.placing import view_of
from surfel.rendering.shading import developed, mean_of_places

SIZE = (64, 48)
CORNER = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
MAKERS = {
    "sphere": lambda s: surfel.Sphere(radius=s),
    "mesh": lambda s: surfel.Mesh(CORNER * s, FACES),
    "tree": lambda s: surfel.Sphere(radius=s) - surfel.Box(s),
    "union": lambda s: surfel.Sphere(radius=min(1.0, s)) | surfel.Box(s),
    "cloud": lambda s: surfel.Surfels(ball(2000).points * s, normals=ball(2000).normals),
    "cut cloud": lambda s: surfel.Surfels(ball(2000).points * s, normals=ball(2000).normals) - surfel.Box(s),
    "spline": lambda s: surfel.bound(ball(500).points * s, shape=(6, 6)),
}


@pytest.mark.parametrize("size", [1e-80, 1e-20, 1e20, 1e38, 1e45, 1e80])
@pytest.mark.parametrize("name", list(MAKERS))
def test_extreme_sizes_are_refused_in_words(name, size):
    with pytest.raises(surfel.InputError, match=r"the shapes (reach|span).*1e-15 to 1e\+15; scale them"):
        surfel.render(MAKERS[name](size), size=SIZE)


@pytest.mark.parametrize("size", [2e-15, 0.9e14])
@pytest.mark.parametrize("name", [name for name in MAKERS if name != "union"])
def test_sizes_that_are_taken_give_the_same_picture(name, size):
    usual, image = (surfel.render(MAKERS[name](s), size=SIZE) for s in (1.0, size))
    assert usual.covered > 0.05 and np.count_nonzero(image.ids != usual.ids) <= 6


@pytest.mark.parametrize("name", ["sphere", "cloud"])
@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize(
    ("eye", "target"),
    [((0, -1e40, 0), (0, 0, 0)), ((0, -1e300, 0), (0, 0, 0)), ((0, -5, 0), (0, 1e39, 0)), ((0, -1e-30, 0), (0, 0, 0))],
)
def test_cameras_at_extreme_distances_are_refused(name, orthographic, eye, target):
    with pytest.raises(surfel.InputError, match=r"camera .*1e-15 to 1e\+15"):
        surfel.render(MAKERS[name](1.0), Camera(eye, target, orthographic=orthographic), SIZE)


def test_a_camera_that_is_nowhere_is_refused():
    for eye in ((np.nan, 0, 0), (np.inf, 0, 0)):
        with pytest.raises(surfel.InputError, match="eye must be finite"):
            Camera(eye)
    with pytest.raises(surfel.InputError, match="too far apart"):
        Camera((1.7e308, 0, 0), (-1.7e308, 0, 0))
    with pytest.raises(surfel.InputError, match="scale it down"):
        Camera.fitted([[-1e200] * 3, [1e200] * 3])


@pytest.mark.parametrize("orthographic", [False, True])
def test_endless_shapes_far_away_are_not_seen(orthographic):
    camera = Camera((0, -5, 3), (0, 0, 0), orthographic=orthographic)
    for offset in (-1e45, 1e45):
        plane = surfel.HalfSpace((0.6, 0.64, 0.48), offset)
        assert surfel.render(plane, camera, SIZE).covered == 0.0
    assert surfel.render(surfel.HalfSpace((0.6, 0.64, 0.48), 0.0), camera, SIZE).covered > 0.9


def test_what_is_no_number_is_drawn_as_some_color():
    seen = Fragments.nothing(SIZE[0] * SIZE[1])
    for name in ("depth", "normal"):
        getattr(seen, name)[:] = np.nan
    seen.depth[::2], seen.color[:], seen.leaf[:] = 1.0, 200, 0
    view = view_of(Camera((0, -5, 0)), SIZE, 5.0, 1.0)
    ground = np.full(3, 255, np.uint8)
    picture = developed(seen, view, ground)
    picture.light[:] = np.nan
    pixels = np.arange(len(seen) // 4)
    mean_of_places(seen, 4, pixels, ground, picture)
    assert picture.pixels.shape == (*SIZE[::-1], 3)


def test_the_command_says_so_too(tmp_path):
    from typer.testing import CliRunner

    from surfel.cli.app import app

    surfel.write(tmp_path / "huge.obj", surfel.Mesh(CORNER * 7e38, FACES))
    result = CliRunner().invoke(app, ["render", str(tmp_path / "huge.obj"), "-o", str(tmp_path / "huge.png")])
    assert result.exit_code != 0 and not (tmp_path / "huge.png").exists()
    assert "scale them down" in result.output + str(result.exception)
