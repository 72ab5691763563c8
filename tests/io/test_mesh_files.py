"""OBJ, OFF, STL and GLB against trimesh, and what each has of its own."""

from __future__ import annotations

import json
import struct
import warnings

import numpy as np
import pytest

import surfel.io
from surfel.core.errors import FileFormatError, InputError, SurfelWarning
from surfel.io.source import open_source
from surfel.shapes.mesh import Mesh

trimesh = pytest.importorskip("trimesh")


def loaded(path):
    with open_source(path) as source:
        found, _ = surfel.io.registry.format_for_reading(source)
        return found.codec.load(source)


def soup(mesh) -> np.ndarray:
    """The corners of all triangles: what a mesh is, whatever its vertices are called."""
    vertices, faces = (mesh.vertices, mesh.triangles) if isinstance(mesh, Mesh) else (mesh.vertices, mesh.faces)
    return np.asarray(vertices)[np.asarray(faces)]


@pytest.fixture(scope="module")
def bumpy():
    mesh = trimesh.creation.icosphere(subdivisions=3)
    mesh.vertices = mesh.vertices * (1 + 0.1 * np.random.default_rng(0).random((len(mesh.vertices), 1)))
    return mesh


@pytest.mark.parametrize("suffix", ["ply", "obj", "off", "stl", "stl_ascii", "glb"])
def test_written_by_trimesh_read_by_us(tmp_path, bumpy, suffix):
    path = tmp_path / f"with blank and ü.{suffix.split('_')[0]}"
    data = bumpy.export(file_type=suffix)
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    mesh = surfel.io.read(path)
    np.testing.assert_allclose(soup(mesh), soup(bumpy), atol=1e-6)
    theirs = trimesh.load(path, process=False, force="mesh")
    np.testing.assert_allclose(soup(mesh), soup(theirs), rtol=0, atol=1e-8)
    assert mesh.closed and len(mesh.vertices) == len(bumpy.vertices)


@pytest.mark.parametrize("ascii", [False, True])
@pytest.mark.parametrize("suffix", ["ply", "obj", "off", "stl", "glb"])
def test_written_by_us_read_by_trimesh_and_by_us(tmp_path, bumpy, suffix, ascii):
    mesh = Mesh(bumpy.vertices, bumpy.faces)
    path = tmp_path / f"a.{suffix}"
    single = suffix == "glb" or (suffix == "stl" and not ascii)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        surfel.io.write(path, mesh, ascii=ascii)
    assert [w.category for w in caught] == ([SurfelWarning] if single else [])
    np.testing.assert_allclose(soup(trimesh.load(path, process=False, force="mesh")), soup(mesh), atol=1e-6)
    again = surfel.io.read(path)
    np.testing.assert_array_equal(soup(again), soup(mesh).astype(np.float32) if single else soup(mesh))
    assert surfel.io.info(path)["triangles"] == len(mesh.triangles)


OBJ = """# comment
mtllib a.mtl
o thing
v 0 0 0
v 1 0 0 # behind
  v 1 1 0
v 0 1 0
v 0 0 1 1.0
vt 0 0
vn 0 0 1
s off
usemtl red
f 1 2 3 4
f 1/1 2/1 5/1
f -5//1 -4//1 -1//-1
f 1/1/1 2/1/1 \\
  3/1/1
l 1 2
"""


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_obj_in_all_its_spellings(tmp_path, ending):
    (tmp_path / "a.obj").write_bytes(OBJ.replace("\n", ending).encode())
    content = loaded(tmp_path / "a.obj")
    assert content.points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1]]
    assert content.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 4], [0, 1, 4], [0, 1, 2]]
    assert len(content.notes) == 3


