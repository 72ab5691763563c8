"""Clouds that would make a grid explode, leak or lie: strays, duplicates, lines, a few points, parts far apart."""

from __future__ import annotations

import numpy as np
import pytest

from surfel.core.affine import translation
from surfel.inside.classify import Classifier
from surfel.inside.films import FREE
from surfel.inside.grid import MOST_BRICKS
from surfel.inside.operand import Operand

Floats = np.ndarray
N = 12_000


def sphere(n: int = N, seed: int = 0) -> Floats:
    p = np.random.default_rng(seed).standard_normal((n, 3))
    return p / np.linalg.norm(p, axis=1, keepdims=True)


def places(n: int = 20_000) -> Floats:
    return np.random.default_rng(9).uniform(-1.4, 1.4, (n, 3))


def wrong(classifier: Classifier, q: Floats, middle: Floats | float = 0.0) -> float:
    return float((classifier.classify(q + middle).inside != (np.linalg.norm(q, axis=1) < 1.0)).mean())


@pytest.mark.parametrize("away", [1e2, 1e4, 1e9, 1e15])
def test_one_stray_spoils_nothing(away: float) -> None:
    points = np.concatenate([sphere(), [[away, 0.2 * away, 0.3 * away]]])
    classifier = Classifier(Operand.of(points, np.concatenate([sphere(), [[0.0, 0.0, 1.0]]])))
    assert classifier._coloured is not None
    assert classifier._coloured.grid.table.size <= MOST_BRICKS
    assert not classifier.leaky
    assert wrong(classifier, places()) <= 0.001


@pytest.mark.parametrize("count", [4, 12])
def test_strays_round_about_spoil_little(count: int) -> None:
    rng = np.random.default_rng(count)
    away = 0.8 * sphere(count, 2) * rng.uniform(0.5, 2.0, (count, 1))
    away = away[np.abs(np.linalg.norm(away, axis=1) - 1.0) > 0.3]
    cloud = Operand.of(np.concatenate([sphere(), away]), np.concatenate([sphere(), sphere(len(away), 5)]))
    classifier = Classifier(cloud)
    found = cloud.strays[np.argsort(cloud.order)]
    assert not found[:N].any() and found[N:].all() and len(away) > 1
    assert cloud.areas[cloud.strays].max() == 0.0 and cloud.spacings[cloud.strays].max() < 0.1
    assert not classifier.leaky and wrong(classifier, places()) <= 0.003


@pytest.mark.parametrize(("count", "wide"), [(400, 1.0), (1200, 3.0)])
def test_one_stray_in_a_hundred_surfels_spoils_little(count: int, wide: float) -> None:
    """Far from the surface their neighbours are other strays, which must not vouch for each other."""
    rng, points = np.random.default_rng(count), sphere(40_000)
    away, normals = wide * rng.uniform(-1.0, 1.0, (count, 3)), sphere(count, 6)
    cloud = Operand.of(np.concatenate([points, away]), np.concatenate([points, normals]))
    found = cloud.strays[np.argsort(cloud.order)]
    far = np.abs(np.linalg.norm(away, axis=1) - 1.0) > 0.15
    assert not found[:40_000].any() and found[40_000:][far].mean() > 0.97
    classifier = Classifier(cloud)
    assert not classifier.leaky and classifier.conflict < 0.01
    assert wrong(classifier, places() / 1.4) <= 0.008


@pytest.mark.parametrize("feature", ["wire", "sparse wire", "bent wire", "tube", "small ball"])
def test_thin_and_sparse_features_are_no_strays(feature: str) -> None:
    points, rng = sphere(40_000), np.random.default_rng(0)
    h = np.sqrt(4.0 * np.pi / 40_000)
    along, angle = np.arange(60.0), rng.uniform(0.0, 2.0 * np.pi, 60)
    nothing = np.zeros(60)
    round_ = np.stack([nothing, np.cos(angle), np.sin(angle)], axis=1)
    if feature == "small ball":  # 30 times as sparse
        normals = sphere(56, 3)
        extra = 0.1 * normals + [1.3, 0.0, 0.0]
    elif feature == "bent wire":
        extra = np.stack(
            [1.0 + 20.0 * h * np.sin(along / 10.0), 20.0 * h * (1.0 - np.cos(along / 10.0)), nothing], axis=1
        )
        normals = np.tile([0.0, 0.0, 1.0], (60, 1))
    else:
        step = 3.0 if feature == "sparse wire" else 1.0
        extra, normals = np.stack([1.0 + step * h * along, nothing, nothing], axis=1), round_
        if feature == "tube":
            extra = extra + 0.5 * h * round_
    cloud = Operand.of(np.concatenate([points, extra]), np.concatenate([points, normals]))
    assert not cloud.strays.any()


