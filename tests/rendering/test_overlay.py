"""Curves over pictures: where the true one is, no wider than two pixels, and not where something hides it."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.render import ball

import surfel
from surfel import Camera

SIZE = (320, 240)
CAMERA = Camera((0.0, -6.0, 1.0), (0, 0, 0), field=26)


@pytest.fixture(scope="module")
def cut():
    """A ball less one whose surface meets it in the circle of radius 0.6 at y = -0.8."""
    return ball(20_000) - ball(12_000, 0.6, (0.0, -0.8, 0.0))


def inked(shape, camera, size=SIZE, **options):
    plain, drawn = (surfel.render(shape, camera, size, curve=curve, **options) for curve in (False, True))
    changed = np.abs(plain.pixels.astype(int) - drawn.pixels).max(axis=2) > 8
    assert np.array_equal(plain.depth, drawn.depth)
    return changed, drawn


def circle(camera, size=SIZE, radius=0.6, y=-0.8):
    angle = np.linspace(0, 2 * np.pi, 5000)
    places = np.column_stack([radius * np.cos(angle), np.full(5000, y), radius * np.sin(angle)])
    return camera.project(places, size)


def away(changed, seen):
    """Return how far each changed pixel is from the projected circle, and each of its places from a changed pixel."""
    rows, columns = np.nonzero(changed)
    far = np.hypot(columns[:, None] - seen.x, rows[:, None] - seen.y)
    return far.min(axis=1), far.min(axis=0)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("zoom", [1, 5])
def test_the_curve_lies_on_the_true_one_and_is_two_pixels_wide(cut, orthographic, zoom):
    target = (0.0, 0.0, 0.0) if zoom == 1 else (0.6, -0.8, 0.0)
    camera = Camera(CAMERA.eye, target, field=26, orthographic=orthographic).zoomed(zoom)
    changed, image = inked(cut, camera)
    seen = circle(camera)
    off, missed = away(changed, seen)
    inside = (seen.x > 1) & (seen.x < SIZE[0] - 2) & (seen.y > 1) & (seen.y < SIZE[1] - 2)
    assert inside.sum() > 500
    assert off.max() < 2.0 + 0.3 * zoom and np.median(off) < 1.0
    assert missed[inside].max() < 1.5
    dark = np.abs(image.pixels.astype(int) - np.array([166, 30, 38])).max(axis=2)
    assert dark.min() < 30


def test_what_is_hidden_is_left_out(cut):
    changed, _ = inked(cut, Camera((0.0, 6.0, 0.5), (0, 0, 0), field=26))
    assert not changed.any()
    side = Camera((6.0, 1.5, 0.0), (0, 0, 0), field=26)
    changed, _ = inked(cut, side)
    seen = circle(side)
    off, missed = away(changed, seen)
    assert off.max() < 2.3
    there = np.linspace(0, 2 * np.pi, 5000)
    assert missed[(there > 3.0) & (there < 3.3)].min() > 5.0  # the far side of the bite


def test_results_and_trees_show_the_same_curve(cut):
    one, _ = inked(cut, CAMERA)
    two, _ = inked(surfel.combine(cut), CAMERA)
    assert np.count_nonzero(one != two) < 0.2 * np.count_nonzero(one)


def test_a_curve_behind_and_beside_the_camera_does_no_harm(cut):
    for camera in (
        Camera((0.0, -0.82, 0.0), (0.0, -0.82, 1.0), field=90),
        Camera((0.0, -0.8, 0.0), (1.0, -0.8, 0.0), field=60),
        Camera((0.0, -0.5, 0.0), (0.0, 0.0, 0.0), orthographic=True),
    ):
        assert surfel.render(cut, camera, (64, 48), curve=True).pixels.shape == (48, 64, 3)


def test_a_shape_without_a_cut_is_refused():
    with pytest.raises(surfel.InputError, match="give a tree"):
        surfel.render(ball(500), CAMERA, SIZE, curve=True)


def test_the_command_line_draws_it(tmp_path):
    from typer.testing import CliRunner

    from surfel.cli.app import app

    paths = [str(tmp_path / name) for name in ("a.ply", "b.ply")]
    surfel.write(paths[0], ball(4_000))
    surfel.write(paths[1], ball(3_000, 0.6, (0.0, -0.8, 0.0)))
    pictures = []
    for extra in ([], ["--curve"]):
        out = str(tmp_path / f"{len(extra)}.png")
        options = ["--op", "difference", "-o", out, "--size", "160x120", "--eye", "0", "-6", "1", *extra]
        assert CliRunner().invoke(app, ["render", *paths, *options]).exit_code == 0
        from PIL import Image

        pictures.append(np.asarray(Image.open(out)).astype(int))
    assert 50 < (np.abs(pictures[0] - pictures[1]).max(axis=2) > 8).sum() < 2_000
