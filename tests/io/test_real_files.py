"""Every mesh and every PLY of the data folder: counts and areas, and that a cut file is refused."""

from __future__ import annotations

import csv
import random

import numpy as np
import pytest

import surfel.io
from surfel.core.errors import FileFormatError

MESHES = [
    "112932.stl", "3holes.off", "520644.stl", "88566.stl", "Cray_left.obj", "Cray_right.obj", "armadillo_libigl.obj",
    "bun_zipper.ply", "cow.obj", "cycloidal.ply", "dragon_vrip_res2.ply", "dragon_vrip_res3.ply", "fandisk.obj",
    "fertility.off", "horse.ply", "igea.ply", "lion.off", "rocker-arm.obj", "spot.obj", "teapot.obj", "torus.STL",
]  # fmt: skip
RANGES = ["bun000", "bun045", "bun090", "bun180", "bun270", "bun315", "ear_back", "top2"]
FILES = [f"meshes/{n}" for n in MESHES] + ["plants/VirtualPlant.obj"]
CLOUDS = [f"range/{n}.ply" for n in RANGES] + ["lidar/source.ply"]

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def manifest(data_folder):
    with open(data_folder / "MANIFEST.tsv", newline="") as stream:
        return {row["file"]: row for row in csv.DictReader(stream, delimiter="\t")}


def area_of(mesh) -> float:
    corners = mesh.vertices[mesh.triangles]
    return float(
        np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    )


@pytest.mark.parametrize("name", FILES)
def test_meshes(data_folder, manifest, name):
    mesh = surfel.io.read(data_folder / name)
    row = manifest[name]
    assert len(mesh.triangles) == int(row["faces"])
    assert area_of(mesh) == pytest.approx(float(row["area"]), rel=1e-7)
    if name.lower().endswith((".ply", ".off")):
        assert len(mesh.vertices) == int(row["vertices"])
    else:  # the manifest counts the corners of STL, and those of OBJ once for each texture coordinate
        assert len(mesh.vertices) <= int(row["vertices"])
        assert len(np.unique(mesh.vertices, axis=0)) >= int(row["notes"].split("merged_v=")[1].split()[0]) - 6
    cloud = surfel.io.read(data_folder / name, as_="points")
    assert len(cloud) <= len(mesh.vertices) and cloud.normals is not None


@pytest.mark.parametrize("name", CLOUDS)
def test_clouds(data_folder, manifest, name):
    cloud = surfel.io.read(data_folder / name)
    assert len(cloud) == int(manifest[name]["vertices"])
    extent = [float(x) for x in manifest[name]["notes"].split("[")[1].rstrip("]").split(",")]
    np.testing.assert_allclose(np.ptp(cloud.points, axis=0), extent, atol=6e-5)
    assert surfel.io.info(data_folder / name)["points"] == len(cloud)


def test_a_strip_of_a_hundred_thousand_vertices_is_turned_right(data_folder, manifest):
    mesh = surfel.io.read(data_folder / "meshes/igea.ply")
    assert mesh.closed and not mesh.inverted
    assert mesh.volume == pytest.approx(float(manifest["meshes/igea.ply"]["volume"]), rel=1e-7)


def test_largest_single_precision(data_folder):
    mesh = surfel.io.read(data_folder / "meshes/Cray_right.obj")
    assert np.abs(mesh.vertices).max() == float("340282346999999984391321947108527833088")
    assert np.isfinite(surfel.io.info(data_folder / "meshes/Cray_right.obj", full=True)["bounds"]).all()


@pytest.mark.parametrize("name", [f for f in FILES + CLOUDS if f.lower().endswith((".ply", ".off", ".stl"))])
def test_cut_by_a_thousand_bytes_and_at_random(data_folder, tmp_path, name):
    data = (data_folder / name).read_bytes()
    rng = random.Random(name)
    target = tmp_path / name.split("/")[1]
    for length in [len(data) - 1000, *(rng.randrange(len(data) - 10) for _ in range(4))]:
        target.write_bytes(data[:length])
        with pytest.raises(FileFormatError) as caught:
            surfel.io.read(target)
        assert caught.value.place


@pytest.mark.parametrize("name", ["meshes/bun_zipper.ply", "meshes/horse.ply", "meshes/spot.obj", "meshes/lion.off"])
def test_written_again_nothing_changes(data_folder, tmp_path, name):
    mesh = surfel.io.read(data_folder / name)
    for suffix in (".ply", ".obj", ".off"):
        surfel.io.convert(data_folder / name, tmp_path / f"a{suffix}")
        again = surfel.io.read(tmp_path / f"a{suffix}")
        np.testing.assert_array_equal(again.vertices, mesh.vertices)
        np.testing.assert_array_equal(again.triangles, mesh.triangles)
