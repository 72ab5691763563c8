"""Samples of surfaces: uniform, apart, dense."""

from __future__ import annotations

import numpy as np
import pytest

from surfel import InputError, Mesh, sample
from surfel.core.patches import Patches
from surfel.shapes.base import Shape

SQUARE = Mesh([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])


def ball(rows=40):
    """A sphere of triangles between circles of latitude."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rows + 1)[1:-1], np.arange(2 * rows) * np.pi / rows, indexing="ij")
    ring = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    vertices, m = np.vstack([ring, [[0, 0, 1], [0, 0, -1]]]), 2 * rows
    faces = []
    for j in range(m):
        k = (j + 1) % m
        faces.append([len(ring), j, k])
        faces.append([len(ring) + 1, len(ring) - m + k, len(ring) - m + j])
        for i in range(rows - 2):
            faces += [[i * m + j, (i + 1) * m + j, i * m + k], [i * m + k, (i + 1) * m + j, (i + 1) * m + k]]
    return Mesh(vertices, faces)


def plate(thickness):
    vertices = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, thickness)], float)
    faces = [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
    ]
    return Mesh(vertices, [*faces, [1, 5, 7], [1, 7, 3]])


def nearest(points, normals, queries=None, facing=None):
    """The distance to the nearest other sample of the same side, by brute force."""
    own = queries is None
    queries, facing = (points, normals) if own else (queries, facing)
    least = np.empty(len(queries))
    for i in range(len(queries)):
        gap = np.linalg.norm(points - queries[i], axis=1)
        gap[normals @ facing[i] < -0.5] = np.inf
        if own:
            gap[i] = np.inf
        least[i] = gap.min()
    return least


def hexagonal(mesh, n):
    return np.sqrt(2.0 * mesh.area / (np.sqrt(3.0) * n))


def test_random_points_lie_on_their_triangles():
    mesh = ball(12)
    points, normals, triangles = sample(mesh, 5000)
    np.testing.assert_array_equal(normals, mesh.face_normals[triangles])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    a, b, c = (mesh.vertices[mesh.triangles[triangles, k]] for k in range(3))
    areas = sum(np.linalg.norm(np.cross(p - points, q - points), axis=1) for p, q in ((a, b), (b, c), (c, a)))
    np.testing.assert_allclose(0.5 * areas, mesh.areas[triangles], atol=1e-14)


def test_random_points_are_uniform_and_independent():
    points, _, triangles = sample(SQUARE, 40_000, seed=1)
    boxes, _, _ = np.histogram2d(points[:, 0] / 2, points[:, 1], bins=10, range=[[0, 1], [0, 1]])
    chi_square = ((boxes - 400.0) ** 2 / 400.0).sum()
    assert 50.0 < chi_square < 170.0  # 99 degrees of freedom: both too uneven and too even are refused
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert steps.mean() == pytest.approx(0.805, abs=0.02)  # that of two points of the rectangle: no order is left
    assert np.bincount(triangles) == pytest.approx(20_000, abs=500)


def test_the_seed_decides():
    for kind in ("random", "blue"):
        one, two, other = (sample(SQUARE, 200, kind, seed=s).points for s in (1, 1, 2))
        assert np.array_equal(one, two) and not np.array_equal(one, other)
    assert np.array_equal(sample(SQUARE, radius=0.2).points, sample(SQUARE, radius=0.2).points)


@pytest.mark.parametrize("n", [1, 2, 7, 100, 3000])
def test_blue_points_keep_apart_and_there_are_as_many_as_asked_for(n):
    mesh = ball()
    points, normals, _ = sample(mesh, n, kind="blue")
    assert len(points) == n
    if n > 1:
        assert nearest(points, normals).min() >= 0.7 * hexagonal(mesh, n)


def test_blue_points_on_a_square():
    points, normals, _ = sample(SQUARE, 1500, kind="blue")
    gap = nearest(points, normals) / hexagonal(SQUARE, 1500)
    assert gap.min() >= 0.7 and gap.mean() > 0.78  # 0.5 at random


def test_the_two_sides_of_a_thin_plate_do_not_push_each_other():
    mesh = plate(0.001)
    points, normals, _ = sample(mesh, 1000, kind="blue")
    top, bottom = points[normals[:, 2] > 0.5], points[normals[:, 2] < -0.5]
    assert abs(len(top) - len(bottom)) < 60
    for side in (top, bottom):
        boxes, _, _ = np.histogram2d(side[:, 0], side[:, 1], bins=5, range=[[0, 1], [0, 1]])
        assert boxes.std() < 3.0  # 4.5 at random
    radius = 0.1
    dense = sample(mesh, radius=radius)
    queries = sample(mesh, 4000, seed=9)
    assert nearest(dense.points, dense.normals, queries.points, queries.normals).max() <= radius


@pytest.mark.parametrize("radius", [1.5, 0.3, 0.08])
@pytest.mark.parametrize("mesh", [SQUARE, ball(12)], ids=["square", "ball"])
def test_dense_points_leave_nothing_uncovered(mesh, radius):
    points, normals, triangles = sample(mesh, radius=radius)
    queries = sample(mesh, 4000, seed=5)
    corners = mesh.vertices[mesh.triangles].reshape(-1, 3)
    everywhere = np.concatenate([queries.points, corners])
    facing = np.concatenate([queries.normals, np.repeat(mesh.face_normals, 3, axis=0)])
    assert nearest(points, normals, everywhere, facing).max() <= radius * (1.0 + 1e-12)
    if len(points) > 1:
        assert nearest(points, normals).min() >= 0.998 * radius
    np.testing.assert_array_equal(normals, mesh.face_normals[triangles])


def test_dense_points_on_slivers_and_on_triangles_without_area():
    thin = Mesh([[0, 0, 0], [10, 0, 0], [10, 1e-6, 0], [5, 0, 0]], [[0, 1, 2], [0, 1, 3]])
    points, _, triangles = sample(thin, radius=0.5)
    assert (triangles == 0).all() and 10 <= len(points) <= 25
    along = np.sort(points[:, 0])
    assert along[0] <= 0.5 and along[-1] >= 9.5 and np.diff(along).max() <= 1.0


class Cloud(Shape):
    """A shape that has patches and nothing else: 500 small ones and one that is large."""

    bounds = np.array([[0.0, 0, 0], [1, 1, 0]])

    def _patches(self, n):
        points = np.column_stack([np.random.default_rng(0).random((501, 2)), np.zeros(501)])
        return Patches(points, np.tile([0.0, 0, 1], (501, 1)), np.append(np.full(500, 0.001), 1.0))

    def _cross(self, lines): ...

    def _contains(self, points): ...


def test_other_shapes_give_some_of_their_patches():
    cloud = Cloud()
    points, _, rows = sample(cloud, 50)
    assert len(np.unique(rows)) == 50 and 500 in rows
    assert np.array_equal(points, cloud.patches().points[rows])
    assert len(sample(cloud, 50, kind="blue").points) == 50
    with pytest.raises(InputError, match="n must be at most 501"):
        sample(cloud, 502)
    with pytest.raises(InputError, match="radius needs a mesh"):
        sample(cloud, radius=0.1)


@pytest.mark.parametrize(
    ("arguments", "options", "said"),
    [
        ((SQUARE,), {}, "give either n"),
        ((SQUARE, 10), {"radius": 0.1}, "give either n"),
        ((SQUARE, 0), {}, "n must be at least 1"),
        ((SQUARE, 10, "green"), {}, "kind must be one of random, blue"),
        ((SQUARE,), {"radius": -1.0}, "radius must be positive"),
        ((SQUARE,), {"radius": 1e-9}, "asks for about"),
        (("a mesh", 10), {}, "shape must be a Mesh"),
        ((Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]), 10), {}, "no area"),
    ],
)
def test_bad_arguments(arguments, options, said):
    with pytest.raises(InputError, match=said):
        sample(*arguments, **options)
