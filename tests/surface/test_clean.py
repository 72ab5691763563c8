"""Duplicates: found, counted, and nothing else dropped."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
from surfel.surface.clean import duplicate_rows
from surfel.surface.neighbourhoods import Neighbourhoods, cleaned


@pytest.mark.parametrize("times", [2, 3, 40])
def test_every_place_is_kept_once(times):
    points = truth.torus(300, 1).points
    order = np.random.default_rng(0).permutation(300 * times)
    hood, counts = cleaned(np.tile(points, (times, 1))[order], None)
    assert counts == {"duplicates": 300 * (times - 1), "strays": 0}
    kept = hood.points + hood.index.origin
    np.testing.assert_allclose(kept[np.lexsort(kept.T)], points[np.lexsort(points.T)], atol=1e-12)


def test_the_kept_normal_is_the_same_whatever_the_order_and_the_signs():
    rng = np.random.default_rng(1)
    points = np.tile(truth.torus(200, 1).points, (3, 1))
    normals = rng.standard_normal((600, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    kept = []
    for order, sign in ((np.arange(600), 1.0), (rng.permutation(600), 1.0), (rng.permutation(600), -1.0)):
        signs = sign * np.where(rng.random(600) < 0.5, -1.0, 1.0)[:, None]
        hood, _ = cleaned(points[order], (normals * signs)[order])
        kept.append(set(order[hood.rows]))
    assert kept[0] == kept[1] == kept[2]


def test_a_known_normal_is_kept_before_an_unknown_one():
    points = np.tile(truth.torus(50, 1).points, (2, 1))
    known = np.tile([-0.6, 0.0, 0.8], (50, 1))
    for normals in (np.concatenate([known, 0 * known]), np.concatenate([0 * known, known])):
        hood, _ = cleaned(points, normals)
        assert normals[hood.rows].any(axis=1).all()


def test_near_is_not_the_same():
    points = np.concatenate([truth.torus(300, 1).points, truth.torus(300, 1).points + 1e-9])
    assert cleaned(points, None)[1]["duplicates"] == 0


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_too_few_places_show_no_surface(n):
    points = truth.sphere(n).points if n else np.empty((0, 3))
    assert cleaned(points, None)[0] is None
    if n:
        hood, counts = cleaned(np.repeat(points, 5, axis=0), None)
        assert hood is None and counts["duplicates"] == 4 * n


def test_nothing_is_dropped_without_duplicates():
    hood = Neighbourhoods.of(truth.sphere(500).points, np.arange(500))
    assert len(duplicate_rows(hood.points, None, hood.squared)) == 0
