"""open and the options of reading: for every format the same points as read gives, whatever the chunk."""

from __future__ import annotations

import io
import sys
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest

import surfel
from surfel.core.errors import FileFormatError, InputError

ROWS = 57
FORMATS = ("ply", "xyz", "csv", "npy", "npz", "pcd", "obj", "off", "las", "laz", "pts", "e57")
CLASSED = ("ply", "csv", "npz", "pcd", "las", "laz")


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    rng = np.random.default_rng(3)
    cloud = surfel.Surfels(
        (rng.random((ROWS, 3)) * 8).round(2), colors=rng.integers(0, 255, (ROWS, 3)).astype(np.uint8),
        attributes={"classification": (np.arange(ROWS) % 4).astype(np.uint8)},
    )  # fmt: skip
    folder = tmp_path_factory.mktemp("files")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for suffix in FORMATS:
            surfel.write(folder / f"a.{suffix}", cloud)
        surfel.write(folder / "ascii.ply", cloud, ascii=True)
        surfel.write(folder / "ascii.pcd", cloud, ascii=True)
    return {path.name: path for path in sorted(folder.iterdir())}


def names(*formats: str) -> list[str]:
    return [f"a.{f}" for f in formats] + ["ascii.ply", "ascii.pcd"]


@pytest.mark.parametrize("name", names(*FORMATS))
@pytest.mark.parametrize("size", [1, 7, ROWS, 1000])
def test_chunks_put_together_are_the_file(files, name, size):
    whole = surfel.read(files[name])
    with surfel.open(files[name], chunk=size) as file:
        for _ in range(2):  # a file may be gone through again
            clouds = list(file)
            assert all(len(cloud) <= size for cloud in clouds)
            np.testing.assert_array_equal(np.concatenate([c.points for c in clouds]), whole.points)
            for c in clouds:
                assert list(c.attributes) == list(whole.attributes) and (c.colors is None) == (whole.colors is None)
                assert all(c.attributes[key].dtype == whole.attributes[key].dtype for key in c.attributes)
        assert file.points in (ROWS, None) and file.format == whole.provenance["format"]
    with pytest.raises(InputError, match="closed"):
        iter(file)


@pytest.mark.parametrize("name", names(*FORMATS))
def test_a_box_and_every_third(files, name):
    whole = surfel.read(files[name])
    low, high = np.array([1.0, 1, 1]), np.array([6.0, 7, 7])
    for every in (1, 3, 100):
        rows = whole.points[::every]
        inside = ((rows >= low) & (rows <= high)).all(axis=1)
        found = surfel.read(files[name], bounds=(low, high), every=every)
        np.testing.assert_array_equal(found.points, rows[inside])
        np.testing.assert_array_equal(surfel.read(files[name], every=every).points, rows)
        together = [c.points for c in surfel.open(files[name], chunk=10, bounds=(low, high), every=every)]
        np.testing.assert_array_equal(np.concatenate([*together, np.empty((0, 3))]), rows[inside])


@pytest.mark.parametrize("name", names(*CLASSED))
def test_classes(files, name):
    whole = surfel.read(files[name])
    for classes in (2, (1, 3), [0], (77,)):
        wanted = np.isin(whole.attributes["classification"], classes)
        found = surfel.read(files[name], classes=classes)
        np.testing.assert_array_equal(found.points, whole.points[wanted])
        assert np.isin(found.attributes["classification"], classes).all()


def test_options_that_cannot_be_met(files, tmp_path):
    for name in ("a.npy", "a.off", "a.obj"):
        with pytest.raises(InputError, match="classification"):
            surfel.read(files[name], classes=2)
    for name in ("a.ply", "a.las", "a.xyz", "a.pcd"):
        for wanted in ({"level": 2}, {"resolution": 0.5}):
            with pytest.raises(InputError, match=r"COPC|levels"):
                surfel.read(files[name], **wanted)
            with pytest.raises(InputError, match=r"COPC|levels"):
                list(surfel.open(files[name], **wanted))
    for wrong in (
        {"bounds": ((1, 1, 1), (0, 2, 2))}, {"bounds": (0, 1)}, {"bounds": ((0, 0, np.nan), (1, 1, 1))}, {"every": 0},
        {"every": 1.5}, {"classes": "2"}, {"classes": 2.5}, {"classes": -1}, {"level": -1}, {"resolution": 0},
        {"level": 1, "resolution": 1.0}, {"bounds": "box"},
    ):  # fmt: skip
        with pytest.raises(InputError):
            surfel.read(files["a.ply"], **wrong)
        with pytest.raises(InputError):
            surfel.convert(files["a.ply"], tmp_path / "b.ply", **wrong)
    with pytest.raises(InputError, match="chunk"):
        surfel.open(files["a.ply"], chunk=0)


