"""The commands on real scans and meshes."""

from __future__ import annotations

import csv
import json

import pytest

from surfel.cli import main

pytestmark = pytest.mark.data

MESHES = [
    "bun_zipper.ply",
    "fandisk.obj",
    "fertility.off",
    "torus.STL",
    "horse.ply",
    "igea.ply",
    "teapot.obj",
    "lion.off",
]
KEYS = [
    "points", "method", "lines", "area", "volume", "centroid", "inertia", "areas", "sides", "closed", "leak", "spacing",
    "noise", "seed", "seconds", "warnings",
]  # fmt: skip


@pytest.fixture(scope="session")
def manifest(data_file):
    """Vertices, faces, area and volume of each file, as found by others."""
    with open(data_file("MANIFEST.tsv"), encoding="utf-8", newline="") as stream:
        return {row["file"]: row for row in csv.DictReader(stream, delimiter="\t")}


def answer(capsys, *arguments):
    assert main([*map(str, arguments), "--json"]) == 0, capsys.readouterr().err
    return json.loads(capsys.readouterr().out)


def test_the_bunny_as_points(data_file, capsys):
    data = answer(capsys, "measure", data_file("meshes/bun_zipper.ply"), "--as", "points")
    assert [key for key in data if key in KEYS] == KEYS
    assert data["points"] > 34_000
    assert data["area"]["value"] == pytest.approx(0.0571288, rel=0.02)
    assert data["area"]["reliable"] is True
    assert data["volume"] is None and data["closed"] is False


@pytest.mark.parametrize("name", MESHES)
def test_meshes_are_measured_exactly(name, data_file, manifest, capsys):
    row = manifest[f"meshes/{name}"]
    data = answer(capsys, "measure", data_file(f"meshes/{name}"))
    assert data["area"]["value"] == pytest.approx(float(row["area"]), rel=1e-4)
    if data["closed"]:
        assert data["volume"]["value"] == pytest.approx(abs(float(row["volume"])), rel=1e-3)
    else:
        assert data["volume"] is None


@pytest.mark.parametrize("name", MESHES)
def test_info_counts_what_the_manifest_counts(name, data_file, manifest, capsys):
    row = manifest[f"meshes/{name}"]
    data = answer(capsys, "info", data_file(f"meshes/{name}"))
    assert data["triangles"] == int(row["faces"])


def test_a_range_scan_is_converted_and_sampled_from(data_file, tmp_path, capsys):
    report = answer(capsys, "convert", data_file("range/bun000.ply"), tmp_path / "scan.npz")
    held = answer(capsys, "info", tmp_path / "scan.npz")
    assert report["points"] == held["points"] == 40_256


def test_a_cut_scan_is_refused(data_file, tmp_path, capsys):
    whole = data_file("range/bun000.ply").read_bytes()
    (tmp_path / "cut.ply").write_bytes(whole[:-1000])
    assert main(["measure", str(tmp_path / "cut.ply")]) == 2
    err = capsys.readouterr().err
    assert "cut.ply" in err and err.count("\n") == 1
