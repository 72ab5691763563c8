"""read, write, info and convert: paths, formats by their beginning, what is dropped, kept and said."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading

import numpy as np
import pytest

import surfel.io
from surfel.core.errors import FileFormatError, InputError
from surfel.io import Format, register
from surfel.io.registry import _FORMATS
from surfel.shapes.mesh import Mesh
from surfel.shapes.surfels import Surfels

RNG = np.random.default_rng(11)
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
FACES = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


@pytest.mark.parametrize("as_", [None, "points"])
def test_paths_that_cannot_be_read(tmp_path, as_):
    (tmp_path / "empty.ply").touch()
    (tmp_path / "a.unknown").write_text("1 2 3")
    for path, error, words in [
        (tmp_path / "missing.ply", InputError, "no such file"),
        (tmp_path, InputError, "is a folder"),
        (tmp_path / "a.unknown", InputError, "known are .ply"),
        (tmp_path / ("x" * 5000), InputError, "too long"),
        ("a\0b.ply", InputError, "null"),
        (17.5, InputError, "float"),
        (None, InputError, "NoneType"),
        (tmp_path / "empty.ply", FileFormatError, "empty"),
    ]:
        with pytest.raises(error, match=words):
            surfel.io.read(path, as_)
        with pytest.raises(error, match=words):
            surfel.io.info(path)
    with pytest.raises(InputError, match="as_"):
        surfel.io.read(tmp_path / "a.ply", as_="cloud")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="everything is readable for root")
def test_a_file_that_may_not_be_read(tmp_path):
    surfel.io.write(tmp_path / "a.ply", CORNERS)
    os.chmod(tmp_path / "a.ply", 0)
    with pytest.raises(InputError, match="Permission"):
        surfel.io.read(tmp_path / "a.ply")


def test_paths_may_be_text_bytes_or_path_and_hold_anything(tmp_path):
    name = tmp_path / "a 'b' ü.XYZ.PLY"
    surfel.io.write(str(name), CORNERS)
    for path in (name, str(name), os.fsencode(name)):
        assert len(surfel.io.read(path)) == 4


def test_the_beginning_decides_then_the_suffix(tmp_path):
    surfel.io.write(tmp_path / "a.ply", CORNERS)
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.ply").read_bytes())
    (tmp_path / "noname").write_bytes((tmp_path / "a.ply").read_bytes())
    for name in ("a.npy", "noname"):
        cloud = surfel.io.read(tmp_path / name)
        assert len(cloud) == 4 and cloud.provenance["format"] == "ply" and "read as ply" in cloud.provenance["notes"][0]
    (tmp_path / "b.ply").write_text("1 2 3\n")
    with pytest.raises(FileFormatError, match="instead of 'ply'"):
        surfel.io.read(tmp_path / "b.ply")


def test_rows_that_are_not_finite_are_dropped_and_counted(tmp_path):
    (tmp_path / "a.xyz").write_text("1 2 3\nnan 0 0\n4 5 6\n0 inf 0\n")
    cloud = surfel.io.read(tmp_path / "a.xyz")
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.provenance["non_finite"] == 2 and "2 points that are not finite" in cloud.provenance["notes"][0]
    told = surfel.io.info(tmp_path / "a.xyz", full=True)
    assert (told["points"], told["non_finite"], told["bounds"]) == (4, 2, [[1, 2, 3], [4, 5, 6]])
    report = surfel.io.convert(tmp_path / "a.xyz", tmp_path / "b.ply")
    assert (report["points"], report["non_finite"]) == (2, 2)


def test_triangles_at_points_that_are_not_finite_go_with_them(tmp_path):
    (tmp_path / "a.off").write_text("OFF\n5 3 0\nnan 0 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 1 2 3\n3 0 1 2\n3 2 3 4\n")
    mesh = surfel.io.read(tmp_path / "a.off")
    assert mesh.vertices.tolist() == CORNERS.tolist() and mesh.triangles.tolist() == [[0, 1, 2], [1, 2, 3]]


def test_a_mesh_as_points_has_area_weighted_normals(tmp_path):
    mesh = Mesh(np.vstack([CORNERS, [9, 9, 9]]), FACES)
    surfel.io.write(tmp_path / "a.ply", mesh)
    cloud = surfel.io.read(tmp_path / "a.ply", as_="points")
    points, normals = mesh.vertex_points()
    np.testing.assert_array_equal(cloud.points, points)
    np.testing.assert_allclose(cloud.normals, normals, atol=1e-15)
    assert len(cloud) == 4 and any("no triangle uses" in note for note in cloud.provenance["notes"])
    surfel.io.write(tmp_path / "b.ply", cloud)
    with pytest.raises(InputError, match="no faces"):
        surfel.io.read(tmp_path / "b.ply", as_="mesh")


def test_largest_numbers(tmp_path):
    largest = np.finfo(np.float64).max
    for name in ("a.ply", "a.xyz", "a.npy", "a.npz", "a.obj", "a.off"):
        surfel.io.write(tmp_path / name, np.diag([largest, -largest, 5e-324]))
        cloud = surfel.io.read(tmp_path / name)
        np.testing.assert_array_equal(cloud.points, np.diag([largest, -largest, 5e-324]))
        surfel.io.info(tmp_path / name, full=True)


def test_info_full_against_counting(tmp_path):
    points = RNG.random((60, 3))
    cloud = np.vstack([points, points[:7], points[:2]])
    surfel.io.write(tmp_path / "a.ply", Surfels(cloud, cloud + 1))
    told = surfel.io.info(tmp_path / "a.ply", full=True)
    distances = np.linalg.norm(points[:, None] - points[None], axis=2) + np.diag([np.inf] * 60)
    assert told["spacing"] == pytest.approx(np.median(distances.min(axis=1)), rel=1e-12)
    assert (told["duplicates"], told["non_finite"], told["points"], told["normals"]) == (9, 0, 69, True)
    assert told["bounds"] == [points.min(axis=0).tolist(), points.max(axis=0).tolist()]
    assert json.loads(json.dumps(told)) == told
    for few in (np.empty((0, 3)), CORNERS[:1], CORNERS[[0, 0]]):
        surfel.io.write(tmp_path / "b.ply", few)
        told = surfel.io.info(tmp_path / "b.ply", full=True)
        assert told["spacing"] is None and told["points"] == len(few)
        assert (told["bounds"] is None) == (len(few) == 0)


def test_convert_keeps_what_the_target_holds_and_lists_the_rest(tmp_path):
    cloud = Surfels(
        RNG.random((5, 3)), RNG.random((5, 3)), RNG.random(5), np.ones((5, 3), np.uint8), {"intensity": np.arange(5)}
    )
    surfel.io.write(tmp_path / "a.ply", cloud)
    lost = {
        n: surfel.io.convert(tmp_path / "a.ply", tmp_path / n)["lost"]
        for n in ("b.ply", "b.npz", "b.csv", "b.npy", "b.off")
    }
    assert lost["b.ply"] == lost["b.npz"] == lost["b.csv"] == []
    assert lost["b.npy"] == lost["b.off"] == ["radii of 5 points", "colors of 5 points", "attribute 'intensity'"]
    for name in ("b.ply", "b.npz", "b.csv"):
        again = surfel.io.read(tmp_path / name)
        assert again.attributes["intensity"].tolist() == [0, 1, 2, 3, 4] and (again.colors == 1).all()
    with pytest.raises(InputError, match="holds no points"):
        surfel.io.convert(tmp_path / "a.ply", tmp_path / "b.stl")
    with pytest.raises(InputError, match="no faces"):
        surfel.io.convert(tmp_path / "a.ply", tmp_path / "c.ply", as_="mesh")


def test_convert_of_a_mesh(tmp_path):
    surfel.io.write(tmp_path / "a.ply", Mesh(CORNERS, FACES, colors=np.full((4, 3), 7, np.uint8)))
    report = surfel.io.convert(tmp_path / "a.ply", tmp_path / "b.ply")
    assert (report["points"], report["triangles"], report["lost"]) == (4, 4, [])
    assert b"red" in (tmp_path / "b.ply").read_bytes()
    report = surfel.io.convert(tmp_path / "a.ply", tmp_path / "b.xyz")
    assert report["lost"] == ["4 triangles"] and report["triangles"] == 0
    report = surfel.io.convert(tmp_path / "a.ply", tmp_path / "c.ply", as_="points")
    assert report["triangles"] == 0 and report["lost"] == []
    assert surfel.io.info(tmp_path / "c.ply")["normals"]


def test_a_failed_conversion_leaves_the_target_alone(tmp_path):
    (tmp_path / "a.ply").write_bytes(b"ply\n")
    (tmp_path / "b.ply").write_bytes(b"old")
    with pytest.raises(FileFormatError):
        surfel.io.convert(tmp_path / "a.ply", tmp_path / "b.ply")
    assert (tmp_path / "b.ply").read_bytes() == b"old" and len(os.listdir(tmp_path)) == 2


def test_a_file_converted_onto_itself(tmp_path):
    surfel.io.write(tmp_path / "a.ply", CORNERS, ascii=True)
    surfel.io.convert(tmp_path / "a.ply", tmp_path / "a.ply")
    assert surfel.io.read(tmp_path / "a.ply").points.tolist() == CORNERS.tolist()


def test_things_that_cannot_be_written(tmp_path):
    for thing in ("text", 3, None, {}, np.zeros((3, 2)), [[1, 2, np.nan]], lambda: 0):
        with pytest.raises(InputError):
            surfel.io.write(tmp_path / "a.ply", thing)
    for name in ("a.unknown", "a", "a.png"):
        with pytest.raises(InputError, match="suffix"):
            surfel.io.write(tmp_path / name, CORNERS)
    assert os.listdir(tmp_path) == []


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_from_a_pipe(tmp_path):
    surfel.io.write(tmp_path / "a.ply", CORNERS)
    os.mkfifo(tmp_path / "pipe.ply")
    feeder = threading.Thread(target=lambda: (tmp_path / "pipe.ply").write_bytes((tmp_path / "a.ply").read_bytes()))
    feeder.start()
    assert surfel.io.read(tmp_path / "pipe.ply").points.tolist() == CORNERS.tolist()
    feeder.join()


def test_a_room_above_brings_a_format_of_its_own(tmp_path, monkeypatch):
    import types

    monkeypatch.setattr("surfel.io.registry._FORMATS", dict(_FORMATS))
    module = types.ModuleType("a_test_loader")
    shape = Mesh(CORNERS, FACES)
    module.load = lambda source: shape
    monkeypatch.setitem(sys.modules, "a_test_loader", module)
    register(Format("tree", (".tree",), "a_test_loader"))
    (tmp_path / "a.tree").write_text("union")
    assert surfel.io.read(tmp_path / "a.tree") is shape
    assert surfel.io.info(tmp_path / "a.tree")["format"] == "tree"
    with pytest.raises(InputError, match="not one that is written"):
        surfel.io.write(tmp_path / "b.tree", CORNERS)
    with pytest.raises(InputError, match="belongs to"):
        register(Format("other", (".ply",), "a_test_loader"))


def test_the_registry_imports_nothing_heavy():
    program = (
        "import sys, surfel.io; heavy = {'numba', 'scipy', 'trimesh', 'surfel.io.ply', 'surfel.shapes.surfels'}; "
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("path", [None, 5, surfel.Surfels(np.zeros((3, 3)))])
def test_what_is_no_file_name_cannot_be_written_to(tmp_path, path):
    with pytest.raises(InputError, match="path must be a file name; got"):
        surfel.write(path, surfel.Surfels(np.zeros((3, 3))))
    surfel.write(tmp_path / "a.ply", np.zeros((3, 3)))
    with pytest.raises(InputError, match="path must be a file name; got"):
        surfel.convert(tmp_path / "a.ply", path)