def test_obj_of_points(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0 1 0.5 0\nvn 0 0 2\nv 1 1 1 0 0 0\nvn 1 0 0\n")
    cloud = surfel.io.read(tmp_path / "a.obj")
    assert cloud.normals.tolist() == [[0, 0, 1], [1, 0, 0]] and cloud.colors.tolist() == [[1, 0.5, 0], [0, 0, 0]]
    surfel.io.write(tmp_path / "b.obj", cloud)
    assert (surfel.io.read(tmp_path / "b.obj").colors == cloud.colors).all()


V = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    "text,place",
    [
        (V + "f 1 2 4\n", "face 0"), (V + "f 1 2 3\nf 1 2 -4\n", "face 1"), (V + "f 0 1 2\n", "line 4"),
        (V + "f 1 2\n", "line 4"), (V + "f 1 2 x\n", "line 4"), (V + "f 1 2 3/\n", "line 4"),
        (V + "f 1/1/1/1 2 3\n", "line 4"), (V + "f 1 2 3.0\n", "line 4"), (V + "v 1 2\n", "line 4"),
        (V + "v 1 2 z\n", "line 4"), (V + "v 1 2 3 4 5 6 7 8\n", "line 4"), (V + "vn 1 2 3 4\n", "line 4"),
        (V + "vx 1 2 3\n", "line 4"), (V + "hello\n", "line 4"), (V + "f 1 2 99999999999999999999\n", "line 4"),
        ("# nothing\n", "whole file"), ("\x00\x01", "line 1"),
    ],
)  # fmt: skip
def test_obj_refused(tmp_path, text, place):
    (tmp_path / "a.obj").write_text(text)
    with pytest.raises(FileFormatError) as caught:
        loaded(tmp_path / "a.obj")
    assert place in caught.value.place


FOUR = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


@pytest.mark.parametrize(
    "text",
    [
        "OFF\n4 2 0\n" + FOUR + "3 0 1 2\n3 0 2 3\n",
        "OFF 4 1 0\n" + FOUR + "4 0 1 2 3\n",
        "# c\nOFF\n# c\n4 1\n\n" + FOUR.replace("\n", " # c\n") + "4 0 1 2 3  0.5 0.5 0.5\n# end\n\n",
        "OFF\r\n4 1 0\r\n" + FOUR.replace("\n", "\r\n") + "4 0 1 2 3\r\n",
        "COFF\n4 1 0\n" + FOUR.replace("\n", " 255 0 9 255\n") + "4 0 1 2 3\n",
        "NOFF\n4 1 0\n" + FOUR.replace("\n", " 0 0 1\n") + "4 0 1 2 3 7 7 7\n",
    ],
)
def test_off_in_all_its_spellings(tmp_path, text):
    (tmp_path / "a.off").write_bytes(text.encode())
    content = loaded(tmp_path / "a.off")
    assert content.points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert content.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert (content.colors is not None) == text.startswith("COFF")
    assert (content.normals is not None) == text.startswith("NOFF")


@pytest.mark.parametrize(
    "text",
    [
        "OFF\n5 1 0\n" + FOUR + "4 0 1 2 3\n", "OFF\n3 1 0\n" + FOUR + "4 0 1 2 3\n",
        "OFF\n4 2 0\n" + FOUR + "4 0 1 2 3\n",
        "OFF\n4 0 0\n" + FOUR + "4 0 1 2 3\n", "OFF\n4 1 0\n" + FOUR + "4 0 1 2 4\n",
        "OFF\n4 1 0\n" + FOUR + "4 0 1 2 -1\n",
        "OFF\n4 1 0\n" + FOUR + "4 0 1 2\n", "OFF\n4.5 1 0\n" + FOUR, "OFF\n-4 1 0\n" + FOUR, "OFF\n4 1e15 0\n" + FOUR,
        "OFF\n999999999999 1 0\n" + FOUR, "OFF BINARY\n4 1 0\n", "4OFF\n", "OFF\n", "OFF\n4 1 0\n0 0\n",
    ],
)  # fmt: skip
def test_off_refused(tmp_path, text):
    (tmp_path / "a.off").write_text(text)
    with pytest.raises(FileFormatError):
        loaded(tmp_path / "a.off")


def test_stl_that_begins_with_solid_but_is_binary(tmp_path):
    facet = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
    (tmp_path / "a.stl").write_bytes(b"solid facet".ljust(80) + (2).to_bytes(4, "little") + facet * 2)
    content = loaded(tmp_path / "a.stl")
    assert content.triangles.tolist() == [[0, 1, 2]] * 2 and len(content.points) == 3


TEXT = (
    "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n"
)


def test_stl_of_several_solids(tmp_path):
    (tmp_path / "a.stl").write_text(TEXT + TEXT.upper().replace("\n", "\r\n"))
    assert loaded(tmp_path / "a.stl").triangles.tolist() == [[0, 1, 2]] * 2


