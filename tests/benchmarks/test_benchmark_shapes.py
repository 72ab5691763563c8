"""The truths of the benchmarks: shapes have the area that they claim, and their points lie on them, evenly."""

from __future__ import annotations

import math

import numpy as np
import pytest
from benchmarks.shapes import (
    ANALYTIC,
    HARD,
    JUDGING,
    MESHES,
    TUNING,
    NoDataError,
    Triangles,
    known,
    read_mesh,
)

from benchmarks import clouds, structured

trimesh = pytest.importorskip("trimesh")


def solid(name):
    """Return a fine mesh of a solid, made by other code than the shape."""
    make = trimesh.creation
    if name == "sphere":
        return make.icosphere(subdivisions=5)
    if name == "cube":
        return make.box((1.0, 1.0, 1.0))
    if name == "torus":
        return make.torus(1.0, 0.35, major_sections=256, minor_sections=128)
    if name == "cylinder":
        return make.cylinder(0.2, 0.8, sections=512)
    pytest.importorskip("manifold3d")
    parts = [make.box((0.5, 0.5, 0.5)), make.cylinder(0.2, 1.0, sections=512)]
    return trimesh.boolean.union(parts) if name.endswith("union") else trimesh.boolean.difference(parts)


SOLIDS = ("sphere", "cube", "torus", "cylinder", "cube-cylinder union", "cube-cylinder difference")


@pytest.mark.parametrize("name", SOLIDS)
def test_a_solid_has_the_area_and_the_volume_of_a_fine_mesh(name):
    shape, mesh = known(name), solid(name)
    assert mesh.area == pytest.approx(shape.area, rel=2e-3)
    assert mesh.volume == pytest.approx(shape.volume, rel=4e-3)
    assert mesh.center_mass == pytest.approx(shape.centroid, abs=1e-6)


@pytest.mark.parametrize("name", SOLIDS)
def test_random_points_are_spread_by_area_with_outward_normals(name):
    """Compare the share of points in cells with the share of a mesh's points there, and step out along the normal."""
    shape, mesh = known(name), solid(name)
    points, normals = shape.draw(20_000, np.random.default_rng(3))
    other = Triangles(np.asarray(mesh.vertices), np.asarray(mesh.faces), np.asarray(mesh.face_normals))
    theirs, their_normals = other.draw(20_000, np.random.default_rng(4))
    low, high = points.min(axis=0), points.max(axis=0)

    def counts(places):
        cells = np.clip(((places - low) / (high - low) * 4).astype(int), 0, 3)
        return np.bincount(cells @ [16, 4, 1], minlength=64)

    # points on a boundary of cells fall to either side: the cells are shifted off the planes of the shapes
    low, high = low - 0.037 * (high - low), high + 0.061 * (high - low)
    mine, mesh_counts = counts(points), counts(theirs)
    assert np.all(np.abs(mine - mesh_counts) <= 6.0 * np.sqrt(mine + mesh_counts + 1.0) + 60.0)
    assert np.einsum("ij,ij->i", points, normals).sum() / 20_000 * shape.area == pytest.approx(
        3.0 * shape.volume, rel=0.02
    )  # the divergence theorem: fails where a normal points inwards
    assert normals.mean(axis=0) == pytest.approx(their_normals.mean(axis=0), abs=0.03)


@pytest.mark.parametrize("name", ["square", "disk", "half-sphere", "crossing squares", "two sheets"])
def test_an_open_shape_has_the_area_that_its_points_fill(name):
    """Count the cells of a fine grid on the planes (or the plane below the half-sphere) that points fall in."""
    shape = known(name)
    points, _ = shape.draw(400_000, np.random.default_rng(5))
    if name == "half-sphere":  # Archimedes: heights and longitudes are uniform
        assert np.histogram(points[:, 2], 10, (0.0, 1.0))[0] == pytest.approx(np.full(10, 40_000), rel=0.03)
        assert shape.area == pytest.approx(2.0 * math.pi)
        return
    sheets = {"crossing squares": [points[:, 1] != 0.0, points[:, 1] == 0.0]}.get(name, [np.ones(len(points), bool)])
    if name == "two sheets":
        sheets = [points[:, 2] == 0.0, points[:, 2] != 0.0]
    filled = 0
    for sheet in sheets:
        across = points[sheet][:, [0, 2] if np.ptp(points[sheet][:, 1]) == 0.0 else [0, 1]]
        filled += len(np.unique(np.floor(across / 0.01).astype(int), axis=0))
    assert filled * 1e-4 == pytest.approx(shape.area, rel=0.03)


