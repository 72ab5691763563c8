"""Clouds that were turned and shifted share their disks, and what tells their inside, with the cloud that they were."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from benchmarks.render import ball

import surfel
from surfel import Camera
from surfel.core.affine import rotation, scaling, translation
from surfel.rendering.splats import splats_of

SIZE = (160, 120)
CAMERA = Camera((2.2, -2.9, 1.7), (0, 0, 0), field=42)
POSE = translation((0.5, -0.7, 0.3)) @ rotation((1, 2, 3), 70)


def anew(cloud: surfel.Surfels) -> surfel.Surfels:
    """Return the same cloud, with nothing known of where it came from."""
    return surfel.Surfels(cloud.points, normals=cloud.normals, clips=cloud.clips)


def egg(n: int = 6_000) -> surfel.Surfels:
    return ball(n, 0.7).scaled((1.0, 0.7, 0.8))


@pytest.mark.parametrize("tree", ["alone", "less it", "it less", "twice moved", "an exact one less it"])
@pytest.mark.parametrize("method", ["blend", "clip-buffer", "quads"])
def test_a_moved_cloud_looks_as_one_that_is_made_there(tree, method):
    rest, whole = egg(), ball(8_000)
    moved = rest.transformed(POSE)
    made = {
        "alone": lambda cloud: cloud,
        "less it": lambda cloud: whole - cloud,
        "it less": lambda cloud: cloud - whole,
        "twice moved": lambda cloud: cloud - cloud.translated((0.2, -0.3, 0.1)),
        "an exact one less it": lambda cloud: surfel.Box(1.6) - cloud,
    }[tree]
    image, truth = (surfel.render(made(cloud), CAMERA, SIZE, method=method) for cloud in (moved, anew(moved)))
    covered = np.count_nonzero(truth.ids >= 0)
    assert covered > 500
    assert np.count_nonzero(image.ids != truth.ids) <= 0.004 * covered
    both = (image.ids >= 0) & (image.ids == truth.ids)
    assert np.quantile(np.abs(image.depth[both] - truth.depth[both]), 0.99) < 1e-4
    if method != "quads":  # these blend one over the other in the order of the surfels, which is not that of the twin
        assert np.quantile(np.abs(image.normals[both] - truth.normals[both]), 0.99) < 1e-3


def test_the_reference_shows_a_moved_cloud_where_it_is():
    rest = egg()
    moved = ball(4_000) - rest.transformed(POSE)
    image = surfel.render(moved, CAMERA, SIZE)
    truth = surfel.render(moved, CAMERA, SIZE, reference=True)
    assert np.count_nonzero(image.ids != truth.ids) <= 0.01 * np.count_nonzero(truth.ids >= 0)
    agree = np.einsum("ijk,ijk->ij", image.normals, truth.normals)[(image.ids >= 0) & (image.ids == truth.ids)]
    assert np.quantile(agree, 0.02) > 0.99


def test_results_of_a_cut_keep_their_clips_when_they_move():
    rest = surfel.combine(ball(6_000) - ball(4_000, 0.7, (0.5, -0.7, 0.3))).surfels
    moved = rest.transformed(POSE)
    image, truth = (surfel.render(cloud, CAMERA, SIZE) for cloud in (moved, anew(moved)))
    assert np.count_nonzero((image.ids >= 0) != (truth.ids >= 0)) <= 0.004 * np.count_nonzero(truth.ids >= 0)


def test_a_moved_cloud_learns_nothing_anew_and_a_scaled_one_does(monkeypatch):
    import surfel.rendering.splats as splats

    rest = egg()
    surfel.render(rest, CAMERA, SIZE)
    made = []
    before = splats._splats_of
    monkeypatch.setattr(splats, "_splats_of", lambda cloud: made.append(cloud) or before(cloud))
    moved = rest.transformed(POSE).translated((0.1, 0.0, 0.0))
    surfel.render(moved, CAMERA, SIZE)
    assert not made and splats_of(moved).radii is splats_of(rest).radii
    for change in (scaling(1.5), np.diag([-1.0, 1.0, 1.0, 1.0])):
        other = rest.transformed(change)
        surfel.render(other, CAMERA, SIZE)
        assert made.pop() is other


def test_a_moved_cloud_outlives_the_one_that_it_was():
    rest = egg()
    moved = rest.transformed(POSE)
    first = surfel.render(ball(4_000) - moved, CAMERA, SIZE)
    expected = anew(moved)
    del rest
    copy = pickle.loads(pickle.dumps(moved))
    for cloud in (moved, moved.translated((0, 0, 0)), copy):
        again = surfel.render(ball(4_000) - cloud, CAMERA, SIZE)
        assert np.count_nonzero(again.ids != first.ids) <= 0.004 * np.count_nonzero(first.ids >= 0)
    assert np.array_equal(expected.points, moved.points)
