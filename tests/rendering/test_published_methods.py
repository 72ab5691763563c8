"""The published methods draw the same picture; at the edge of a cut each shows what it is known for."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.render import ball

import surfel
from surfel import Camera

SIZE = (160, 120)
CAMERA = Camera((2.2, -2.9, 1.7), (0, 0, 0), field=42)
BITE = (0.5, -0.7, 0.3)


def different(method: str, camera: Camera) -> float:
    tree = ball(20_000) - ball(12_000, 0.7, BITE)
    truth = surfel.render(surfel.Sphere(1) - surfel.Sphere(0.7).translated(BITE), camera, SIZE, smooth=False)
    image = surfel.render(tree, camera, SIZE, method=method, smooth=False)
    return np.count_nonzero(image.ids != truth.ids) / np.count_nonzero(truth.ids >= 0)


@pytest.mark.parametrize(("method", "most"), [("clip-buffer", 0.01), ("quads", 0.05)])
def test_published_methods_draw_the_same_tree(method, most):
    assert different(method, CAMERA) <= most


def test_one_verdict_a_pixel_is_better_than_planes_and_these_than_whole_surfels():
    place = surfel.render(surfel.Sphere(1) - surfel.Sphere(0.7).translated(BITE), CAMERA, SIZE)
    ys, xs = np.nonzero(place.ids == 1)
    camera = Camera(CAMERA.eye, place.point_at(int(xs[xs.argmax()]), int(ys[xs.argmax()])), field=42).zoomed(20)
    blend, clip, quads = (different(method, camera) for method in ("blend", "clip-buffer", "quads"))
    assert blend < clip < quads


@pytest.mark.parametrize("method", ["clip-buffer", "quads"])
def test_they_draw_exact_leaves_and_single_clouds_as_well(method):
    for shape in (ball(4000), ball(4000) - surfel.Box(1), surfel.Box(1)):
        one, other = (surfel.render(shape, CAMERA, SIZE, method=m, smooth=True) for m in (method, "blend"))
        assert np.count_nonzero(one.ids != other.ids) <= 0.03 * np.count_nonzero(other.ids >= 0)
        both = (one.ids >= 0) & (other.ids >= 0)
        assert np.abs(one.pixels[both].astype(float) - other.pixels[both]).mean() < 12
