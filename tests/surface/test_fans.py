"""Fans against sets of triples, and the sums that lines rely on."""

from __future__ import annotations

import numpy as np
import pytest

import naive
import shapes_with_truth as truth
from surfel.surface.fans import STAR, build_fans
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.patches import local_patches


@pytest.fixture(
    scope="module", params=[truth.sphere, truth.box, truth.square, truth.crossing_squares], ids=lambda f: f.__name__
)
def fans(request):
    cloud = request.param(900, 4)
    local = local_patches(Neighbourhoods.of(cloud.points, np.arange(900)), cloud.normals, star=STAR)
    built = build_fans(local.hood.points, local.normals, local.areas, local.cells.star, local.cells.joined)
    return local, built


def test_every_triangle_of_a_star_is_there_once_with_its_votes(fans):
    local, built = fans
    expected = naive.triangle_votes(local.cells.star, local.cells.joined)
    voted = built.votes > 0
    found = {
        tuple(sorted(int(j) for j in t)): int(v)
        for t, v in zip(built.triangles[voted], built.votes[voted], strict=True)
    }
    assert len(found) == voted.sum()
    assert found == dict(expected)
    assert set(expected.values()) <= {1, 2, 3}


def test_weights_hand_each_cell_to_its_triangles(fans):
    local, built = fans
    areas = np.array([naive.triangle_area(built.vertices[t]) for t in built.triangles])
    assert (built.weights * areas).sum() == pytest.approx(local.areas.sum(), rel=1e-12)
    share = {}
    for i in range(len(local.hood)):
        ring = [int(j) for j in local.cells.star[i] if j >= 0]
        total = sum(
            naive.triangle_area(local.hood.points[[i, ring[c], ring[(c + 1) % len(ring)]]])
            for c in range(len(ring))
            if local.cells.joined[i] >> c & 1
        )
        share[i] = local.areas[i] / (total / 3.0) if total else 0.0
    voters = {}
    for i in range(len(local.hood)):
        ring = [int(j) for j in local.cells.star[i] if j >= 0]
        for c in range(len(ring)):
            if local.cells.joined[i] >> c & 1:
                voters.setdefault(tuple(sorted((i, ring[c], ring[(c + 1) % len(ring)]))), []).append(i)
    for t, weight, votes in zip(built.triangles, built.weights, built.votes, strict=True):
        if votes:
            expected = sum(share[i] for i in voters[tuple(sorted(int(j) for j in t))]) / 3.0
            assert weight == pytest.approx(expected, rel=1e-9)


def test_a_lone_point_with_an_area_stands_for_itself():
    points = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    normals = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0]])
    star, joined = np.full((2, 4), -1, np.int32), np.zeros(2, np.int32)
    built = build_fans(points, normals, np.array([0.25, 0.0]), star, joined)
    assert len(built.triangles) == 1 and built.votes.tolist() == [0] and built.weights.tolist() == [1.0]
    corners = built.vertices[built.triangles[0]]
    assert naive.triangle_area(corners) == pytest.approx(0.25, rel=1e-12)
    np.testing.assert_allclose(corners.mean(axis=0), points[0], atol=1e-15)
    np.testing.assert_allclose((corners - points[0]) @ normals[0], 0.0, atol=1e-15)
    assert (built.owner[built.triangles[0]] == 0).all()


def test_most_triangles_of_an_even_surface_are_agreed_on():
    ball = truth.even_sphere(900, 1)
    local = local_patches(Neighbourhoods.of(ball.points, np.arange(900)), ball.normals, star=STAR)
    built = build_fans(local.hood.points, local.normals, local.areas, local.cells.star, local.cells.joined)
    assert (built.votes == 3).mean() > 0.9
    assert len(built.triangles) == pytest.approx(2 * 900 - 4, rel=0.05)
