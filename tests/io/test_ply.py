"""PLY: every type, order and encoding, against files written field by field in the test."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import surfel.io
from surfel.core.errors import FileFormatError
from surfel.io.content import Content
from surfel.io.ply import load, save
from surfel.io.source import open_source
from surfel.shapes.mesh import Mesh
from surfel.shapes.surfels import Surfels

LETTERS = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
    "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip
ENCODINGS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def loaded(path) -> Content:
    with open_source(path) as source:
        return load(source)


def values_of(kind: str) -> st.SearchStrategy:
    letter = LETTERS[kind]
    if letter in "fd":
        return st.floats(width=32 if letter == "f" else 64, allow_nan=False)
    info = np.iinfo(np.dtype(letter))
    return st.integers(int(info.min), int(info.max))


@st.composite
def vertex_files(draw):
    """Draw the bytes of a PLY file with vertices only, and what was put into each property."""
    encoding = draw(st.sampled_from(sorted(ENCODINGS)))
    real = st.sampled_from(["float", "float32", "double", "float64", "int", "short"])
    kinds = {name: draw(real) for name in "xyz"}
    for i in range(draw(st.integers(0, 4))):
        kinds[f"extra{i}"] = draw(st.sampled_from(sorted(LETTERS)))
    names = draw(st.permutations(sorted(kinds)))
    count = draw(st.integers(0, 6))
    rows = [[draw(values_of(kinds[name])) for name in names] for _ in range(count)]
    ending = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    header = ["ply", f"format {encoding} 1.0", "comment of a test", f"element vertex {count}"]
    header += [f"property {kinds[name]} {name}" for name in names] + ["end_header", ""]
    if encoding == "ascii":
        body = "".join(" ".join(map(repr, row)) + draw(st.sampled_from(["", " "])) + ending for row in rows).encode()
    else:
        body = b"".join(
            struct.pack(ENCODINGS[encoding] + "".join(LETTERS[kinds[n]] for n in names), *row) for row in rows
        )
    return ending.join(header).encode() + body, names, kinds, rows


@settings(max_examples=100)
@given(vertex_files())
def test_all_types_orders_and_encodings(tmp_path_factory, drawn):
    data, names, kinds, rows = drawn
    path = tmp_path_factory.mktemp("ply") / "a.ply"
    path.write_bytes(data)
    content = loaded(path)
    for i, name in enumerate(names):
        expected = np.array([row[i] for row in rows], np.dtype(LETTERS[kinds[name]]))
        if name in "xyz":
            np.testing.assert_array_equal(content.points[:, "xyz".index(name)], expected.astype(np.float64))
        else:
            assert content.attributes[name].dtype == expected.dtype
            np.testing.assert_array_equal(content.attributes[name], expected)


KINDS = ["f4", "f8", "u1", "i1", "u2", "i2", "u4", "i4", "i8", "?"]


@settings(max_examples=60)
@given(
    st.data(),
    st.integers(0, 9),
    st.booleans(),
    st.booleans(),
    st.booleans(),
    st.sampled_from([None, 3, 4]),
    st.booleans(),
)
def test_round_trip_of_everything(tmp_path_factory, data, n, text, normals, radii, colors, faces):
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    point = st.floats(allow_nan=False, allow_infinity=False)
    points = np.array([[data.draw(point) for _ in range(3)] for _ in range(n)]).reshape(n, 3)
    attributes = {}
    for kind in data.draw(st.lists(st.sampled_from(KINDS), max_size=4, unique=True)):
        shape = data.draw(st.sampled_from([(n,), (n, 1), (n, 3)]))
        attributes["a_" + kind.replace("?", "b1")] = (rng.normal(size=shape) * 50).astype(kind)
    before = Content(
        points,
        rng.integers(0, n, (4, 3)) if faces and n else None,
        rng.normal(size=(n, 3)) if normals else None,
        rng.random(n) if radii else None,
        rng.integers(0, 256, (n, colors)).astype(np.uint8) if colors else None,
        attributes,
    )
    path = tmp_path_factory.mktemp("ply") / "a.ply"
    with open(path, "wb") as stream:
        assert save(stream, before, ascii=text) == []
    after = loaded(path)
    for name in ("points", "triangles", "normals", "radii", "colors"):
        expected, found = getattr(before, name), getattr(after, name)
        assert (expected is None) == (found is None), name
        if expected is not None:
            np.testing.assert_array_equal(found, expected, err_msg=name)
            assert found.dtype == expected.dtype
    for name, values in attributes.items():
        flat = values.reshape(n, 3 if values.ndim == 2 and values.shape[1] == 3 else 1)
        for i in range(flat.shape[1]):
            np.testing.assert_array_equal(after.attributes[name if values.ndim == 1 else f"{name}_{i}"], flat[:, i])


@pytest.mark.parametrize("order", ["", "<", ">"])
@pytest.mark.parametrize("mixed", [True, False])
def test_lists_polygons_strips_and_further_elements(tmp_path, make_ply, order, mixed):
    path = tmp_path / "with blank and ü.ply"
    path.write_bytes(make_ply(order, mixed))
    content = loaded(path)
    np.testing.assert_allclose(content.points, [(0.1 * i, i * i - 1.5, 0.25 * i) for i in range(5)], rtol=1e-15)
    np.testing.assert_array_equal(content.colors, [(i, 2 * i, 255 - i) for i in range(5)])
    assert content.colors.dtype == np.uint8 and content.attributes["tag"].dtype == np.int16
    np.testing.assert_array_equal(content.attributes["tag"], -np.arange(5))
    polygons = [[0, 1, 2], [0, 2, 3], [2, 3, 4]] if mixed else [[0, 1, 2], [2, 3, 4]]
    assert content.triangles.tolist() == [*polygons, [0, 1, 2], [2, 1, 3], [2, 3, 4]]
    assert any("camera" in note for note in content.notes) and any("ring" in note for note in content.notes)


@pytest.mark.parametrize(
    "counts,items", [("char", "char"), ("uint8", "ushort"), ("int", "int8"), ("uint", "int16"), ("short", "uint")]
)
@pytest.mark.parametrize("order", ["<", ">"])
def test_lists_of_every_type(tmp_path, counts, items, order):
    polygons = [[0, 1, 2], [3, 2, 1, 0], [], [0, 1], [1, 2, 3]]
    head = f"""ply\nformat {"binary_little_endian" if order == "<" else "binary_big_endian"} 1.0