def test_part_of_a_mesh(tmp_path):
    grid = np.array([[x, y, 0.0] for y in range(5) for x in range(5)])
    faces = [[5 * y + x, 5 * y + x + 1, 5 * y + x + 5] for y in range(4) for x in range(4)]
    surfel.write(tmp_path / "a.ply", surfel.Mesh(grid, faces))
    part = surfel.read(tmp_path / "a.ply", bounds=((0, 0, -1), (2, 2, 1)))
    assert len(part.triangles) == 4 and part.vertices.max() == 2
    with pytest.raises(InputError, match="tear"):
        surfel.read(tmp_path / "a.ply", every=2)
    used = surfel.read(tmp_path / "a.ply", as_="points")
    assert len(surfel.read(tmp_path / "a.ply", as_="points", every=2)) == (len(used) + 1) // 2
    assert sum(map(len, surfel.open(tmp_path / "a.ply", chunk=4))) == len(used)


@pytest.mark.parametrize("target", ["b.ply", "b.xyz", "b.csv", "b.pcd", "b.las", "b.laz", "b.npz"])
@pytest.mark.parametrize("name", names("ply", "csv", "pcd", "las", "laz", "npz"))
def test_converted_in_runs_or_whole_it_is_the_same(files, tmp_path, monkeypatch, name, target):
    monkeypatch.setattr("surfel.io.conversion.CHUNK", 10)
    seen = []
    report = surfel.convert(files[name], tmp_path / target, progress=lambda share, label: seen.append(share))
    whole, again = surfel.read(files[name]), surfel.read(tmp_path / target)
    assert report["points"] == ROWS and report["lost"] == []
    digits = {"rtol": 0, "atol": 1e-12 if "las" in name + target or "laz" in name + target else 0}  # 0.01 x 69 there
    np.testing.assert_allclose(again.points, whole.points, **digits)
    np.testing.assert_array_equal(again.attributes["classification"], whole.attributes["classification"])
    assert seen == sorted(seen) or target in ("b.las", "b.laz")  # which look at the extent first
    report = surfel.convert(files[name], tmp_path / target, bounds=((1, 1, 1), (6, 7, 7)), every=2, classes=(0, 2))
    part = surfel.read(files[name], bounds=((1, 1, 1), (6, 7, 7)), every=2, classes=(0, 2))
    assert report["points"] == len(part) > 3
    np.testing.assert_allclose(surfel.read(tmp_path / target).points, part.points, **digits)


