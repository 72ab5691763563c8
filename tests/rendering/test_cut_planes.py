"""Planes of cuts: they settle most places without the trees being asked, and change no picture."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.render import ball, cube

import surfel
from surfel import Camera
from surfel.core.affine import rotation
from surfel.rendering import frame
from surfel.rendering.cuts import FAR, RING, cut_planes, ring
from surfel.rendering.scene import Scene
from surfel.rendering.splats import splats_of

SIZE = (320, 240)
CAMERA = Camera((2.2, -2.9, 1.7), (0, 0, 0), field=42)
BITE = (0.5, -0.7, 0.3)
RIM = (0.274, -0.384, 0.882)  # where the ball and the bite meet


def trees() -> dict[str, surfel.Difference | surfel.Union | surfel.Intersection]:
    rng = np.random.default_rng(5)
    a, b = ball(9_000), ball(6_000, 0.7, BITE)
    return {
        "less": a - b,
        "both": a & b,
        "either": a | b,
        "sharp less round": cube(24) - ball(1_500, 0.9, (1, -1, 1)),
        "round less sharp": ball(3_000) - cube(14).scaled(0.6).translated(BITE),
        "nested": (a - b) | (ball(3_000, 0.4, (0.5, -0.3, 0.6)) - b),
        "many": surfel.Difference(a, *[ball(1_500, 0.3, tuple(v)) for v in rng.uniform(-0.8, 0.8, (5, 3))]),
        "sheet": a.with_solid(False) & b,
        "nearly one surface": a | ball(8_000, 1.001, (0.02, 0, 0)),
        "moved": a - b.transformed(rotation((1, 2, 3), 10)),
    }


def drawn(tree, camera, monkeypatch, planes):
    """Return a picture, and how many places the tree was asked for; with the planes or without."""
    asked = []
    kept = frame.kept
    with monkeypatch.context() as patch:
        patch.setattr(frame, "kept", lambda *a: asked.append(len(a[2])) or kept(*a))
        if not planes:
            patch.setattr(Scene, "disks", Scene(tree).disks._replace(cuts=np.empty((0, 5), np.float32)))
        return surfel.render(tree, camera, SIZE), sum(asked)


@pytest.mark.parametrize("name", list(trees()))
@pytest.mark.parametrize("zoom", [1, 8])
def test_they_change_no_picture_and_ask_less(name, zoom, monkeypatch):
    tree = trees()[name]
    camera = CAMERA if zoom == 1 else Camera(CAMERA.eye, RIM, field=42).zoomed(zoom)
    (image, few), (truth, many) = (drawn(tree, camera, monkeypatch, planes) for planes in (True, False))
    assert np.count_nonzero(image.ids != truth.ids) <= 1e-4 * np.count_nonzero(truth.ids >= 0)
    shade = np.abs(image.pixels.astype(int) - truth.pixels).max(axis=2)  # what lies beyond a cut is not blended
    assert np.count_nonzero(shade > 1) <= 2e-4 * np.count_nonzero(truth.ids >= 0)
    assert few <= many
    if name in ("less", "both", "nested", "moved"):
        assert few < 0.6 * many


@pytest.mark.parametrize("degrees", [0, 70])
def test_they_are_where_the_other_surface_is(degrees):
    """On the disks of a ball that a cube's face passes, heights over the plane are those over the face."""
    cloud, other = (
        ball(4_000).transformed(rotation((1, 2, 3), degrees)),
        cube(50).scaled(1.5).translated((0.0, 0.0, 1.8)),
    )
    splats, there = splats_of(cloud), splats_of(other)
    rows = np.flatnonzero(np.abs(splats.places()[:, 2] - 0.3) < 0.03)
    sign = np.where(np.arange(len(rows)) % 2, 1.0, -1.0)
    planes = cut_planes(splats, rows, there, sign)
    for places in (splats.places(rows), *ring(splats, rows)):
        away = (places - splats.places(rows)) @ splats.pose[:, :3]  # as the cloud lay before it was turned
        height = np.einsum("ij,ij->i", planes[:, :3], away) + planes[:, 3]
        np.testing.assert_allclose(height, sign * (places[:, 2] - 0.3), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(ring(splats, rows)[0] - splats.places(rows), axis=1) / RING,
                               splats.radii[rows])  # fmt: skip
    assert (planes[:, 4] < 0.03 * splats.radii[rows]).all()


def test_surfaces_that_may_coincide_have_none():
    splats, there = splats_of(ball(4_000)), splats_of(ball(3_000, 1.0, (0.01, 0.0, 0.0)))
    planes = cut_planes(splats, np.arange(100), there, np.ones(100))
    assert (planes[:, 4] == FAR).all()