@pytest.mark.parametrize(
    "old,new",
    [("vertex 0 0 0", "vertex 0 0"), ("vertex 0 0 0", "vertex 0 0 x"), ("endloop", "endlop"), ("endsolid a\n", ""),
     ("endfacet\n", ""), ("solid a\nf", "solid a\n1\nf"), ("solid a\nfacet", "solid a\nfacet normal 0 0 1\nfacet")],
)  # fmt: skip
def test_text_stl_refused(tmp_path, old, new):
    assert old in TEXT
    (tmp_path / "a.stl").write_text(TEXT.replace(old, new, 1))
    with pytest.raises(FileFormatError):
        loaded(tmp_path / "a.stl")


def test_glb_scene_with_transforms_and_a_mirror(tmp_path):
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.1, 0.2, 0.3])
    mirror = np.diag([2, -1, 0.5, 1.0])
    scene.add_geometry(trimesh.creation.icosphere(subdivisions=1), transform=turn @ mirror)
    box = trimesh.creation.box()
    scene.add_geometry(box, transform=turn, geom_name="box")
    scene.add_geometry(box, transform=mirror, geom_name="again")
    (tmp_path / "a.glb").write_bytes(scene.export(file_type="glb"))
    mesh = surfel.io.read(tmp_path / "a.glb")
    theirs = trimesh.load(tmp_path / "a.glb", process=False, force="mesh")
    assert mesh.area == pytest.approx(theirs.area, rel=1e-9) and mesh.volume == pytest.approx(theirs.volume, rel=1e-9)
    assert not mesh.inverted


def glb(document: dict, binary: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def described(**changes) -> dict:
    document = {
        "asset": {"version": "2.0"}, "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 4}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36}],
    }  # fmt: skip
    return document | changes


TRIANGLE = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)


def test_glb_by_hand(tmp_path):
    turned = {"mesh": 0, "rotation": [0, 0, 2**-0.5, 2**-0.5], "translation": [5, 0, 0], "scale": [2, 2, 2]}
    (tmp_path / "a.glb").write_bytes(glb(described(nodes=[turned]), TRIANGLE))
    np.testing.assert_allclose(loaded(tmp_path / "a.glb").points, [[5, 0, 0], [5, 2, 0], [3, 0, 0]], atol=1e-12)


@pytest.mark.parametrize(
    "changes",
    [
        {"nodes": [{"mesh": 1}]}, {"nodes": [{"mesh": -1}]}, {"nodes": [{"children": [0]}], "scenes": [{"nodes": [0]}]},
        {"nodes": [{"mesh": 0}] * 2, "scenes": [{"nodes": [0, 0]}]}, {"nodes": [{"mesh": 0, "matrix": [1]}]},
        {"nodes": [{"mesh": 0, "scale": [1e999, 1, 1]}]}, {"nodes": 3}, {"meshes": [{}]}, {"meshes": None},
        {"accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}]},
        {"accessors": [{"bufferView": 0, "componentType": 5126, "count": 10**18, "type": "VEC3"}]},
        {"accessors": [{"bufferView": 0, "componentType": 5126, "count": -1, "type": "VEC3"}]},
        {"accessors": [{"componentType": 5126, "count": 10**9, "type": "VEC3"}]},
        {"accessors": [{"bufferView": 0, "componentType": 1, "count": 3, "type": "VEC3"}]},
        {"bufferViews": [{"buffer": 0, "byteLength": 99}]},
        {"bufferViews": [{"buffer": 0, "byteLength": 36, "byteStride": 1}]},
        {"buffers": [{"uri": "other.bin", "byteLength": 36}]}, {"extensionsRequired": ["KHR_draco_mesh_compression"]},
        {"nodes": [{"mesh": 0, "children": [i + 1]} for i in range(5)]}, {"nodes": []},
    ],
)  # fmt: skip
def test_glb_refused(tmp_path, changes):
    (tmp_path / "a.glb").write_bytes(glb(described(**changes), TRIANGLE))
    with pytest.raises(FileFormatError):
        loaded(tmp_path / "a.glb")


def test_what_a_format_cannot_hold_at_all_is_refused(tmp_path, bumpy):
    mesh = Mesh(bumpy.vertices, bumpy.faces)
    for name, thing in [("a.xyz", mesh), ("a.npy", mesh), ("a.stl", np.eye(3)), ("a.glb", np.eye(3))]:
        with pytest.raises(InputError, match="holds no"):
            surfel.io.write(tmp_path / name, thing)
    for name in ("b.stl", "b.glb"):
        with pytest.raises(InputError, match="single precision"):
            surfel.io.write(tmp_path / name, Mesh(np.eye(3) * 1e39, [[0, 1, 2]]))
    assert list(tmp_path.iterdir()) == []
