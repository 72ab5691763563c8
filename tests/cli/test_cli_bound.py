"""``surfel bound``: files in, surfaces out, nothing half written, and one clear line where it cannot be done."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from PIL import Image

import surfel
from surfel.cli import bound as command
from surfel.cli import main

KEYS = ["violations", "gap_mean", "gap_max", "points", "seconds", "warnings"]


def wavy(n=4000, seed=0):
    x, y = np.random.default_rng(seed).random((2, n))
    return np.column_stack([x, y, 0.2 * np.sin(6.0 * x) * np.cos(5.0 * y)])


@pytest.fixture
def cloud(tmp_path):
    """Return a file of points, and the points."""
    points = wavy()
    surfel.write(tmp_path / "wavy.ply", points)
    return str(tmp_path / "wavy.ply"), points


def told(capsys, *arguments):
    """Run with --json and return the object."""
    assert main(["bound", *map(str, arguments), "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return json.loads(out)


def test_the_keys_and_the_file(cloud, tmp_path, capsys):
    file, points = cloud
    data = told(capsys, file, "-o", tmp_path / "lid.npz", "--shape", 12, 9, "--quiet")
    assert list(data) == KEYS
    assert data["violations"] == 0 and data["points"] == len(points) and data["warnings"] == []
    lid = surfel.SafeSpline.load(tmp_path / "lid.npz")
    assert lid.shape == (12, 9) and lid.verify(points) == (0, 0.0)
    gaps = lid(points) - points[:, 2]
    np.testing.assert_allclose([data["gap_mean"], data["gap_max"]], [gaps.mean(), gaps.max()], rtol=1e-6)


@pytest.mark.parametrize("mode", command.MODES)
@pytest.mark.parametrize("boundary", command.BOUNDARIES)
def test_every_mode_from_below_along_a_direction(cloud, tmp_path, capsys, mode, boundary):
    file, points = cloud
    out = tmp_path / "lid.npz"
    options = ("--mode", mode, "--boundary", boundary, "--side", "below", "--direction", 0.2, -0.1, 1.0)
    assert told(capsys, file, "-o", out, *options, "--shape", 8, 8, "--quiet")["violations"] == 0
    lid = surfel.SafeSpline.load(out)
    assert (lid.side, lid.boundary, lid.report.mode) == ("below", boundary, mode)
    uv, heights = lid.to_domain(points)
    assert (lid(uv) <= heights).all()


def test_both_sides_are_two_files(cloud, tmp_path, capsys):
    file, points = cloud
    data = told(capsys, file, "-o", tmp_path / "lid.npz", "--side", "both", "--quiet")
    assert list(data) == [*KEYS, "above", "below"] and data["violations"] == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["lid-above.npz", "lid-below.npz", "wavy.ply"]
    above, below = (surfel.SafeSpline.load(tmp_path / f"lid-{side}.npz") for side in ("above", "below"))
    assert (above.side, below.side) == ("above", "below")
    assert above.verify(points)[0] == below.verify(points)[0] == 0
    assert data["gap_max"] == max(data["above"]["gap_max"], data["below"]["gap_max"])


def test_a_streamed_file_is_as_safe_and_as_close(cloud, tmp_path, capsys, monkeypatch):
    file, points = cloud
    whole = told(capsys, file, "-o", tmp_path / "a.npz", "--quiet")
    monkeypatch.setattr(command, "_AT_ONCE", 10)
    streamed = told(capsys, file, "-o", tmp_path / "b.npz", "--quiet")
    assert streamed["violations"] == 0 and streamed["points"] == len(points)
    assert streamed["gap_mean"] == pytest.approx(whole["gap_mean"], rel=0.5)
    assert surfel.SafeSpline.load(tmp_path / "b.npz").verify(points) == (0, 0.0)


def test_points_that_are_not_finite_are_told(tmp_path, capsys):
    points = wavy(500)
    points[7] = np.nan
    np.save(tmp_path / "a.npy", points)
    data = told(capsys, tmp_path / "a.npy", "-o", tmp_path / "lid.npz", "--quiet")
    assert data["points"] == 499 and data["violations"] == 0
    assert data["warnings"] == ["1 points had coordinates that are not finite and were left out"]


def test_the_picture_and_the_table(cloud, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    file, _ = cloud
    picture = tmp_path / "lid.png"
    assert main(["bound", file, "-o", str(tmp_path / "lid.npz"), "--side", "both", "--plot", str(picture), "-q"]) == 0
    with Image.open(picture) as image:
        image.load()
        assert image.size[0] > 1000
        colors = np.asarray(image.convert("RGB")).reshape(-1, 3).astype(int)
    assert ((colors[:, 0] - colors[:, 2]) > 60).any() and ((colors[:, 2] - colors[:, 0]) > 60).any()  # both surfaces
    out = capsys.readouterr().out
    assert "lid-above.npz" in out and "violations" in out and "gap_mean" in out


def test_a_3dm_file(cloud, tmp_path, capsys):
    pytest.importorskip("rhino3dm")
    from surfel.bounding.export import read_surface

    file, points = cloud
    assert told(capsys, file, "-o", tmp_path / "lid.3dm", "--shape", 10, 10, "--quiet")["violations"] == 0
    grid, _ = read_surface(tmp_path / "lid.3dm")
    assert grid.shape == (12, 12, 3)
    assert (grid[..., :2].min(axis=(0, 1)) <= points[:, :2].min(axis=0) + 1e-12).all()


def refused(capsys, arguments):
    """Run, and return the one line that was printed."""
    assert main(["bound", *map(str, arguments)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("surfel: ") and err.count("\n") == 1, err
    return err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["-o", "lid.stl"], ".npz or .3dm"),
        ([], "--output"),
        (["-o", "lid.npz", "--side", "left"], "above, below, both"),
        (["-o", "lid.npz", "--mode", "slow"], "paper, fast, tight"),
        (["-o", "lid.npz", "--boundary", "loose"], "open, clamped"),
        (["-o", "lid.npz", "--shape", "8"], "--shape"),
        (["-o", "lid.npz", "--direction", "0", "0", "up"], "--direction"),
    ],
)
def test_wrong_arguments_are_refused_before_anything_is_read(options, said, capsys, monkeypatch):
    def unwanted(*_args, **_kwargs):
        raise AssertionError("it was opened")

    monkeypatch.setitem(surfel.__dict__, "open", unwanted)
    assert said in refused(capsys, ["x.ply", *options])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--shape", 3, 8], "4"),
        (["--direction", 0, 0, 0], "zero"),
        (["--direction", 0, 0, "nan"], "finite"),
    ],
)
def test_what_the_fit_refuses_leaves_no_file(cloud, tmp_path, capsys, options, said):
    assert said in refused(capsys, [cloud[0], "-o", tmp_path / "lid.npz", *options])
    assert [p.name for p in tmp_path.iterdir()] == ["wavy.ply"]


def test_an_empty_cloud_and_no_file(tmp_path, capsys):
    np.save(tmp_path / "a.npy", np.empty((0, 3)))
    assert "point" in refused(capsys, [tmp_path / "a.npy", "-o", tmp_path / "lid.npz"])
    assert "no such file" in refused(capsys, [tmp_path / "b.npy", "-o", tmp_path / "lid.npz"])
    assert "folder" in refused(capsys, [_one_point(tmp_path), "-o", tmp_path / "no" / "lid.npz"])


def _one_point(folder):
    np.save(folder / "one.npy", np.ones((1, 3)))
    return folder / "one.npy"


@pytest.mark.parametrize(
    ("module", "options", "extra"), [("rhino3dm", ["-o", "a.3dm"], "cad"), ("matplotlib", ["-o", "a.npz"], "plot")]
)
def test_missing_extras_are_named_before_the_file_is_read(capsys, monkeypatch, module, options, extra):
    monkeypatch.setitem(sys.modules, module, None)
    assert f"surfel[{extra}]" in refused(capsys, ["no-such.ply", *options, "--plot", "a.png"])


def test_a_range_scan(data_file, tmp_path, capsys):
    scan = data_file("range/bun000.ply")
    data = told(capsys, scan, "-o", tmp_path / "lid.npz", "--side", "both", "--quiet")
    assert data["points"] == 40_256 and data["violations"] == 0
