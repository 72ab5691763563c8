"""The demo writes its cloud, tells the truth beside what it found, and names commands that work."""

from __future__ import annotations

import base64
import io
import json
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from surfel.cli.part import BoredBlock


def demo(folder, *options):
    command = [sys.executable, "-m", "surfel", "demo", *options]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    return folder, demo(folder)


def test_it_prints_values_errors_and_truth(shown):
    _, done = shown
    assert done.returncode == 0, done.stderr
    part = BoredBlock()
    for name, truth in (("area", part.area), ("volume", part.volume)):
        row = re.search(rf"^{name}\s+([\d.]+) \+- ([\d.]+)\s+([\d.]+)\s+([+-][\d.]+)%\s+(yes|no)", done.stdout, re.M)
        assert row is not None, done.stdout
        value, error, told, off = map(float, row.groups()[:4])
        assert told == pytest.approx(truth, rel=1e-5)
        assert value == pytest.approx(truth, rel=0.005)
        assert error < 0.01 * truth
        assert off == pytest.approx(100 * (value - truth) / truth, abs=0.06)


def test_it_writes_the_cloud_the_report_and_nothing_else(shown):
    folder, done = shown
    assert [path.relative_to(folder).as_posix() for path in sorted(folder.rglob("*"))] == [
        "surfel-demo",
        "surfel-demo/part.ply",
        "surfel-demo/part.png",
        "surfel-demo/report.html",
    ]
    assert done.stdout.rstrip().endswith("surfel-demo/report.html")


def test_the_report_needs_nothing_but_itself_and_is_right(shown):
    folder, _ = shown
    page = (folder / "surfel-demo" / "report.html").read_text(encoding="utf-8")
    assert len(page) < 500_000
    assert re.findall(r'(?:src|href)="(?!data:)', page) == [] and "http" not in page
    pictures = [base64.b64decode(data) for data in re.findall(r'src="data:image/png;base64,([^"]+)"', page)]
    assert len(pictures) == 3
    for data in pictures:
        picture = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)
        assert 0.2 < (np.abs(picture - 255).max(axis=2) > 8).mean() < 0.9  # neither empty nor all over
    first = (folder / "surfel-demo" / "part.png").read_bytes()
    assert first == pictures[0] != pictures[1]
    offs = [float(off) for off in re.findall(r"<td>([+-][\d.]+)%</td></tr>", page)]
    assert len(offs) == 4 and max(map(abs, offs)) < 0.5
    assert "0 of 40,000 points are above it" in page


def test_without_a_report(tmp_path):
    done = demo(tmp_path, "here", "--no-report", "--json")
    assert done.returncode == 0, done.stderr
    assert [path.name for path in (tmp_path / "here").iterdir()] == ["part.ply"]
    assert json.loads(done.stdout)["report"] is None


def test_what_it_proposes_works(shown):
    folder, done = shown
    proposed = re.findall(r"^  (\S.*)$", done.stdout.split("Try next:")[1], re.M)
    assert len(proposed) == 3
    for command in proposed:
        tried = subprocess.run(shlex.split(command), cwd=folder, capture_output=True, text=True, timeout=300)
        assert tried.returncode == 0, (command, tried.stderr)
        assert tried.stdout


def test_it_runs_again_and_answers_programs(shown, tmp_path):
    folder, _ = shown
    done = demo(folder, "--json", "--quiet")
    assert done.returncode == 0 and done.stderr == ""
    data = json.loads(done.stdout)
    assert data["points"] == 40_000 and data["report"] == "surfel-demo/report.html"
    assert data["truth"] == {"area": BoredBlock().area, "volume": BoredBlock().volume}
    assert data["area"]["value"] == pytest.approx(data["truth"]["area"], rel=0.005)


def test_a_foreign_file_is_left_alone(tmp_path):
    target = tmp_path / "surfel-demo" / "part.ply"
    target.parent.mkdir()
    target.write_text("somebody's own")
    done = demo(tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and "part.ply exists" in done.stderr
    assert target.read_text() == "somebody's own"
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize("name", ["report.html", "part.png"])
def test_a_foreign_report_is_left_alone(tmp_path, name):
    target = tmp_path / "surfel-demo" / name
    target.parent.mkdir()
    target.write_text("somebody's own")
    done = demo(tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and f"{name} exists" in done.stderr
    assert target.read_text() == "somebody's own"
    assert list(target.parent.iterdir()) == [target]


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").touch()
    done = demo(tmp_path, "file/deeper")
    assert done.returncode == 2
    assert done.stderr.startswith("surfel: ") and done.stderr.count("\n") == 1
