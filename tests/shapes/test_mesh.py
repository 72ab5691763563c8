"""Mesh: what it says of itself, what lines and points say of it, and the real files that are traps."""

from __future__ import annotations

import csv
import os
import pickle
from pathlib import Path

import numpy as np
import pytest

from surfel import InputError, Lines, Mesh
from surfel.shapes.mesh_topology import is_closed, merge_equal

DATA = Path(os.environ.get("SURFEL_DATA") or Path(__file__).parents[2] / "../shared/data")
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
BOX = np.array([row for a, b, c, d in QUADS for row in ([a, b, c], [a, c, d])])


def box(size=(1.0, 2.0, 3.0), inverted=False):
    return Mesh(CORNERS * size, BOX[:, ::-1] if inverted else BOX)


def lines_through(bounds, count, seed=0):
    """Random lines through the ball round a box, each of the weight with which crossings add up to pi times an area."""
    rng = np.random.default_rng(seed)
    center, radius = bounds.mean(axis=0), 0.5 * np.linalg.norm(bounds[1] - bounds[0])
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.cross(directions, rng.standard_normal((count, 3)))
    across *= (radius * np.sqrt(rng.random(count)) / np.linalg.norm(across, axis=1))[:, None]
    return Lines.of(center + across, directions, 2.0 * np.pi * np.pi * radius**2 / count)


def crossed_volume(mesh, lines):
    """The volume of a closed mesh as lengths of lines inside, and its standard error."""
    crossings = mesh.cross(lines)
    length = np.bincount(crossings.lines, np.sign(crossings.cosine) * crossings.t, len(lines))
    value = lines.weights * length / (2.0 * np.pi)
    return value.sum(), value.std() * np.sqrt(len(lines))


def load(name):
    trimesh = pytest.importorskip("trimesh")
    path = DATA / "meshes" / name
    if not path.is_file():
        pytest.skip(f"{path} is not there: set SURFEL_DATA to the folder with the data")
    mesh = trimesh.load(path, process=False, force="mesh")
    return Mesh(mesh.vertices, mesh.faces)


def manifest():
    path = DATA / "MANIFEST.tsv"
    if not path.is_file():
        return []
    with path.open() as rows:
        return [row for row in csv.DictReader(rows, delimiter="\t") if row["file"].startswith("meshes/")]


def test_a_box():
    mesh = box()
    assert (len(mesh), len(mesh.vertices), mesh.closed, mesh.inverted) == (12, 8, True, False)
    assert mesh.area == pytest.approx(22.0, rel=1e-15)
    assert mesh.volume == pytest.approx(6.0, rel=1e-15)
    assert mesh.bounds.tolist() == [[0, 0, 0], [1, 2, 3]]
    assert repr(mesh) == "Mesh(8 vertices, 12 triangles, closed)"
    np.testing.assert_allclose(mesh.face_normals[[0, 2]], [[-1, 0, 0], [1, 0, 0]])


def test_crossings_tell_in_from_out():
    for mesh in (box(), box(inverted=True)):
        crossings = mesh.cross(Lines.of([[0.5, 0.7, 9.0], [5.0, 5.0, 5.0]], [[0, 0, 1], [0, 0, 1]], 1.0))
        assert crossings.offsets.tolist() == [0, 2, 2]
        assert crossings.t.tolist() == [-9.0, -6.0]
        assert crossings.cosine.tolist() == [-1.0, 1.0]
        assert crossings.weight.tolist() == [1.0, 1.0] and crossings.leaf.tolist() == [0, 0]


def test_an_inverted_box_is_the_same_solid():
    mesh = box(inverted=True)
    assert mesh.inverted and mesh.closed
    assert mesh.volume == pytest.approx(6.0)
    np.testing.assert_array_equal(mesh.face_normals, box().face_normals)
    np.testing.assert_array_equal(mesh.vertex_normals, box().vertex_normals)
    assert mesh.contains([[0.5, 1.0, 1.5], [2, 2, 2]]).tolist() == [True, False]


def test_a_box_without_a_lid_is_open():
    mesh = Mesh(CORNERS, BOX[:-1])
    assert not mesh.closed and not mesh.inverted and mesh.volume is None
    with pytest.raises(InputError, match="an open mesh has no inside"):
        mesh.contains([[0.5, 0.5, 0.5]])
    assert mesh.area == pytest.approx(5.5)


def test_a_turned_triangle_opens_a_box():
    turned = BOX.copy()
    turned[5] = turned[5, ::-1]
    assert not Mesh(CORNERS, turned).closed