@pytest.mark.parametrize("shape", ["even", "uneven", "plate", "hemisphere", "noisy"])
def test_no_surfel_of_a_surface_is_a_stray(shape: str) -> None:
    rng, points = np.random.default_rng(3), sphere(30_000)
    normals = points
    if shape == "uneven":
        keep = (points[:, 0] > 0.0) | (rng.random(len(points)) < 0.03)
        points, normals = points[keep], points[keep]
    elif shape == "plate":
        normals = np.sign(points) * [0.0, 0.0, 1.0]
        points = points * [1.0, 1.0, 0.0] + 0.004 * normals
    elif shape == "hemisphere":
        points = normals = points[points[:, 2] > 0.0]
    elif shape == "noisy":
        points = points + rng.normal(0.0, 0.02, points.shape)
    assert not Operand.of(points, normals).strays.any()


@pytest.mark.parametrize("apart", [[1e4, 0.0, 0.0], [6e3, 6e3, 6e3]])
def test_two_parts_far_apart_are_both_solid(apart: list[float]) -> None:
    points = np.concatenate([sphere(), sphere() + apart])
    classifier = Classifier(Operand.of(points, np.concatenate([sphere(), sphere()])))
    assert not classifier.leaky
    assert wrong(classifier, places(4000)) <= 0.002 and wrong(classifier, places(4000), np.array(apart)) <= 0.002


@pytest.mark.parametrize("times", [2, 20])
def test_surfels_given_several_times_count_once(times: int) -> None:
    points = np.repeat(sphere(), times, axis=0)
    cloud = Operand.of(points, points)
    classifier = Classifier(cloud)
    assert cloud.areas.sum() == pytest.approx(Operand.of(sphere(), sphere()).areas.sum(), rel=0.02)
    assert not classifier.leaky and wrong(classifier, places()) <= 0.001


def test_half_of_the_surfels_at_one_place() -> None:
    points = np.concatenate([sphere(), np.tile(sphere()[:1], (N, 1))])
    classifier = Classifier(Operand.of(points, points))
    assert not classifier.leaky and wrong(classifier, places()) <= 0.001


def test_density_of_one_to_ten_thousand() -> None:
    points = sphere()
    points[: N // 2] = 0.005 * points[: N // 2] + [0.0, 0.0, 1.0]
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    classifier = Classifier(Operand.of(points, points))
    assert not classifier.leaky and wrong(classifier, places()) <= 0.002


@pytest.mark.parametrize("shape", ["one place", "a line", "a slanting line", "a plane", "a volume", "no normals"])
def test_what_bounds_nothing_is_answered(shape: str) -> None:
    rng = np.random.default_rng(0)
    points, normals = rng.random((N, 3)), sphere()
    if shape == "one place":
        points[:] = 0.3
    elif shape == "a line":
        points[:, 1:] = 0.0
    elif shape == "a slanting line":
        points[:] = points[:, :1] * [1.0, 2.0, 3.0]
    elif shape == "a plane":
        points[:, 2], normals[:] = 0.0, [0.0, 0.0, 1.0]
    elif shape == "no normals":
        normals[:] = 0.0
    classifier = Classifier(Operand.of(points, normals))
    assert classifier._coloured is not None
    assert len(classifier._coloured.grid.border) <= N + (N + FREE) // 64  # words are bounded by the surfels
    assert not classifier.classify([[9.0, 9.0, 9.0], [-1e9, 0.0, 0.0]]).inside.any()
    assert len(classifier.classify(Operand.of(sphere(), sphere()), pose=translation([0.1, 0.0, 0.0])).kind) == N


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_a_few_surfels_make_no_solid_far_away(count: int) -> None:
    classifier = Classifier(Operand.of(sphere()[:count], sphere()[:count]))
    assert not classifier.classify(1e3 * sphere(50, 4)).inside.any()


def test_scale_and_offset_do_not_matter() -> None:
    q = places()
    for scale, offset in ((1e-90, 0.0), (1e90, 0.0), (1.0, 1e8)):
        classifier = Classifier(Operand.of(scale * sphere() + offset, sphere()))
        found = classifier.classify(scale * q + offset).inside
        assert (found != (np.linalg.norm(q, axis=1) < 1.0)).mean() <= 0.001


def test_a_small_flipped_patch_of_a_large_cloud_is_found() -> None:
    points = sphere(60_000)
    normals = points.copy()
    patch = np.linalg.norm(points - points[7], axis=1) < 0.12  # about 200 surfels, 25 of those who vote first
    normals[patch] *= -1.0
    classifier = Classifier(Operand.of(points, normals))
    assert (classifier.flipped == patch[classifier.operand.order]).all()


def test_a_hole_is_repaired_and_reported() -> None:
    points = sphere(30_000)
    points = points[np.linalg.norm(points - [0.0, 0.0, 1.0], axis=1) > 0.3]
    classifier = Classifier(Operand.of(points, points))
    q = 0.8 * places(20_000)
    below = q[:, 2] < 0.85
    assert classifier.leaky and 0.0 < classifier.conflict < 0.03
    assert (classifier.classify(q).inside != (np.linalg.norm(q, axis=1) < 1.0))[below].mean() <= 0.002
