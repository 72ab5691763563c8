"""PTS and PTX: counts, grids and poses in text."""

from __future__ import annotations

import io
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import surfel
from surfel.core.errors import FileFormatError, InputError
from surfel.io import pts, ptx
from surfel.io.content import Content, Head
from surfel.io.source import Source

RNG = np.random.default_rng(0)


def source_of(data: bytes) -> Source:
    return Source("a.pts", io.BytesIO(data), len(data))


def attempt(codec, text: str | bytes) -> Content | None:
    data = text.encode() if isinstance(text, str) else text
    try:
        content = codec.load(source_of(data))
    except FileFormatError as error:
        assert error.path == "a.pts" and error.place and error.cure
        with pytest.raises(FileFormatError):
            for _ in codec.chunks(source_of(data), 3):
                pass
        return None
    runs = list(codec.chunks(source_of(data), 3))
    assert max(len(run.points) for run in runs) <= 3
    np.testing.assert_array_equal(np.concatenate([run.points for run in runs]), content.points)
    assert {tuple(sorted(run.attributes)) for run in runs} == {tuple(sorted(content.attributes))}
    return content


def scan(columns: int, rows: int, points: np.ndarray, matrix: np.ndarray | None = None, place: str = "1 2 3") -> str:
    matrix = np.eye(4) if matrix is None else matrix

    def lines(table: np.ndarray) -> str:
        return "".join(" ".join(repr(float(x)) for x in row) + "\n" for row in table)

    return f"{columns}\n{rows}\n{place}\n1 0 0\n0 1 0\n0 0 1\n{lines(matrix)}{lines(points)}"


def test_a_file_as_a_scanner_writes_it():
    content = attempt(pts, "3\r\n1.5 2 3 -2048 0 128 255\r\n4 5 6 2047 1 2 3\r\n\r\n7 8 9 0 4 5 6\r\n")
    assert content.points.tolist() == [[1.5, 2, 3], [4, 5, 6], [7, 8, 9]]
    assert content.attributes["intensity"].tolist() == [-2048, 2047, 0]
    assert content.colors.dtype == np.uint8 and content.colors[0].tolist() == [0, 128, 255]


def test_several_scans_and_other_columns():
    content = attempt(pts, "2\n1 2 3 4\n5 6 7 8\n0\n1\n9 10 11 12\n")
    assert content.points[:, 0].tolist() == [1, 5, 9] and content.attributes["intensity"].tolist() == [4, 8, 12]
    assert attempt(pts, "1\n1 2 3\n").attributes == {}
    assert attempt(pts, "1\n1 2 3 0 0 1\n").colors.tolist() == [[0, 0, 1]]
    assert attempt(pts, "1\n1 2 3 0.25 0.5 1\n").colors.tolist() == [[0.25, 0.5, 1]]
    assert len(attempt(pts, "1 2 3\n4 5 6\n7 8 9\n10 11 12\n").points) == 4  # no count: to the end
    assert len(attempt(pts, "0\n").points) == 0


@pytest.mark.parametrize("text", [
    "3\n1 2 3\n4 5 6\n", "1\n1 2 3\n4 5 6\n", "2\n1 2 3\n4 5\n", "2\n1 2 3 4\n4 5 6\n", "2\n1 2\n3 4\n", "",
    "1\n1 2 3 4 5\n", "1\n1 2 x\n", "99999999999999999\n1 2 3\n", "-1\n1 2 3\n", "2\n1 2 3 1 2 3\n1 2 3 1 2 300\n",
    "1\n1 2 3\n1\n1 2 3 4\n", "version: 1\nn_points: 68\n{\n", "1\n", "1\n1 2 3\n\0\0", "1\n" + "1" * 5000 + " 2 3\n",
])  # fmt: skip
def test_what_is_no_pts(text):
    assert attempt(pts, text) is None


@settings(max_examples=60)
@given(st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3), max_size=8), st.booleans(),
       st.booleans(), st.integers(0, 99))  # fmt: skip
def test_pts_there_and_back(points, intensity, colors, seed):
    rng = np.random.default_rng(seed)
    count = len(points)
    content = Content(
        np.array(points, float).reshape(count, 3),
        colors=rng.integers(0, 256, (count, 3), np.uint8) if colors else None,
        attributes={"intensity": rng.integers(-2048, 2048, count).astype(float)} if intensity else {},
    )  # fmt: skip
    stream = io.BytesIO()
    assert pts.save(stream, content) == []
    again = pts.load(source_of(stream.getvalue()))
    np.testing.assert_array_equal(again.points, content.points)
    if count and intensity:
        np.testing.assert_array_equal(again.attributes["intensity"], content.attributes["intensity"])
    if count and colors:
        np.testing.assert_array_equal(again.colors, content.colors)


