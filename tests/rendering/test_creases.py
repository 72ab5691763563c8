"""Creases: disks end where another sheet meets theirs in an edge."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from surfel.rendering.splats import splats_of

SIZE = (640, 480)
CAMERA = surfel.Camera((2.2, -2.9, 1.7), (0, 0, 0), field=42)


@pytest.mark.parametrize(("name", "most"), [("box", 1e-3), ("cylinder", 3e-3), ("cone", 5e-3)])
def test_random_points_of_solids_with_edges_have_their_outlines(name, most):
    solid = {"box": surfel.Box(1.2), "cylinder": surfel.Cylinder(0.5, 1.8), "cone": surfel.Cone(0.8, 0.0, 1.6)}[name]
    points = surfel.sample(solid, 5000)
    cloud = surfel.Surfels(points.points, normals=points.normals)
    truth = surfel.render(solid, CAMERA, SIZE, smooth=False).ids >= 0
    found = surfel.render(cloud, CAMERA, SIZE, smooth=False).ids >= 0
    assert np.count_nonzero(found != truth) <= most * np.count_nonzero(truth)


def box_with(extra, normal):
    """Return a grid on two faces that meet in an edge, x = 0 below and z = 0 beside, and one surfel more."""
    u, v = (part.ravel() for part in np.meshgrid(0.1 * (np.arange(12) + 0.5), 0.1 * np.arange(-12, 13)))
    top, side = np.column_stack([-u, v, 0 * u]), np.column_stack([0 * u, v, -u])
    points = np.concatenate([top, side, [extra]])
    normals = np.concatenate([np.tile([0.0, 0, 1], (len(u), 1)), np.tile([1.0, 0, 0], (len(u), 1)), [normal]])
    return splats_of(surfel.Surfels(points, normals=normals))


def planes_of(splats, place):
    row = int(np.argmin(((splats.places() - place) ** 2).sum(axis=1)))
    return splats.planes[splats.clips[row] : splats.clips[row + 1]]


def test_a_disk_beside_an_edge_ends_at_the_plane_of_the_other_face():
    (plane,) = planes_of(box_with((-0.9, 0.05, 0.0), (0.0, 0, 1)), (-0.05, 0.0, 0.0))
    np.testing.assert_allclose(plane, [1.0, 0.0, 0.0, 0.05], atol=1e-6)


def test_a_surfel_on_the_edge_is_cut_by_both_faces_and_keeps_its_place():
    planes = planes_of(box_with((0.0, 0.05, 0.0), (np.sqrt(0.5), 0, np.sqrt(0.5))), (0.0, 0.05, 0.0))
    found = {tuple(np.round(plane, 6) + 0.0) for plane in planes}
    assert found == {(1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)}


def test_a_single_surfel_that_faces_elsewhere_cuts_nothing():
    splats = box_with((-0.6, 0.04, 0.0), (1.0, 0, 0))
    assert len(planes_of(splats, (-0.65, 0.1, 0.0))) == 0