def test_a_soup_is_merged():
    soup = Mesh((CORNERS * (1, 2, 3))[BOX].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert soup.closed and soup.volume == pytest.approx(6.0)
    points, normals = soup.vertex_points()
    assert len(points) == 8
    outward = points - [0.5, 1.0, 1.5]
    assert (np.einsum("ij,ij->i", normals, outward) > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(soup.vertex_normals, axis=1), 1.0)


def test_two_boxes_that_touch_along_an_edge_are_closed():
    two = np.vstack([CORNERS, CORNERS + np.array([1, 1, 0])])
    mesh = Mesh(two, np.vstack([BOX, BOX + 8]))
    assert mesh.closed and mesh.volume == pytest.approx(2.0)


def test_unused_vertices_neither_stretch_the_bounds_nor_become_points():
    mesh = Mesh(np.vstack([[[9.0, 9, 9]], CORNERS, [[-9.0, 0, 0]]]), BOX + 1)
    assert mesh.bounds.tolist() == [[0, 0, 0], [1, 1, 1]]
    assert len(mesh.vertex_points()[0]) == 8
    assert mesh.vertex_normals[0].tolist() == [0, 0, 0]


def test_normals_of_vertices_are_weighted_by_area():
    mesh = Mesh([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 1]], [[0, 1, 2], [0, 3, 1]])
    np.testing.assert_allclose(mesh.vertex_normals[0], np.array([0, 2, 4]) / np.sqrt(20.0))
    np.testing.assert_allclose(mesh.vertex_normals[2], [0, 0, 1])


def test_merging_finds_what_unique_finds():
    rng = np.random.default_rng(0)
    vertices = rng.integers(-3, 4, (2000, 3)) / 7.0
    vertices[::5] *= -0.0
    first = merge_equal(vertices)
    _, inverse = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    lowest = np.full(inverse.max() + 1, len(vertices))
    np.minimum.at(lowest, inverse.ravel(), np.arange(len(vertices)))
    assert np.array_equal(first, lowest[inverse.ravel()])
    assert not is_closed(np.empty((0, 3), np.int32))


def test_inside():
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 1.5, (3000, 3))
    inside = ((points > 0) & (points < 1)).all(axis=1)
    assert np.array_equal(Mesh(CORNERS, BOX).contains(points), inside)
    assert len(Mesh(CORNERS, BOX).contains([])) == 0


def test_patches_share_the_area():
    mesh = box()
    patches = mesh.patches(6000)
    assert len(patches) == 6000
    assert patches.areas.sum() == pytest.approx(22.0, rel=1e-12)
    on_face = np.isclose(patches.points, 0.0) | np.isclose(patches.points, [1, 2, 3])
    assert on_face.any(axis=1).all()
    # the share of each side, and the mean within one, far better than at random (which errs by 0.005 and more)
    top = patches.normals[:, 2] > 0.5
    assert patches.areas[top].sum() == pytest.approx(2.0, abs=0.01)
    np.testing.assert_allclose(patches.points[top].mean(axis=0), [0.5, 1.0, 3.0], atol=0.01)
    assert np.array_equal(mesh.patches(100, seed=3).points, mesh.patches(100, seed=3).points)
    assert not np.array_equal(mesh.patches(100, seed=3).points, mesh.patches(100, seed=4).points)


def test_transformed():
    angle = 0.3
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[:3, 3] = [5, 6, 7]
    moved = box().transformed(matrix)
    assert moved.area == pytest.approx(22.0) and moved.volume == pytest.approx(6.0) and not moved.inverted
    mirror = np.diag([-2.0, 1.0, 1.0, 1.0])
    mirrored = box().transformed(mirror)
    assert not mirrored.inverted and mirrored.volume == pytest.approx(12.0)
    assert box(inverted=True).transformed(mirror).inverted
    with pytest.raises(InputError, match="singular"):
        box().transformed(np.diag([0.0, 1, 1, 1]))


def test_it_cannot_be_changed_and_does_not_follow_its_sources():
    vertices, faces = CORNERS.copy(), BOX.copy()
    mesh = Mesh(vertices, faces, np.zeros((8, 3), np.uint8))
    vertices[:], faces[:] = 0.0, 0
    assert mesh.volume == pytest.approx(1.0)
    for array in (mesh.vertices, mesh.triangles, mesh.colors, mesh.bounds, mesh.areas, mesh.vertex_normals):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_pickled():
    mesh = box()
    mesh.cross(lines_through(mesh.bounds, 10))
    copy = pickle.loads(pickle.dumps(mesh))
    assert copy.volume == mesh.volume and np.array_equal(copy.triangles, mesh.triangles)
    assert not copy.vertices.flags.writeable
    assert copy.contains([[0.5, 0.5, 0.5]]).all()