def test_pts_run_after_run_and_what_is_lost(tmp_path):
    cloud = Content(RNG.random((50, 3)), colors=RNG.integers(0, 256, (50, 3), np.uint8))
    stream, whole = io.BytesIO(), io.BytesIO()
    writer = pts.writer(stream, cloud.rows(slice(0, 1)), Head(), suffix=".pts")
    for first in range(0, 50, 20):
        writer.add(cloud.rows(slice(first, first + 20)))
    writer.close()
    pts.save(whole, cloud)
    assert stream.getvalue() == whole.getvalue()
    lost = pts.save(io.BytesIO(), Content(np.eye(3), normals=np.eye(3), attributes={"tag": np.zeros(3)}))
    assert lost == ["normals", "attribute 'tag'"]
    with pytest.raises(InputError, match="finite"):
        pts.save(io.BytesIO(), Content(np.full((1, 3), np.nan)))
    for words, expected in [
        (np.array([[65535, 257, 0]], np.uint16), [255, 1, 0]), (np.array([[9, 200, 0]], np.uint16), [9, 200, 0]),
        (np.array([[1.0, 0.2, 0]]), [255, 51, 0]),
    ]:  # fmt: skip
        stream = io.BytesIO()
        pts.save(stream, Content(np.zeros((1, 3)), colors=words))
        assert pts.load(source_of(stream.getvalue())).colors.tolist() == [expected]


def test_grids_with_poses():
    turn = np.eye(4)
    turn[:2, :2] = [[0, 1], [-1, 0]]  # rows are where the axes go: x to y
    turn[3, :3] = [10, 20, 30]
    first, second = RNG.random((12, 4)), RNG.random((5, 4))
    first[[2, 7], :3] = 0.0
    first[4, :2] = 0.0  # a place on an axis
    content = attempt(ptx, scan(4, 3, first, turn) + scan(1, 5, second, place="4 5 6"))
    kept = first[(first[:, :3] != 0).any(axis=1)]
    expected = np.stack([10 - kept[:, 1], 20 + kept[:, 0], 30 + kept[:, 2]], axis=1)
    np.testing.assert_allclose(content.points, np.concatenate([expected, second[:, :3]]), atol=1e-12)
    np.testing.assert_array_equal(content.attributes["intensity"], np.concatenate([kept[:, 3], second[:, 3]]))
    assert content.attributes["scan"].tolist() == [0] * 10 + [1] * 5
    assert content.notes == ["rows of scan 0 that met nothing (0 0 0) and were dropped: 2"]
    assert content.frame.extra["ptx"]["scanners"] == [[1, 2, 3], [4, 5, 6]]
    colored = attempt(ptx, scan(1, 2, np.array([[1, 2, 3, 0.5, 255, 0, 9], [0, 0, 0, 0.5, 0, 0, 0]])))
    assert colored.colors.tolist() == [[255, 0, 9]]
    assert len(attempt(ptx, scan(0, 0, np.empty((0, 4)))).points) == 0


def test_what_is_no_ptx():
    points = RNG.random((4, 4))
    good = scan(2, 2, points)
    flat, bent = np.eye(4), np.eye(4)
    flat[2, 2], bent[0, 3] = 0.0, 1.0
    wrong = [
        "", "x\n", "2\n", scan(3, 2, points), scan(1, 2, points), scan(2, 2, points[:3]), good + "5\n",
        good.replace("1 2 3", "1 2"), good.replace("1 2 3", "1 2 nan"), good.replace("0 1 0", "0 1"),
        scan(2, 2, points, flat), scan(2, 2, points, bent), scan(99999, 99999999, points), scan(2, 2, points[:, :2]),
        good + scan(1, 1, np.ones((1, 7))),
    ]  # fmt: skip
    assert attempt(ptx, good) is not None
    for text in wrong:
        assert attempt(ptx, text) is None, text


@pytest.mark.parametrize("codec", [pts, ptx])
def test_cut_and_flipped(codec):
    rng = random.Random(codec.__name__)
    text = scan(3, 4, RNG.random((12, 7)).round(3) * [1, 1, 1, 1, 0, 0, 0])
    if codec is pts:
        text = "12\n" + "".join(f"{x:.3f} {y:.3f} {z:.3f} 7 1 2 3\n" for x, y, z in RNG.random((12, 3)))
    whole = attempt(codec, text)
    for length in range(1, len(text) - 9, 7):
        assert attempt(codec, text[:length]) is None or length < text.index("\n")
    for _ in range(150):
        damaged = bytearray(text.encode())
        damaged[rng.randrange(len(damaged))] = rng.choice(b"\0\xff-+.0159eE \n\r,;#/")
        content = attempt(codec, bytes(damaged))
        assert content is None or len(content.points) <= len(whole.points)


def test_through_the_doors(tmp_path):
    (tmp_path / "a.ptx").write_text(scan(2, 3, RNG.random((6, 4))))
    assert len(surfel.read(tmp_path / "a.ptx")) == 6
    surfel.convert(tmp_path / "a.ptx", tmp_path / "b.pts")
    np.testing.assert_array_equal(surfel.read(tmp_path / "b.pts").points, surfel.read(tmp_path / "a.ptx").points)
    with pytest.raises(InputError):
        surfel.write(tmp_path / "c.ptx", np.eye(3))
