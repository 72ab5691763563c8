"""surfel combine on the command line: the operations, one .csg, clips kept or split, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

import surfel
from surfel.cli import main

KEYS = {"surfels", "kept", "cut", "leaky", "conflict", "seconds", "warnings"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("combine")
    p = np.random.default_rng(0).standard_normal((8000, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    surfel.write(path / "a.ply", surfel.Surfels(p, normals=p))
    surfel.write(path / "b.ply", surfel.Surfels(p + [1.0, 0.0, 0.0], normals=p))
    place = "[[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"
    tree = f'difference() {{ import("a.ply"); multmatrix({place}) {{ sphere(r = 1, $fn = 100); }} }}'
    (path / "tree.csg").write_text(tree)
    return path


def combined(capsys, *arguments):
    assert main(["combine", *map(str, arguments), "--json", "--quiet"]) == 0
    return json.loads(capsys.readouterr().out)


LENS = 5.0 * np.pi / 12.0
BALL = 4.0 * np.pi / 3.0


@pytest.mark.parametrize(
    ("op", "area", "volume"),
    [
        ("union", 6.0 * np.pi, 2 * BALL - LENS),
        ("intersection", 2.0 * np.pi, LENS),
        ("difference", 4 * np.pi, BALL - LENS),
    ],
)
def test_two_balls(folder, tmp_path, capsys, op, area, volume):
    told = combined(capsys, folder / "a.ply", folder / "b.ply", "--op", op, "-o", tmp_path / "c.ply")
    assert set(told) >= KEYS
    assert sum(told["kept"]) == told["surfels"] and len(told["kept"]) == 2
    assert told["cut"] > 0 and told["leaky"] is False and told["conflict"] < 0.01 and told["warnings"] == []
    cloud = surfel.read(tmp_path / "c.ply")
    assert len(cloud) == told["surfels"] and cloud.clips is not None
    m = surfel.measure(cloud)
    assert m.area.value == pytest.approx(area, rel=0.005)
    assert m.volume.value == pytest.approx(volume, rel=0.01)


def test_one_tree_and_more_than_two_files(folder, tmp_path, capsys):
    told = combined(capsys, folder / "tree.csg", "-o", tmp_path / "c.npz")
    assert told["surfels"] > 0 and surfel.measure(surfel.read(tmp_path / "c.npz")).area.value == pytest.approx(
        4.0 * np.pi, rel=0.005
    )
    told = combined(capsys, *[folder / "a.ply"] * 2, folder / "b.ply", "--op", "difference", "-o", tmp_path / "d.npz")
    assert told["surfels"] == 0 and told["kept"] == [0, 0, 0]


def test_formats_without_columns_get_split_surfels_and_say_so(folder, tmp_path, capsys):
    told = combined(capsys, folder / "a.ply", folder / "b.ply", "--op", "union", "-o", tmp_path / "c.obj")
    assert any("split" in text for text in told["warnings"])
    assert len(surfel.read(tmp_path / "c.obj", as_="points")) == told["surfels"]


def test_the_table_names_the_judges(folder, tmp_path, capsys):
    files = [str(folder / "a.ply"), str(folder / "b.ply")]
    options = ["--op", "union", "-o", str(tmp_path / "c.ply"), "--cut", "none", "--judge", "nearest"]
    assert main(["combine", *files, *options]) == 0
    out = capsys.readouterr().out
    assert "judge of operand 0" in out and "nearest" in out and "conflict" in out


@pytest.mark.parametrize(
    ("arguments", "cure"),
    [
        (["a.ply", "-o", "c.ply"], "two files"),
        (["a.ply", "b.ply", "-o", "c.ply"], "--op"),
        (["a.ply", "b.ply", "--op", "xor", "-o", "c.ply"], "union, intersection, difference"),
        (["tree.csg", "--op", "union", "-o", "c.ply"], ".csg"),
        (["a.ply", "b.ply", "--op", "union", "-o", "-"], "must name a file"),
        (["a.ply", "b.ply", "--op", "union", "-o", "c.stl"], "no points"),
        (["a.ply", "b.ply", "--op", "union", "-o", "c.what"], ".what"),
        (["a.ply", "b.ply", "--op", "union", "-o", "c.ply", "--cut", "saw"], "--cut"),
        (["a.ply", "b.ply", "--op", "union", "-o", "c.ply", "--judge", "dredd"], "--judge"),
        (["a.ply", "none.ply", "--op", "union", "-o", "c.ply"], "none.ply"),
    ],
)
def test_refusals_are_one_line_and_write_nothing(folder, tmp_path, capsys, monkeypatch, arguments, cure):
    monkeypatch.chdir(tmp_path)
    given = [str(folder / a) if a.endswith((".ply", ".csg")) and a != "c.ply" else a for a in arguments]
    assert main(["combine", *given]) == 2
    error = capsys.readouterr().err
    assert error.startswith("surfel: ") and error.count("\n") == 1 and cure in error
    assert list(tmp_path.iterdir()) == []


def test_measure_takes_a_tree_of_clouds(folder, capsys):
    """What two scans differ by: a .csg with import() of both."""
    path = folder / "difference.csg"
    path.write_text('difference() { import("a.ply"); import("b.ply"); }')
    assert main(["measure", str(path), "--json", "--quiet"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["volume"]["value"] == pytest.approx(BALL - LENS, rel=0.005) and len(told["areas"]) == 2
