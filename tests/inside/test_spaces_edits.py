"""Surfels that move re-colour their neighbourhood alone, and the answers are those of a classifier built anew."""

from __future__ import annotations

import numpy as np
import pytest

from surfel.core.errors import InputError
from surfel.index.neighbours import PointIndex
from surfel.inside.classify import Classifier
from surfel.inside.operand import Operand


def sphere(n: int) -> np.ndarray:
    p = np.random.default_rng(0).standard_normal((n, 3))
    return p / np.linalg.norm(p, axis=1, keepdims=True)


def test_editing_recolours_the_neighbourhood_alone() -> None:
    points = sphere(40_000)
    cloud = Operand.of(points, points)
    classifier = Classifier(cloud)
    rows = np.flatnonzero(points[:, 2] > 0.97)
    raised = points[rows] + [0.0, 0.0, 0.1] * np.sin(0.5 * np.pi * (points[rows, 2:] - 0.97) / 0.03)
    edited = classifier.edited(rows, raised, points[rows])
    everything, spacings = points.copy(), np.empty(len(points))
    everything[rows], spacings[cloud.order] = raised, cloud.spacings
    fresh = Classifier(Operand.of(everything, points, spacings=spacings))
    assert 0 < edited.recoloured < 0.5 * classifier.recoloured
    rng = np.random.default_rng(1)
    around = np.repeat(raised, 20, axis=0) + rng.uniform(-0.1, 0.1, (20 * len(rows), 3))
    q = np.concatenate([rng.uniform(-1.3, 1.3, (100_000, 3)), around])
    a, b, old = edited.classify(q).kind, fresh.classify(q).kind, classifier.classify(q).kind
    assert (a != b).mean() < 2e-3 and (b != old).mean() > 10.0 * (a != b).mean()
    assert (classifier.classify(q).kind == old).all()  # the first one stays as it was


def test_an_edit_that_opens_the_surface_is_seen() -> None:
    points = sphere(20_000)
    rows = np.flatnonzero(points[:, 2] > 0.9)
    edited = Classifier(Operand.of(points, points)).edited(rows, points[rows] * [1.0, 1.0, -1.0], -points[rows])
    assert edited.leaky


def test_editing_twice_and_back() -> None:
    points = sphere(20_000)
    classifier = Classifier(Operand.of(points, points))
    rows = np.flatnonzero(points[:, 0] > 0.98)
    there = classifier.edited(rows, points[rows] * 1.05, points[rows])
    back = there.edited(rows, points[rows], points[rows])
    q = np.random.default_rng(2).uniform(-1.2, 1.2, (50_000, 3))
    assert (back.classify(q).kind == classifier.classify(q).kind).all()


def test_an_index_of_moved_points_is_exact() -> None:
    points = sphere(3000)
    index = PointIndex(points)
    shaken = index.points + np.random.default_rng(3).normal(0.0, 0.3, points.shape)
    moved = index.moved(shaken)
    q = np.random.default_rng(4).uniform(-1.0, 1.0, (200, 3))
    squares, rows = moved.knn_of(q + index.origin, 3)
    distance = ((shaken[None] - q[:, None]) ** 2).sum(axis=2)
    assert (rows == np.argsort(distance, axis=1)[:, :3]).all()
    assert squares == pytest.approx(np.sort(distance, axis=1)[:, :3])
    with pytest.raises(InputError, match="3000 rows"):
        index.moved(shaken[:5])


def test_edits_are_checked() -> None:
    points = sphere(500)
    classifier = Classifier(Operand.of(points, points))
    nothing = np.zeros((1, 3))
    with pytest.raises(InputError, match="twice"):
        classifier.edited([1, 1], np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(InputError, match="row numbers"):
        classifier.edited([500], nothing, nothing)
    with pytest.raises(InputError, match="shape"):
        classifier.edited([5], np.zeros((2, 3)), nothing)
    assert classifier.edited(np.empty(0, int), np.empty((0, 3)), np.empty((0, 3))) is classifier
