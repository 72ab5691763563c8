"""Tables of points: what is sniffed, what is refused, and that nothing is lost on the way."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import surfel.io
from surfel.core.errors import FileFormatError, InputError
from surfel.io.source import open_source
from surfel.io.text import load
from surfel.shapes.surfels import Surfels


def loaded(tmp_path, text: str | bytes, name="a.xyz"):
    (tmp_path / name).write_bytes(text.encode() if isinstance(text, str) else text)
    with open_source(tmp_path / name) as source:
        return load(source)


POINTS = [[1.5, -2, 3e2], [4, 5, 6]]


@pytest.mark.parametrize(
    "text",
    [
        "1.5 -2 3e2\n4 5 6\n",
        "1.5 -2 3e2\n4 5 6",
        "1.5\t-2\t3e2\r\n4\t5\t6\r\n",
        "1.5 -2 3e2\r4 5 6\r",
        "1.5,-2,3e2\n4,5,6\n",
        " 1.5 , -2 , 3e2 ,\n4, 5, 6,\n",
        "1.5;-2;300\n4;5;6\n",
        "1,5;-2,0;300\n4;5;6,0\n",
        "\ufeff1.5 -2 3e2\n\n\n4 5 6\n\n",
        "# a comment\n// another\n1.5 -2 3e2 # behind\n# between\n4 5 6 // too\n",
        "2\n1.5 -2 3e2\n4 5 6\n",
        "x y z\n1.5 -2 3e2\n4 5 6\n",
        '"X","Y","Z"\n1.5,-2,3e2\n4,5,6\n',
        "//X Y Z\n2\n1.5 -2 3e2\n4 5 6\n",
        "z;x;y\n300;1.5;-2\n6;4;5\n",
        "# 7 points, measured on Monday\n1.5 -2 3e2\n4 5 6\n",
    ],
)
def test_delimiters_headers_comments_counts(tmp_path, text):
    content = loaded(tmp_path, text)
    assert content.points.tolist() == POINTS
    assert content.normals is None and content.colors is None and not content.attributes


@pytest.mark.parametrize(
    "row,normals,colors,attributes",
    [
        ("0 0 1", [[0, 0, 1]] * 2, None, {}),
        ("12 0 255", None, [[12, 0, 255]] * 2, {}),
        ("0.5", None, None, {"intensity": 0.5}),
        ("0.5 1 2 3", None, [[1, 2, 3]] * 2, {"intensity": 0.5}),
        ("7 8 9 0 -1 0", [[0, -1, 0]] * 2, [[7, 8, 9]] * 2, {}),
        ("0 -1 0 7 8 9", [[0, -1, 0]] * 2, [[7, 8, 9]] * 2, {}),
        ("0 -1 0 0.5 0 0", [[0, -1, 0]] * 2, None, {"column_7": 0.5, "column_8": 0, "column_9": 0}),
        ("1 2", None, None, {"column_4": 1, "column_5": 2}),
    ],
)
def test_the_rule_for_nameless_columns(tmp_path, row, normals, colors, attributes):
    content = loaded(tmp_path, f"1 2 3 {row}\n4 5 6 {row}\n")
    assert content.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert (content.normals is None) == (normals is None) and (content.colors is None) == (colors is None)
    if normals:
        assert content.normals.tolist() == normals
    if colors:
        assert content.colors.tolist() == colors and content.colors.dtype == np.uint8
    assert {name: values[0] for name, values in content.attributes.items()} == attributes


def test_named_columns_of_every_kind(tmp_path):
    head = "Intensity,NX,NY,NZ,R,G,B,X,Y,Z,radius,my value\n"
    content = loaded(tmp_path, head + "9,0,0,1,1,2,300,1,2,3,0.5,7\n", "a.csv")
    assert content.points.tolist() == [[1, 2, 3]] and content.normals.tolist() == [[0, 0, 1]]
    assert content.colors.tolist() == [[1, 2, 300]] and content.colors.dtype == np.uint16
    assert content.radii.tolist() == [0.5]
    assert {k: v.tolist() for k, v in content.attributes.items()} == {"intensity": [9], "my value": [7]}


@pytest.mark.parametrize(
    "text,place",
    [
        ("1 2\n3 4\n", "line 1"),
        ("1 2 3\n4 5\n", "line 2"),
        ("1 2 3\n4 5 6 7\n", "line 2"),
        ("1 2 3\n\n4 x 6\n", "line 3"),
        ("1,2,3\n4,,6\n", "line 2"),
        ("1,2,3\n4;5;6\n", "line 2"),
        ("3\n1 2 3\n4 5 6\n", "line 3"),
        ("1\n1 2 3\n4 5 6\n", "line 3"),
        ("5\n", "last line"),
        ("\n \n", "last line"),
        ("# nothing\n", "last line"),
        ("once upon a time\n", "line 1"),
        ("x y z label\n1 2 3 cat\n", "line 2"),
        ("1 2 3\n\x00\x00\n", "byte 6"),
        ("1 2 3\n".encode("utf-16"), "byte"),
        (b"\xff" * 100, "line 1"),
    ],
)
def test_refused_at_its_place(tmp_path, text, place):
    with pytest.raises(FileFormatError) as caught:
        loaded(tmp_path, text)
    assert place in caught.value.place and caught.value.cure


@settings(max_examples=40)
@given(
    st.data(),
    st.integers(1, 4),
    st.booleans(),
    st.booleans(),
    st.booleans(),
    st.sampled_from([".xyz", ".csv", ".txt", ".asc"]),
)
def test_round_trip(tmp_path_factory, data, n, normals, radii, colors, suffix):
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    number = st.floats(allow_nan=False, allow_infinity=False)
    cloud = Surfels(
        np.array([[data.draw(number) for _ in range(3)] for _ in range(n)]),
        rng.normal(size=(n, 3)) if normals else None,
        rng.random(n) if radii else None,
        rng.integers(0, 256, (n, 3)).astype(np.uint8) if colors else None,
        {"a": rng.normal(size=n), "b": rng.integers(-9, 9, n)},
    )
    path = tmp_path_factory.mktemp("text") / f"with blank and ü{suffix}"
    surfel.io.write(path, cloud)
    with open_source(path) as source:
        content = load(source)
    np.testing.assert_array_equal(content.points, cloud.points)
    np.testing.assert_array_equal(content.points.view(np.uint64), cloud.points.view(np.uint64))
    for name in ("normals", "radii", "colors"):
        expected, found = getattr(cloud, name), getattr(content, name)
        assert (expected is None) == (found is None)
        if expected is not None:
            np.testing.assert_array_equal(found, expected)
    for name in "ab":
        np.testing.assert_array_equal(content.attributes[name], cloud.attributes[name])


def test_points_alone_are_written_without_a_header(tmp_path):
    surfel.io.write(tmp_path / "a.xyz", POINTS)
    assert (tmp_path / "a.xyz").read_text() == "1.5 -2.0 300.0\n4.0 5.0 6.0\n"
    surfel.io.write(tmp_path / "a.csv", POINTS)
    assert (tmp_path / "a.csv").read_text() == "x,y,z\n1.5,-2.0,300.0\n4.0,5.0,6.0\n"


def test_no_points_are_not_written_as_text(tmp_path):
    for name in ("a.xyz", "a.obj"):
        with pytest.raises(InputError, match="no points"):
            surfel.io.write(tmp_path / name, np.empty((0, 3)))
        assert not (tmp_path / name).exists()


def test_against_numpy(tmp_path):
    table = np.random.default_rng(0).normal(size=(3000, 6)) * 10.0 ** np.random.default_rng(1).integers(
        -20, 20, (3000, 6)
    )
    np.savetxt(tmp_path / "a.txt", table, fmt="%.12g")
    expected = np.loadtxt(tmp_path / "a.txt")
    content = loaded(tmp_path, (tmp_path / "a.txt").read_bytes())
    np.testing.assert_array_equal(content.points, expected[:, :3])
    np.testing.assert_array_equal(content.normals, expected[:, 3:])
