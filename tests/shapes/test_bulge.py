"""The curved surface over the triangles of a cloud: arcs, coarse samplings, edges, and how much volume lies between."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import shapes_with_truth as truth
from surfel import Box, Lines, Surfels, measure, sample
from surfel.index.bvh import TriangleBvh
from surfel.shapes.bulge import bulge_of
from surfel.shapes.sheets import crossings_of
from surfel.surface.fans import Fans


def evenly_round(count):
    """Return the points of a spiral on the unit sphere."""
    z = (2.0 * np.arange(count) + 1.0) / count - 1.0
    ring, turn = np.sqrt(1.0 - z * z), 2.399963229728653 * np.arange(count)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)


@pytest.mark.parametrize("turn", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("signs", [(1, 1, 1), (1, -1, 1), (-1, -1, -1)])
def test_the_middle_of_a_chord_is_moved_onto_the_arc(turn, signs):
    """Two corners of a triangle on one ruling of a cylinder, one on another; turned by an angle about the axis."""
    ends = np.array([-turn, -turn, turn])
    normals = np.stack([np.sin(ends), np.zeros(3), np.cos(ends)], axis=1)
    vertices = normals + np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    lines = Lines(np.array([[0.0, 0.0, 5.0]]), np.array([[0.0, 0.0, -1.0]]), np.ones(1))
    triangles = np.array([[0, 1, 2]], np.int32)
    hits = TriangleBvh(vertices, triangles).cross(lines.origins, lines.directions, barycentric=True)
    signed = normals * np.array(signs, float)[:, None]
    found = crossings_of(
        lines, hits, vertices, signed, np.full(3, 2.0), triangles, np.ones(1), np.full(1, 3, np.int8)
    )  # fmt: skip
    assert found.t == pytest.approx([4.0], abs=1e-12)


@pytest.mark.parametrize("count", [150, 600])
def test_the_bulge_of_a_ball_is_what_its_hull_lacks(count):
    points = evenly_round(count)
    hull = ConvexHull(points)
    votes = np.full(len(hull.simplices), 3, np.int8)
    fans = Fans(points, hull.simplices.astype(np.int32), np.ones(len(votes)), votes, np.arange(count, dtype=np.int32))
    found = bulge_of(fans, points)
    lacks = 4.0 / 3.0 * math.pi - hull.volume
    assert found.smooth == pytest.approx(lacks, rel=0.03)
    assert found.edges == 0.0


def test_triangles_over_edges_are_told_from_smooth_ones():
    corners = np.array([[-1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 1.0], [-1.0, 2.0, 1.0]])
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.7, 0.7], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    fans = Fans(corners, np.array([[0, 2, 3], [0, 1, 2]], np.int32), np.ones(2), np.full(2, 3, np.int8), np.arange(4))
    found = bulge_of(fans, normals)
    assert found.smooth == 0.0
    assert found.edges > 0.0


def test_a_coarse_ball_has_its_volume_and_not_that_of_a_polyhedron():
    points = evenly_round(200)
    volume = 4.0 / 3.0 * math.pi
    assert ConvexHull(points).volume < 0.975 * volume
    found = measure(Surfels(points, points, solid=True)).volume
    assert float(found.value) == pytest.approx(volume, rel=2e-3)


def test_the_volume_of_a_thin_ring_is_known_within_its_interval():
    """Three spacings across its section, where flat triangles lack a twenty-fifth."""
    ring = truth.torus(1000, 5, 1.0, 0.2)
    found = measure(Surfels(ring.points, ring.normals)).volume
    exact = 2.0 * math.pi**2 * 0.2**2
    assert float(found.value) == pytest.approx(exact, rel=0.02)
    assert abs(float(found.value) - exact) < 2.5 * found.standard_error


@pytest.mark.parametrize("given", [True, False])
def test_triangles_cut_less_than_a_third_of_a_percent_off_a_cube(given):
    cloud = sample(Box((1.0, 1.0, 1.0)), 3000, seed=2)
    found = measure(Surfels(cloud.points, cloud.normals if given else None, solid=True)).volume
    assert float(found.value) == pytest.approx(1.0, rel=3.3e-3)
    assert abs(float(found.value) - 1.0) < 2.5 * found.standard_error
