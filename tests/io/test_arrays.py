"""NPY and NPZ: what is read, what is refused, and that nothing is unpickled or unpacked beyond measure."""

from __future__ import annotations

import io
import pickle
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import surfel.io
from surfel.core.errors import FileFormatError
from surfel.shapes.surfels import Surfels

RNG = np.random.default_rng(3)


@pytest.mark.parametrize("kind", ["<f4", ">f8", "<i2", "u1", ">i4"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_plain_arrays(tmp_path, kind, order):
    table = np.asarray((RNG.random((7, 3)) * 99).astype(kind), order=order)
    np.save(tmp_path / "a.npy", table)
    np.testing.assert_array_equal(surfel.io.read(tmp_path / "a.npy").points, table.astype(float))


def test_points_and_normals(tmp_path):
    cloud = Surfels(RNG.normal(size=(9, 3)), RNG.normal(size=(9, 3)))
    surfel.io.write(tmp_path / "a.npy", cloud)
    assert np.load(tmp_path / "a.npy").shape == (9, 6)
    again = surfel.io.read(tmp_path / "a.npy")
    np.testing.assert_array_equal(again.points, cloud.points)
    np.testing.assert_allclose(again.normals, cloud.normals, atol=1e-15)


@pytest.mark.parametrize("joined", [False, True])
def test_records(tmp_path, joined):
    fields = [("points", "f4", 3)] if joined else [("z", "f4"), ("x", ">f8"), ("y", "i2")]
    records = np.zeros(4, [("tag", ">i4"), *fields, ("red", "u1"), ("green", "u1"), ("blue", "u1")])
    records["tag"] = range(4)
    records["points" if joined else "x"] += 1
    np.save(tmp_path / "a.npy", records)
    cloud = surfel.io.read(tmp_path / "a.npy")
    assert cloud.points.tolist() == [[1, 1, 1] if joined else [1, 0, 0]] * 4
    assert cloud.attributes["tag"].tolist() == [0, 1, 2, 3] and cloud.colors.dtype == np.uint8


@pytest.mark.parametrize(
    "array",
    [np.zeros((4, 2)), np.zeros((3, 2, 3)), np.zeros(5), np.float64(3), np.zeros((4, 3), complex), np.array(["a", "b"]),
     np.zeros(3, [("x", "f8"), ("y", "f8")]), np.zeros(3, [("x", "f8"), ("y", "f8"), ("z", "U3")])],
)  # fmt: skip
def test_other_arrays_are_refused(tmp_path, array):
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(FileFormatError):
        surfel.io.read(tmp_path / "a.npy")


class Evil:
    def __reduce__(self):
        return exec, ("raise SystemExit('unpickled')",)


def test_nothing_is_unpickled(tmp_path):
    np.save(tmp_path / "a.npy", np.array([Evil()] * 3, object), allow_pickle=True)
    np.savez(tmp_path / "a.npz", points=np.array([Evil()] * 3, object))
    (tmp_path / "b.npy").write_bytes(pickle.dumps(Evil()))
    for name, problem in (("a.npy", "objects"), ("a.npz", "objects"), ("b.npy", "header")):
        with pytest.raises(FileFormatError, match=problem):
            surfel.io.read(tmp_path / name)


def test_a_header_that_claims_more_than_there_is(tmp_path):
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 3)})
    (tmp_path / "a.npy").write_bytes(buffer.getvalue() + b"\0" * 480)
    with pytest.raises(FileFormatError, match="needs 24000000000000 bytes, there are 480"):
        surfel.io.read(tmp_path / "a.npy")


@pytest.mark.parametrize("shape", ["(-1, 3)", "(1.5, 3)", "3", "('a', 3)", "(" * 50 + ")" * 50])
def test_a_header_that_makes_no_sense(tmp_path, shape):
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(118).encode() + b"\n"
    (tmp_path / "a.npy").write_bytes(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + b"\0" * 24)
    with pytest.raises(FileFormatError):
        print(surfel.io.read(tmp_path / "a.npy").points)


@settings(max_examples=30)
@given(st.integers(0, 9), st.integers(0, 2**32), st.booleans(), st.sampled_from([None, 3, 4]), st.text(max_size=8))
def test_round_trip_of_a_zip(tmp_path_factory, n, seed, normals, colors, name):
    rng = np.random.default_rng(seed)
    attributes = {name: rng.random((n, 2)), "points": rng.integers(0, 9, n), "word": np.array(["ä", "bc"] * n)[:n]}
    cloud = Surfels(
        rng.normal(size=(n, 3)),
        rng.normal(size=(n, 3)) if normals else None,
        rng.random(n),
        rng.random((n, colors)).astype(np.float32) if colors else None,
        attributes,
    )
    path = tmp_path_factory.mktemp("npz") / "with blank and ü.npz"
    with open(path, "wb") as stream:
        lost = surfel.io.npz.save(stream, surfel.io.content.content_of(cloud))
    again = surfel.io.read(path)
    np.testing.assert_array_equal(again.points, cloud.points)
    np.testing.assert_array_equal(again.radii, cloud.radii)
    assert (again.colors is None) == (colors is None) and (again.normals is None) == (not normals)
    if colors:
        np.testing.assert_array_equal(again.colors, cloud.colors)
        assert again.colors.dtype == np.float32
    written = set(again.attributes)
    assert len(written) == len(cloud.attributes) and "points_" in written
    np.testing.assert_array_equal(again.attributes["word"], cloud.attributes["word"])
    assert any("'points'" in line for line in lost)


def test_a_zip_of_numpy_itself(tmp_path):
    points = RNG.random((5, 3))
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", points=points, intensity=np.arange(5), other=np.zeros((2, 2)))
        cloud = surfel.io.read(tmp_path / "a.npz")
        np.testing.assert_array_equal(cloud.points, points)
        assert list(cloud.attributes) == ["intensity"] and "other" in cloud.provenance["notes"][0]
    np.savez(tmp_path / "b.npz", points)
    assert len(surfel.io.read(tmp_path / "b.npz")) == 5


def test_rows_that_do_not_fit(tmp_path):
    for wrong in ({"normals": np.zeros((4, 3))}, {"colors": np.zeros((5, 2))}, {"radii": np.zeros((5, 1))}):
        np.savez(tmp_path / "a.npz", points=np.zeros((5, 3)), **wrong)
        with pytest.raises(FileFormatError):
            surfel.io.read(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", a=np.zeros((5, 3)), b=np.zeros((5, 3)))
    with pytest.raises(FileFormatError, match="arrays a, b"):
        surfel.io.read(tmp_path / "a.npz")


def test_a_zip_that_unpacks_beyond_measure_is_refused_unopened(tmp_path):
    with (
        zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("points.npy", "w") as member,
    ):
        np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": (14_000_000, 3)})
        for _ in range(336):
            member.write(bytes(1_000_000))
    assert (tmp_path / "a.npz").stat().st_size < 3_000_000
    with pytest.raises(FileFormatError, match="unpack to"):
        surfel.io.read(tmp_path / "a.npz")