element vertex 4\nproperty float x\nproperty float y\nproperty float z
element face 5\nproperty list {counts} {items} vertex_indices\nend_header\n"""
    body = struct.pack(order + "12f", *range(12))
    for p in polygons:
        body += struct.pack(f"{order}{LETTERS[counts]}{len(p)}{LETTERS[items]}", len(p), *p)
    (tmp_path / "a.ply").write_bytes(head.encode() + body)
    content = loaded(tmp_path / "a.ply")
    assert content.triangles.tolist() == [[0, 1, 2], [3, 2, 1], [3, 1, 0], [1, 2, 3]]
    assert any("fewer than three" in note for note in content.notes)


def test_many_triangles_in_blocks(tmp_path):
    rng = np.random.default_rng(0)
    mesh = Mesh(rng.normal(size=(70_000, 3)), rng.integers(0, 70_000, (90_000, 3)))
    surfel.io.write(tmp_path / "a.ply", mesh)
    again = surfel.io.read(tmp_path / "a.ply")
    np.testing.assert_array_equal(again.vertices, mesh.vertices)
    np.testing.assert_array_equal(again.triangles, mesh.triangles)


def test_one_polygon_far_behind_ends_the_view_of_equal_lengths(tmp_path):
    n = 40_000
    head = f"""ply\nformat binary_little_endian 1.0\nelement vertex 4