def test_memory_stays_flat(tmp_path):
    rows = 1_000_000
    surfel.write(tmp_path / "a.ply", np.random.default_rng(0).random((rows, 3)))
    surfel.convert(tmp_path / "a.ply", tmp_path / "small.xyz", every=1000)  # imports and compiles
    text = np.arange(3 * rows // 10).reshape(-1, 3)
    np.savetxt(tmp_path / "b.xyz", np.concatenate([text] * 10), fmt="%d")
    for name in ("a.ply", "b.xyz"):
        tracemalloc.start()
        assert sum(len(cloud) for cloud in surfel.open(tmp_path / name, chunk=10_000)) == rows
        assert tracemalloc.get_traced_memory()[1] < 12 << 20  # of 24 MB; a window of text takes 10
        tracemalloc.stop()


def test_a_chunk_further_on_is_cut(files, tmp_path):
    for name in names("ply", "pcd", "csv", "las"):
        data = files[name].read_bytes()
        (tmp_path / name).write_bytes(data[: len(data) - 30])
        with pytest.raises(FileFormatError):
            list(surfel.open(tmp_path / name, chunk=5))
        (tmp_path / "old.ply").write_bytes(b"old")
        with pytest.raises(FileFormatError):
            surfel.convert(tmp_path / name, tmp_path / "old.ply")
        assert (tmp_path / "old.ply").read_bytes() == b"old"


def test_roles_of_nameless_columns_are_those_of_the_whole_file(tmp_path):
    (tmp_path / "a.xyz").write_text("0 0 0 1 2 3\n" * 20 + "1 1 1 0.5 0 0\n")  # the last row says: these are normals
    whole = surfel.read(tmp_path / "a.xyz")
    assert whole.normals is not None and whole.colors is None
    assert all(c.normals is not None and c.colors is None for c in surfel.open(tmp_path / "a.xyz", chunk=4))
    (tmp_path / "b.csv").write_text("x,y,z,r,g,b\n" + "0,0,0,1,2,3\n" * 20 + "1,1,1,300,0,0\n")
    assert {c.colors.dtype for c in surfel.open(tmp_path / "b.csv", chunk=4)} == {np.dtype(np.uint16)}


class _Pipe:
    """A standard input or output that is a real pipe with these bytes."""

    def __init__(self, stream) -> None:
        self.buffer = stream

    def fileno(self) -> int:
        return self.buffer.fileno()


@pytest.mark.parametrize("name", names("ply", "pcd", "las", "xyz", "npz"))
def test_from_the_standard_input(files, monkeypatch, tmp_path, name):
    whole = surfel.read(files[name])
    with open(files[name], "rb") as stream:
        monkeypatch.setattr(sys, "stdin", _Pipe(stream))
        assert len(surfel.read("-")) == ROWS
        told = surfel.info("-", full=True)
        assert told["points"] == ROWS and told["format"] == whole.provenance["format"]
        with surfel.open("-", chunk=10) as file:
            for _ in range(2):
                np.testing.assert_array_equal(np.concatenate([c.points for c in file]), whole.points)


def test_to_the_standard_output(files, monkeypatch, tmp_path):
    for to, suffix in ((None, "ply"), ("pcd", "pcd"), (".xyz", "xyz")):
        with open(tmp_path / f"out.{suffix}", "wb") as stream:
            monkeypatch.setattr(sys, "stdout", _Pipe(stream))
            surfel.convert(files["a.las"], "-", to=to)
            monkeypatch.undo()
        assert len(surfel.read(tmp_path / f"out.{suffix}")) == ROWS
    with pytest.raises(InputError, match="suffix"):
        surfel.convert(files["a.las"], "-", to="png")
    with pytest.raises(InputError, match=r"\.copc"):
        surfel.write(tmp_path / "a.copc.laz", np.eye(3))


def test_a_long_pipe_goes_to_a_temporary_file(monkeypatch):
    from surfel.io import source

    monkeypatch.setattr(source, "_IN_MEMORY", 1000)
    monkeypatch.setattr(source, "_RUN", 300)
    kept = source._spooled(io.BytesIO(bytes(range(256)) * 20))
    assert not isinstance(kept, io.BytesIO)
    kept.seek(0)
    assert kept.read() == bytes(range(256)) * 20
    kept.close()


def test_info_full_of_many_points_is_the_same_in_several_passes(tmp_path, monkeypatch):
    rng = np.random.default_rng(1)
    points = rng.random((3000, 3)).astype(np.float32)
    surfel.write(tmp_path / "a.ply", np.concatenate([points, points[:200]]))
    at_once = surfel.info(tmp_path / "a.ply", full=True)
    monkeypatch.setattr("surfel.io.tally._WHOLE", 100)
    monkeypatch.setattr("surfel.io.tally._HASHES", 1000)
    monkeypatch.setattr("surfel.io.tally._SAMPLE", 10_000)
    monkeypatch.setattr("surfel.io.facts.CHUNK", 500)
    in_passes = surfel.info(tmp_path / "a.ply", full=True)
    assert in_passes.pop("spacing") == pytest.approx(at_once.pop("spacing")) and in_passes == at_once
    assert at_once["duplicates"] == 200
