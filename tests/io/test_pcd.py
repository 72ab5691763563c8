"""PCD: all three encodings, organised clouds, fields of any type, colors, the viewpoint; lies are refused."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import surfel
from surfel.core.errors import FileFormatError

sys.path.append(str(Path(__file__).resolve().parents[2]))
from benchmarks.fuzz_seeds import lzf_literal

HEAD = """# .PCD v.7 - Point Cloud Data file format
VERSION .7
FIELDS x y z rgb normal_x normal_y normal_z _ histogram ring
SIZE 4 4 4 4 4 4 4 1 2 8
TYPE F F F F F F F U I F
COUNT 1 1 1 1 1 1 1 3 2 1
WIDTH 3
HEIGHT 2
VIEWPOINT 1 2 3 0.5 0.5 0.5 0.5
POINTS 6
DATA """
RECORD = np.dtype(
    [("xyz", "<f4", 3), ("rgb", "<u4"), ("n", "<f4", 3), ("pad", "u1", 3), ("histogram", "<i2", 2), ("ring", "<f8")]
)


def rows() -> np.ndarray:
    made = np.zeros(6, RECORD)
    made["xyz"] = np.arange(18).reshape(6, 3) / 4
    made["xyz"][4] = np.nan
    made["rgb"] = [0xFF0000, 0x00FF00, 0x0000FF, 0x123456, 0, 0xFFFFFFFF]
    made["n"] = np.eye(3)[[0, 1, 2, 0, 1, 2]]
    made["histogram"] = np.arange(12).reshape(6, 2) - 5
    made["ring"] = 0.1 * np.arange(6)
    return made


def encoded(kind: str) -> bytes:
    made = rows()
    if kind == "ascii":
        lines = []
        for r in made:
            values = [*r["xyz"], int(r["rgb"]), *r["n"], 7, 7, 7, *r["histogram"], float(r["ring"])]
            lines.append(" ".join(str(v) if isinstance(v, (int, float)) else repr(v.item()) for v in values))
        return (HEAD.replace("TYPE F F F F", "TYPE F F F U") + "ascii\n" + "\n".join(lines) + "\n").encode()
    if kind == "binary":
        return HEAD.encode() + b"binary\n" + made.tobytes()
    parts = [made["xyz"][:, i] for i in range(3)] + [made["rgb"]] + [made["n"][:, i] for i in range(3)]
    packed = b"".join(np.ascontiguousarray(p).tobytes() for p in [*parts, made["pad"], made["histogram"], made["ring"]])
    data = lzf_literal(packed)
    return HEAD.encode() + b"binary_compressed\n" + struct.pack("<II", len(data), len(packed)) + data


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_everything_in_it(tmp_path, kind):
    (tmp_path / "a.pcd").write_bytes(encoded(kind))
    cloud = surfel.read(tmp_path / "a.pcd")
    keep = [0, 1, 2, 3, 5]
    made = rows()[keep]
    np.testing.assert_array_equal(cloud.points, made["xyz"])
    np.testing.assert_array_equal(cloud.normals, made["n"])
    assert cloud.colors.tolist() == [[255, 0, 0], [0, 255, 0], [0, 0, 255], [0x12, 0x34, 0x56], [255, 255, 255]]
    assert set(cloud.attributes) == {"histogram", "ring"}
    np.testing.assert_array_equal(cloud.attributes["histogram"], made["histogram"])
    np.testing.assert_array_equal(cloud.attributes["ring"], made["ring"])
    assert cloud.provenance["non_finite"] == 1
    assert cloud.provenance["frame"].extra["pcd"]["viewpoint"] == (1, 2, 3, 0.5, 0.5, 0.5, 0.5)
    assert "organised cloud of 3 x 2" in cloud.provenance["notes"][0]
    told = surfel.info(tmp_path / "a.pcd")
    assert (told["points"], told["width"], told["height"], told["data"]) == (6, 3, 2, kind)
    assert told["normals"] and told["colors"] and told["attributes"] == ["histogram", "ring"]
    for ascii in (False, True):
        surfel.write(tmp_path / "b.pcd", cloud, ascii=ascii)
        again = surfel.read(tmp_path / "b.pcd")
        np.testing.assert_array_equal(again.points, cloud.points)
        np.testing.assert_array_equal(again.colors, cloud.colors)
        np.testing.assert_array_equal(again.attributes["histogram"], cloud.attributes["histogram"])
        assert again.attributes["ring"].dtype == np.float64
        assert again.provenance["frame"].extra["pcd"]["viewpoint"] == (1, 2, 3, 0.5, 0.5, 0.5, 0.5)


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_a_page_behind_the_points_and_more(tmp_path, kind):
    data = encoded(kind)
    (tmp_path / "a.pcd").write_bytes(data + b"1 2 3\n" * 3000)
    with pytest.raises(FileFormatError, match="bytes"):
        surfel.read(tmp_path / "a.pcd")
    (tmp_path / "a.pcd").write_bytes(data + (b"\n" if kind == "ascii" else bytes(3900)))
    assert len(surfel.read(tmp_path / "a.pcd")) == 5


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("POINTS 6", "POINTS 7", "header line 10"), ("WIDTH 3", "WIDTH 900000000000", "header line 10"),
        ("WIDTH 3", "WIDTH -3", "header line 7"), ("SIZE 4 4", "SIZE 3 4", "header line 5"),
        ("SIZE 4 4 ", "SIZE 4 ", "header line 6"), ("COUNT 1 1", "COUNT 0 1", "header line 6"),
        ("DATA ", "DATA strange", "header line 11"), ("FIELDS x", "FIELDS q", "header line 3"),
        ("ring\n", "x\n", "header line 3"), ("WIDTH 3\n", "", "header line"), ("VIEWPOINT 1 2", "VIEWPOINT 1", " 9"),
        ("VIEWPOINT 1", "VIEWPORT 1", "header line 9"), ("HEIGHT 2", "HEIGHT two", "header line 8"),
    ],
)  # fmt: skip
def test_a_header_that_lies(tmp_path, old, new, place):
    for kind in ("binary", "ascii", "binary_compressed"):
        text = encoded(kind)
        assert old.encode() in text
        (tmp_path / "a.pcd").write_bytes(text.replace(old.encode(), new.encode(), 1))
        with pytest.raises(FileFormatError) as caught:
            surfel.read(tmp_path / "a.pcd")
        assert place in caught.value.place and caught.value.cure


def test_counts_that_fit_each_other_but_not_the_file(tmp_path):
    for kind in ("binary", "ascii", "binary_compressed"):
        data = encoded(kind).replace(b"WIDTH 3", b"WIDTH 90000000").replace(b"POINTS 6", b"POINTS 180000000")
        (tmp_path / "a.pcd").write_bytes(data)
        with pytest.raises(FileFormatError):
            surfel.read(tmp_path / "a.pcd")
        with pytest.raises(FileFormatError):
            surfel.info(tmp_path / "a.pcd")


@given(st.binary(max_size=200), st.integers(0, 300))
def test_unpacking_against_a_plain_unpacker(data, size):
    from surfel.io.lzf import unpack

    def plain() -> bytes | None:
        out, p = bytearray(), 0
        while p < len(data):
            c = data[p]
            p += 1
            if c < 32:
                if p + c + 1 > len(data):
                    return None
                out += data[p : p + c + 1]
                p += c + 1
                continue
            length = c >> 5
            if length == 7:
                if p >= len(data):
                    return None
                length += data[p]
                p += 1
            if p >= len(data):
                return None
            start = len(out) - ((c & 31) << 8) - data[p] - 1
            p += 1
            if start < 0:
                return None
            for i in range(length + 2):
                out.append(out[start + i])
        return bytes(out)

    expected = plain()
    found = unpack(np.frombuffer(data, np.uint8).copy(), size if expected is None else len(expected))
    assert (found is None) if expected is None else (found.tobytes() == expected)


def test_wide_numbers_keep_their_digits(tmp_path):
    points = np.array([[500000.123456789, 4e6 + 1e-7, 1.0], [0.1, 0.2, 0.3]])
    surfel.write(tmp_path / "a.pcd", points)
    assert b"SIZE 8 8 8" in (tmp_path / "a.pcd").read_bytes()
    assert (surfel.read(tmp_path / "a.pcd").points == points).all()
    surfel.write(tmp_path / "a.pcd", points.round())
    assert b"SIZE 4 4 4" in (tmp_path / "a.pcd").read_bytes()


def test_runs_that_need_more_digits_later(tmp_path, monkeypatch):
    monkeypatch.setattr("surfel.io.conversion.CHUNK", 2)
    (tmp_path / "a.xyz").write_text("1 2 3\n4 5 6\n0.1 0.2 0.3\n")
    surfel.convert(tmp_path / "a.xyz", tmp_path / "a.pcd")
    assert surfel.read(tmp_path / "a.pcd").points[2].tolist() == [0.1, 0.2, 0.3]