property float x\nproperty float y\nproperty float z
element face {n + 2}\nproperty list uchar int vertex_indices\nend_header\n"""
    body = struct.pack("<12f", *range(12)) + struct.pack("<B3i", 3, 0, 1, 2) * n + struct.pack("<B4i", 4, 0, 1, 2, 3)
    body += struct.pack("<B3i", 3, 1, 2, 3)
    (tmp_path / "a.ply").write_bytes(head.encode() + body)
    triangles = loaded(tmp_path / "a.ply").triangles
    assert len(triangles) == n + 3 and triangles[-3:].tolist() == [[0, 1, 2], [0, 2, 3], [1, 2, 3]]


HEAD = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 1\nproperty list uchar int vertex_indices\n"
BODY = "0 0 0\n1 1 1\n"


@pytest.mark.parametrize(
    "text,place",
    [
        ("plx\n" + HEAD, "byte 0"),
        (HEAD + BODY, "byte"),
        (HEAD.replace("ascii", "asci") + "end_header\n" + BODY, "line 2"),
        (HEAD.replace("1.0", "2.0") + "end_header\n" + BODY, "line 2"),
        (HEAD.replace("vertex 2", "vertex two") + "end_header\n" + BODY, "line 3"),
        (HEAD.replace("vertex 2", "vertex -2") + "end_header\n" + BODY, "line 3"),
        (HEAD.replace("float y", "flat y") + "end_header\n" + BODY, "line 5"),
        (HEAD.replace("float y", "float x") + "end_header\n" + BODY, "line 5"),
        (HEAD.replace("property float y\n", "") + "end_header\n0 0\n1 1\n", "header"),
        (HEAD.replace("format ascii 1.0\n", "") + "end_header\n" + BODY, "header"),
        (HEAD + HEAD[4:] + "end_header\n" + BODY, "line 7"),
        (HEAD + "nonsense here\nend_header\n" + BODY, "line 7"),
        (HEAD + FACE.replace("uchar int", "float int") + "end_header\n" + BODY + "3 0 1 1\n", "line 8"),
        (HEAD + "end_header\n" + BODY + "2 2 2\n", "line 10"),
        (HEAD + "end_header\n0 0 0\n1 1\n", "line 9, vertex 1"),
        (HEAD + "end_header\n0 0 0 0\n1 1 1\n", "line 8, vertex 0"),
        (HEAD + "end_header\n0 0 zero\n1 1 1\n", "line 8, vertex 0"),
        (HEAD + "end_header\n0 0 0\n", "vertex 1"),
        (HEAD + FACE + "end_header\n" + BODY + "3 0 1 2\n", "triangle 0"),
        (HEAD + FACE + "end_header\n" + BODY + "3 0 1 -1\n", "triangle 0"),
        (HEAD + FACE + "end_header\n" + BODY + "3 0 1 0.5\n", "line 12, face 0"),
        (HEAD + FACE + "end_header\n" + BODY + "4 0 1 1\n", "line 12, face 0"),
        (HEAD + FACE + "end_header\n" + BODY + "999999999 0 1 1\n", "line 12, face 0"),
        (HEAD.replace("float z", "float z\nproperty uchar red") + "end_header\n0 0 0 7\n1 1 1 256\n", "vertex 1"),
        ("ply\nformat ascii 1.0\nelement point 0\nend_header\n", "header"),
    ],
)  # fmt: skip
def test_a_lying_or_garbled_file_is_refused_at_its_place(tmp_path, text, place):
    (tmp_path / "a.ply").write_text(text)
    with pytest.raises(FileFormatError) as caught:
        loaded(tmp_path / "a.ply")
    assert place in caught.value.place and caught.value.cure and caught.value.path.endswith("a.ply")


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("element", ["vertex", "face", "other"])
def test_a_count_beyond_the_file_is_refused_before_memory_is_asked_for(tmp_path, encoding, element):
    import tracemalloc

    counts = {"vertex": 0, "face": 0, "other": 0} | {element: 4_000_000_000_000}
    head = f"""ply\nformat {encoding} 1.0\nelement vertex {counts["vertex"]}
property float x\nproperty float y\nproperty float z
element face {counts["face"]}\nproperty list uchar int vertex_indices
element other {counts["other"]}\nproperty float a\nend_header\n"""
    (tmp_path / "a.ply").write_bytes(head.encode() + b"1 " * 300)
    tracemalloc.start()
    with pytest.raises(FileFormatError):
        loaded(tmp_path / "a.ply")
    assert tracemalloc.get_traced_memory()[1] < 2**22
    tracemalloc.stop()


def test_what_ply_has_no_type_for_is_said(tmp_path):
    cloud = Surfels(
        np.eye(3), attributes={"word": np.array(["a", "b", "c"]), "big": np.array([2**60, 1, 2]), "a b": np.ones(3)}
    )
    with pytest.warns(surfel.SurfelWarning) as caught:
        surfel.io.write(tmp_path / "a.ply", cloud)
    message = str(caught[0].message)
    assert "word" in message and "big" in message and "a_b" in message
    assert set(surfel.io.read(tmp_path / "a.ply").attributes) == {"a_b"}


def test_ascii_and_binary_of_one_cloud_are_equal(tmp_path):
    cloud = Surfels(np.random.default_rng(1).normal(size=(5000, 3)) * 1e6)
    surfel.io.write(tmp_path / "a.ply", cloud, ascii=True)
    surfel.io.write(tmp_path / "b.ply", cloud)
    a, b = surfel.io.read(tmp_path / "a.ply"), surfel.io.read(tmp_path / "b.ply")
    np.testing.assert_array_equal(a.points, b.points)
    np.testing.assert_array_equal(a.points, cloud.points)
