"""``surfel render``: pictures from files, and one line where there is none."""

from __future__ import annotations

import json

import numpy as np
import pytest
from benchmarks.render import ball
from PIL import Image

import surfel
from surfel.cli import main


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    surfel.write("ball.ply", ball(1500))
    surfel.write("bite.ply", ball(1000, 0.6, (0.5, -0.7, 0.3)))
    return tmp_path


def test_a_file_becomes_a_picture(files, capsys):
    assert main(["render", "ball.ply", "-o", "ball.png", "--size", "80x60", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told) == {"size", "covered", "seconds"} and told["size"] == [80, 60] and 0.2 < told["covered"] < 0.9
    assert np.asarray(Image.open("ball.png")).shape == (60, 80, 3)


def test_files_are_combined_or_shown_together(files, capsys):
    shares = {}
    for name, more in {"together": [], "cut": ["--op", "difference"], "common": ["--op", "intersection"]}.items():
        view = ["--eye", "4", "0.5", "0", "--target", "0", "0", "0", "--size", "80x60"]
        assert main(["render", "ball.ply", "bite.ply", "-o", f"{name}.png", *view, "--json", *more]) == 0
        shares[name] = json.loads(capsys.readouterr().out)["covered"]
    assert shares["common"] < shares["cut"] < shares["together"]


def test_the_reference_and_parallel_lines_are_drawn(files):
    common = ["render", "ball.ply", "--size", "40x30", "--orthographic"]
    assert main([*common, "-o", "one.png"]) == main([*common, "--reference", "-o", "other.png"]) == 0
    one, other = (np.asarray(Image.open(name)).astype(float) for name in ("one.png", "other.png"))
    assert np.abs(one - other).mean() < 3


def test_any_axis_may_be_up(files):
    rod = surfel.Cylinder(0.2, 4.0)
    surfel.write("rod.csg", rod.rotated((1, 0, 0), 90))  # it stands along y
    tall = {}
    for up in "xyz":
        assert main(["render", "rod.csg", "-o", f"{up}.png", "--size", "80x80", "--up", up]) == 0
        rows, columns = np.nonzero((np.asarray(Image.open(f"{up}.png")).astype(int) < 250).any(axis=2))
        tall[up] = np.ptp(rows) > 2 * np.ptp(columns)
    assert tall == {"x": False, "y": True, "z": False}


def test_a_safe_surface_is_seen_and_an_empty_picture_is_told(files, capsys):
    surfel.bound(surfel.read("ball.ply"), shape=(6, 6)).save("lid.npz")
    assert main(["render", "ball.ply", "lid.npz", "-o", "lid.png", "--size", "80x60"]) == 0
    assert "nothing" not in capsys.readouterr().err
    assert (
        main(
            ["render", "lid.npz", "-o", "no.png", "--size", "8x6", "--eye", "9", "9", "9", "--target", "99", "99", "99"]
        )
        == 0
    )
    assert "nothing is to be seen" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["-o", "x.png", "--size", "80"], "--size"),
        (["-o", "x.png", "--size", "0x60"], "width"),
        (["-o", "x.png", "--op", "difference"], "two files"),
        (["-o", "x.png", "--op", "blend"], "--op"),
        (["-o", "x.png", "--target", "0", "0", "0"], "--eye"),
        (["-o", "x.nonsense"], "format"),
        (["-o", "x.png", "--up", "w"], "--up"),
        (["-o", "no/folder/x.png"], "no/folder"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(files, capsys, more, said):
    assert main(["render", "ball.ply", *more]) == 2
    told = capsys.readouterr().err.splitlines()
    assert said in told[-1] and not (files / "x.png").exists()
