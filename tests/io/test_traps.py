"""The traps of the data folder, each by name, and every file of it cut and garbled."""

from __future__ import annotations

import contextlib
import random
from pathlib import Path

import numpy as np
import pytest

import surfel
from surfel.core.errors import FileFormatError, InputError, SurfelError

pytestmark = pytest.mark.data
SMALL = 250_000
CUTS = FLIPS = 20
NO_SHAPES = {".tsv", ".md", ".conf", ".txt", ".json"}


def every_file(folder: Path) -> list[Path]:
    return [p for p in sorted(folder.rglob("*")) if p.is_file() and p.suffix.lower() not in NO_SHAPES]


def test_largest_single_precision_is_no_infinity(data_file):
    told = surfel.info(data_file("meshes/Cray_right.obj"), full=True)
    assert told["non_finite"] == 0 and np.abs(told["bounds"]).max() == pytest.approx(3.40282347e38)
    assert len(surfel.read(data_file("meshes/Cray_right.obj")).triangles) == 12


def test_an_inverted_mesh(data_file):
    mesh = surfel.read(data_file("meshes/horse.ply"))
    assert mesh.closed and mesh.inverted  # it is measured as what it bounds, and said to be inside out


def test_an_open_mesh(data_file):
    mesh = surfel.read(data_file("meshes/lion.off"))
    assert not mesh.closed and len(mesh.triangles) == 16674


def test_strips(data_file):
    mesh = surfel.read(data_file("meshes/igea.ply"))
    assert len(mesh.triangles) == 268686 and mesh.closed


def test_points_that_are_not_finite(data_file):
    cloud = surfel.read(data_file("pcd/person.pcd"))
    assert len(cloud) == 307200 - 64451 and cloud.provenance["non_finite"] == 64451
    assert "64451 points that are not finite" in cloud.provenance["notes"][-1]
    assert surfel.info(data_file("pcd/person.pcd"), full=True)["non_finite"] == 64451


def test_duplicates_are_kept_and_counted(data_file):
    path = data_file("pcd/room_scan1.pcd")
    assert len(surfel.read(path)) == 112586
    assert surfel.info(path, full=True)["duplicates"] == 56427


def test_colors_of_a_scan(data_file):
    cloud = surfel.read(data_file("pcd/milk.pcd"))
    assert cloud.colors.shape == (12575, 4) and cloud.colors.dtype == np.uint8


@pytest.mark.parametrize("name", ["samp12-utm.pcd", "samp12-utm-ground.pcd"])
def test_utm_coordinates(data_file, tmp_path, name):
    cloud = surfel.read(data_file(f"pcd/{name}"))
    surfel.write(tmp_path / "a.pcd", cloud)
    np.testing.assert_array_equal(surfel.read(tmp_path / "a.pcd").points, cloud.points)


@pytest.mark.parametrize(
    "name", ["append-bug.laz", "bad-geotiff-keys.las", "bad-pointcount.laz", "bad_vlr_count.las", "gps-time-nan.las",
             "unregistered_extra_bytes.las"]
)  # fmt: skip
def test_bad_files_are_read_or_refused_clearly(data_file, name):
    """Each by each door, with the same answer."""
    path = data_file(f"bad/{name}")
    answers = []
    for door in (surfel.read, lambda p: surfel.info(p, full=True), lambda p: list(surfel.open(p, chunk=1000))):
        try:
            door(path)
            answers.append("read")
        except FileFormatError as error:
            assert error.place and error.cure
            answers.append("refused")
    assert len(set(answers)) == 1, answers


def opened(path: Path) -> str:
    """Read and inspect a file; say how many points it has, or that it was refused, with place and cure."""
    try:
        thing = surfel.read(path, as_="points")
        surfel.info(path)
        return f"{len(thing)} points, sum {np.nansum(thing.points[:1000]):.17g}"
    except FileFormatError as error:
        assert error.place and error.cure and error.problem and str(path) in str(error)
        return "refused"
    except InputError as error:
        return f"not taken: {error}"[:30]


def damage(data_folder, tmp_path, few: bool) -> None:
    files = [p for p in every_file(data_folder) if (p.stat().st_size <= SMALL) == few]
    assert files
    for path in files:
        rng = random.Random(path.name)
        data = path.read_bytes()
        target = tmp_path / path.name
        for number in range(CUTS + FLIPS):
            damaged = bytearray(data)
            if number < CUTS:
                del damaged[rng.randrange(1, len(data)) :]
            else:
                damaged[rng.randrange(len(data))] ^= rng.randrange(1, 256)
            target.write_bytes(damaged)
            try:
                opened(target)
            except SurfelError:
                raise
            except Exception as error:
                raise AssertionError(f"{path.name}, damage {number}: {error!r}") from error
        target.unlink()


def test_small_files_cut_and_garbled(data_folder, tmp_path):
    damage(data_folder, tmp_path, few=True)


@pytest.mark.slow
def test_large_files_cut_and_garbled(data_folder, tmp_path):
    damage(data_folder, tmp_path, few=False)


@pytest.mark.parametrize("suffix", [".pcd", ".laz", ".las", ".ply", ".stl", ".off"])
def test_a_cut_never_gives_fewer_points_without_an_error(data_folder, tmp_path, suffix):
    """These formats say how many points there are: a part of a file is refused, never read as less."""
    for path in [p for p in every_file(data_folder) if p.suffix.lower() == suffix and p.stat().st_size < SMALL][:4]:
        rng = random.Random(path.name)
        data = path.read_bytes()
        try:
            whole = len(surfel.read(path, as_="points"))
        except FileFormatError:
            continue
        for _ in range(10):
            target = tmp_path / path.name
            target.write_bytes(data[: rng.randrange(len(data) // 3, len(data))])
            with contextlib.suppress(FileFormatError):
                assert len(surfel.read(target, as_="points")) == whole  # only what no point needs was cut off
