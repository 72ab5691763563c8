"""Edges, corners and planar pieces by eigen-analysis."""

from __future__ import annotations

import numpy as np
import pytest

from shapes_with_truth import box, rotation, sphere
from surfel.core.errors import InputError
from surfel.inside.features import CORNER, EDGE, PLANAR, features
from surfel.inside.operand import Operand


@pytest.fixture(scope="module")
def cube():
    return box(24_000, 1)


@pytest.fixture(scope="module")
def found(cube):
    return features(Operand.of(cube.points, cube.normals))


def sides_near(points, reach):
    return (np.abs(points) > 0.5 - reach).sum(axis=1)


def test_faces_edges_and_corners_of_a_cube(cube, found):
    spacing = cube.spacing
    assert (found.kind[sides_near(cube.points, 4.0 * spacing) == 1] == PLANAR).all()
    clear_edge = (sides_near(cube.points, 0.7 * spacing) == 2) & (sides_near(cube.points, 4.0 * spacing) == 2)
    assert (found.kind[clear_edge] == EDGE).mean() > 0.96
    at_corner = sides_near(cube.points, 0.7 * spacing) == 3
    assert at_corner.sum() >= 5 and (found.kind[at_corner] == CORNER).mean() >= 0.8
    assert (found.kind[sides_near(cube.points, 4.0 * spacing) < 3] != CORNER).all()


def test_edges_run_along_the_axes(cube, found):
    edge = (found.kind == EDGE) & (sides_near(cube.points, 4.0 * cube.spacing) == 2)
    along = np.abs(found.along[edge])
    free = np.argmin(np.abs(cube.points[edge]), axis=1)
    assert along[np.arange(len(along)), free].min() > 0.999
    assert (found.along[found.kind != EDGE] == 0.0).all()


def test_the_eigenvalues_are_shares(cube, found):
    assert np.allclose(found.spread.sum(axis=1), 1.0)
    assert (np.diff(found.spread, axis=1) <= 1e-12).all()
    assert (found.variation >= 0.0).all() and (found.variation <= 1.0 / 3.0 + 1e-9).all()
    assert found.variation[found.kind == PLANAR].mean() < 0.2 * found.variation[found.kind == EDGE].mean()


def test_flipped_normals_make_no_edges(cube, found):
    sign = np.where(np.random.default_rng(2).random(len(cube.points)) < 0.3, -1.0, 1.0)[:, None]
    other = features(Operand.of(cube.points, cube.normals * sign))
    assert np.array_equal(other.kind, found.kind)


def test_a_smooth_surface_has_no_features():
    cloud = sphere(8000, 3)
    assert not features(Operand.of(cloud.points, cloud.normals)).kind.any()


def test_features_turn_with_the_cloud(cube, found):
    turn = rotation(4)
    other = features(Operand.of(cube.points @ turn.T, cube.normals @ turn.T))
    assert (other.kind == found.kind).mean() > 0.9999
    edge = (found.kind == EDGE) & (other.kind == EDGE)
    cosine = np.abs(np.einsum("ij,ij->i", other.along[edge], found.along[edge] @ turn.T))
    assert cosine.min() > 1.0 - 1e-6


def test_against_numpy(cube, found):
    """One neighbourhood by hand."""
    row = int(np.flatnonzero(found.kind == EDGE)[0])
    square = ((cube.points - cube.points[row]) ** 2).sum(axis=1)
    rows = np.argsort(square)[:17]
    weight = np.exp(-square[rows] / (0.35 * square[rows[-1]]))
    normals = cube.normals[rows]
    spread = np.linalg.eigvalsh((normals * weight[:, None]).T @ normals / weight.sum())[::-1]
    assert found.spread[row] == pytest.approx(spread, abs=1e-9)
    step = cube.points[rows] - np.average(cube.points[rows], weights=weight, axis=0)
    values = np.linalg.eigvalsh((step * weight[:, None]).T @ step)
    assert found.variation[row] == pytest.approx(values[0] / values.sum(), abs=1e-9)


def test_small_clouds_and_bad_input():
    assert len(features(Operand.of(np.empty((0, 3)), np.empty((0, 3)))).kind) == 0
    one = features(Operand.of([[0.0, 0, 0]], np.array([[0.0, 0, 1]])))
    assert one.kind.tolist() == [PLANAR] and one.spread.tolist() == [[1.0, 0.0, 0.0]]
    unknown = sphere(50).points
    assert not features(Operand.of(unknown, np.zeros_like(unknown))).kind.any()
    with pytest.raises(InputError, match="k must be at least 3"):
        features(Operand.of(unknown, unknown), k=2)