@pytest.mark.parametrize("name", list(structured.CLEAN))
def test_a_clean_set_lies_on_its_solid_once_at_each_place(name):
    cloud = structured.clean(name)
    assert len(np.unique(np.round(cloud.points, 9), axis=0)) == len(cloud.points)
    assert np.linalg.norm(cloud.normals, axis=1) == pytest.approx(1.0)
    mesh = solid(cloud.shape.name)
    bound = 2e-3 if "sphere" in name else 1e-4
    rows = np.random.default_rng(0).choice(len(cloud.points), 500, replace=False)
    _, distance, _ = trimesh.proximity.closest_point_naive(mesh, cloud.points[rows][:40])
    assert distance.max() < bound
    flux = np.einsum("ij,ij->i", cloud.points, cloud.normals).mean() * cloud.shape.area
    if "16x" not in name:
        assert flux == pytest.approx(3.0 * cloud.shape.volume, rel=0.05)


def test_a_clean_set_is_as_dense_on_every_face():
    points = structured.clean("cube").points
    on_faces = [(np.abs(points[:, axis] - side) < 1e-12).sum() for axis in range(3) for side in (-0.5, 0.5)]
    assert on_faces == [105**2] * 6
    assert len(points) == 105**3 - 103**3


def test_the_uneven_sphere_is_16_times_as_dense_at_one_pole():
    height = structured.clean("16x uneven sphere").points[:, 2]
    top, bottom = (height > 0.9).sum(), (height < -0.9).sum()
    assert top / bottom == pytest.approx(16.0**0.95, rel=0.2)


def test_darts_keep_apart():
    cloud = clouds.blue_cloud("square", 1_000)
    gaps = np.linalg.norm(cloud.points[:, None] - cloud.points[None], axis=2) + 9.0 * np.eye(len(cloud.points))
    assert gaps.min() >= clouds.APART * math.sqrt(1e-3)
    assert len(cloud.points) == pytest.approx(1_000, rel=0.1)


def test_noise_has_the_asked_size():
    quiet, noisy = clouds.random_cloud("square", 20_000), clouds.noisy_cloud("square", 20_000, spacings=0.5)
    assert (noisy.points - quiet.points).std() == pytest.approx(0.5 * math.sqrt(1.0 / 20_000), rel=0.02)
    assert noisy.normals is None
    far = clouds.noisy_cloud("square", 20_000, diagonal=0.01)
    assert (far.points - quiet.points).std() == pytest.approx(0.01 * math.sqrt(2.0), rel=0.02)


def test_the_same_seed_gives_the_same_cloud():
    first, again, other = (clouds.random_cloud("torus", 100, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.points, again.points)
    assert not np.array_equal(first.points, other.points)


def test_shapes_for_tuning_and_for_judging_are_different():
    assert not {*TUNING} & {*JUDGING} and not {*HARD} & {*TUNING, *JUDGING}
    assert {*TUNING, *JUDGING, *HARD} <= {*ANALYTIC, *MESHES}


@pytest.mark.data
@pytest.mark.parametrize("name", ["spot", "fandisk", "112932", "bunny"])
def test_a_mesh_has_the_area_and_the_volume_of_the_manifest(name):
    manifest = {"spot": (5.70951879, 0.718258788), "fandisk": (60.6691092, 20.2433749)}
    manifest |= {"112932": (2246.83959, 2402.94645), "bunny": (0.0571287834, None)}
    try:
        shape = known(name)
    except NoDataError as absent:
        pytest.skip(str(absent))
    area, volume = manifest[name]
    assert shape.area == pytest.approx(area, rel=1e-8)
    assert shape.volume == (None if volume is None else pytest.approx(volume, rel=1e-8))
    points, normals = shape.draw(5_000, np.random.default_rng(0))
    if volume is not None:
        mesh = read_mesh(name)
        middle = mesh.bounds.mean(axis=0)
        flux = np.einsum("ij,ij->i", points - middle, normals).mean() * area / 3.0
        assert flux == pytest.approx(volume, rel=0.08)