@pytest.mark.parametrize("scale", [1e-12, 1e12, 1e60])
def test_scale(scale):
    mesh = Mesh(CORNERS * scale, BOX)
    assert mesh.area / scale**2 == pytest.approx(6.0) and mesh.volume / scale**3 == pytest.approx(1.0)
    assert mesh.contains(np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 1.5]]) * scale).tolist() == [True, False]


def test_empty_and_flat():
    empty = Mesh(np.empty((0, 3)), np.empty((0, 3), int))
    assert (empty.area, empty.closed, empty.volume, len(empty)) == (0.0, False, None, 0)
    assert empty.cross(Lines.of([[0, 0, 0]], [[0, 0, 1]], 1.0)).offsets.tolist() == [0, 0]
    for bad in (empty, Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])):
        with pytest.raises(InputError, match="no area"):
            bad.patches(10)
    with pytest.raises(InputError, match="no bounds"):
        _ = empty.bounds


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((CORNERS[:, :2], BOX), "vertices must have shape"),
        ((np.vstack([CORNERS, [[np.nan, 0, 0]]]), BOX), "vertices has 1 rows that are not finite"),
        ((CORNERS, BOX + 1), "triangles must name vertices from 0 to 7; got 1 to 8"),
        ((CORNERS, BOX.astype(float)), "triangles must be integers"),
        ((CORNERS, BOX, np.zeros((7, 3))), "colors must have shape"),
    ],
)
def test_bad_arguments(arguments, said):
    with pytest.raises(InputError, match=said):
        Mesh(*arguments)


def test_only_lines_cross():
    with pytest.raises(InputError, match=r"surfel\.Lines"):
        box().cross([[0, 0, 0]])


@pytest.mark.data
@pytest.mark.parametrize("row", manifest(), ids=lambda row: row["file"][7:])
def test_area_and_volume_of_real_meshes(row):
    if "tristrips" in row["notes"]:
        pytest.skip("trimesh does not read tristrips")
    mesh = load(row["file"][7:])
    assert mesh.area == pytest.approx(float(row["area"]), rel=1e-8)
    value, _, open_ = row["volume"].partition(" ")
    if not open_:
        assert mesh.closed
    if mesh.closed and "Cray_right" not in row["file"]:
        assert mesh.volume == pytest.approx(abs(float(value)), rel=1e-8)
        assert mesh.inverted == (float(value) < 0.0)


@pytest.mark.data
@pytest.mark.parametrize("name", ["horse.ply", "88566.stl", "dragon_vrip_res3.ply", "cycloidal.ply", "Cray_right.obj"])
def test_what_is_closed_is_crossed_an_even_number_of_times(name):
    mesh = load(name)
    assert mesh.closed
    lines = lines_through(mesh.bounds, 100_000)
    assert (mesh.cross(lines).counts % 2 == 0).all()


@pytest.mark.data
@pytest.mark.parametrize("name", ["lion.off", "teapot.obj", "bun_zipper.ply"])
def test_what_is_open_leaks(name):
    mesh = load(name)
    assert not mesh.closed and mesh.volume is None
    assert (mesh.cross(lines_through(mesh.bounds, 20_000)).counts % 2 == 1).any()


@pytest.mark.data
def test_coordinates_near_the_largest_float_give_the_box_that_they_are():
    mesh = load("Cray_right.obj")
    side = 3.40282347e38
    assert mesh.area == pytest.approx(2 * (2 * side) ** 2 + 4 * 2 * side * side, rel=1e-8)
    assert mesh.volume == pytest.approx(4 * side**3, rel=1e-8)
    assert mesh.contains([[0, 0, -side / 2], [0, 0, side / 2]]).tolist() == [True, False]


@pytest.mark.data
@pytest.mark.parametrize("asked", ["area", "volume", "inverted", "face_normals", "vertex_normals"])
def test_coordinates_without_a_cube_are_refused_where_they_are_multiplied(asked):
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    assert Mesh(vertices * 9e99, triangles).volume == pytest.approx(0.9**3 * 1e300 / 6.0)
    with pytest.raises(InputError, match="scale it down"):
        getattr(Mesh(vertices * 3e200, triangles), asked)


def test_the_limit_of_the_count_is_the_area_and_that_of_the_chords_the_volume():
    mesh = load("horse.ply")
    lines = lines_through(mesh.bounds, 1_000_000)
    counts = mesh.cross(lines).counts * lines.weights / np.pi
    assert counts.sum() == pytest.approx(mesh.area, abs=4.0 * counts.std() * 1000.0)
    volume, error = crossed_volume(mesh, lines)
    assert volume == pytest.approx(mesh.volume, abs=4.0 * error)
    assert error < 0.01 * mesh.volume
