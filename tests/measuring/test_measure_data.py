"""Real meshes, sampled, and the troublesome files: skipped where the folder that SURFEL_DATA names is absent."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import numpy as np
import pytest

import surfel

FOLDER = Path(os.environ.get("SURFEL_DATA", Path(__file__).resolve().parents[2].parent / "shared" / "data"))
pytestmark = [
    pytest.mark.data,
    pytest.mark.skipif(not (FOLDER / "MANIFEST.tsv").is_file(), reason=f"no real files in {FOLDER}; set SURFEL_DATA"),
]


def _manifest(name):
    with open(FOLDER / "MANIFEST.tsv", newline="") as file:
        return next(row for row in csv.DictReader(file, delimiter="\t") if row["file"] == name)


@pytest.mark.parametrize("name", ["rocker-arm.obj", "spot.obj", "fandisk.obj", "3holes.off", "cow.obj"])
def test_random_points_of_real_meshes(name):
    mesh = surfel.read(FOLDER / "meshes" / name)
    truth = surfel.measure(mesh)
    assert truth.area.value == pytest.approx(float(_manifest(f"meshes/{name}")["area"]), rel=1e-6)
    points, normals, _ = surfel.sample(mesh, 12_000, seed=4)
    for given in (normals, None):
        m = surfel.measure(surfel.Surfels(points, normals=given), lines=16_384)
        assert m.area.value == pytest.approx(truth.area.value, rel=0.02)
        if name != "cow.obj" or m.closed:  # its horns are sampled too thinly to be sure
            assert m.volume is not None and m.volume.value == pytest.approx(truth.volume.value, rel=0.02)


def test_an_inverted_mesh():
    m = surfel.measure(surfel.read(FOLDER / "meshes" / "horse.ply"))
    assert m.volume.value == pytest.approx(0.000263418277, rel=1e-6)
    assert any("inward" in text for text in m.warnings)


def test_an_open_mesh_that_looks_closed():
    m = surfel.measure(surfel.read(FOLDER / "meshes" / "lion.off"))
    assert m.area.value == pytest.approx(1.8284718, rel=1e-6)
    assert not m.closed and m.volume is None


def test_tristrips():
    m = surfel.measure(surfel.read(FOLDER / "meshes" / "igea.ply"))
    assert m.area.value == pytest.approx(0.0235028193, rel=1e-4)


def test_coordinates_of_the_largest_float():
    for as_ in (None, "points"):
        m = surfel.measure(surfel.read(FOLDER / "meshes" / "Cray_right.obj", as_=as_), lines=512)
        json.dumps(m.to_dict(), allow_nan=False)
        assert m.area.reliable is (as_ is None)
        if as_ is None:
            assert m.area.value == pytest.approx(1.85267321e78, rel=1e-6)


def test_the_vertices_of_the_bunny():
    shape = surfel.read(FOLDER / "meshes" / "bun_zipper.ply", as_="points")
    m = surfel.measure(shape, lines=16_384)
    truth = float(_manifest("meshes/bun_zipper.ply")["area"])
    assert m.area.value == pytest.approx(truth, rel=0.01)
    assert m.cleaning["without_normal"] == 0 or np.isfinite(m.area.value)
    assert m.leak < 0.1
