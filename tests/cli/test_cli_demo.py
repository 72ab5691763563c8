"""The demo writes its cloud, tells the truth beside what it found, and names commands that work."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys

import pytest

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


def test_it_writes_the_cloud_and_nothing_else(shown):
    folder, _ = shown
    assert [path.relative_to(folder).as_posix() for path in sorted(folder.rglob("*"))] == [
        "surfel-demo",
        "surfel-demo/part.ply",
    ]


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
    assert data["points"] == 40_000
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


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").touch()
    done = demo(tmp_path, "file/deeper")
    assert done.returncode == 2
    assert done.stderr.startswith("surfel: ") and done.stderr.count("\n") == 1
