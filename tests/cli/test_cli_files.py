"""info and convert on the command line: pipes, options, every file of the data folder answered or refused."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import surfel
from surfel.cli import main


def run(*arguments, **options):
    command = [sys.executable, "-m", "surfel", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, timeout=300, **options)


@pytest.fixture(scope="module")
def scan(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("files") / "scan.las"
    rng = np.random.default_rng(0)
    points = (rng.random((300, 3)) * 10).round(2)
    surfel.write(path, surfel.Surfels(points, attributes={"classification": (np.arange(300) % 3).astype(np.uint8)}))
    return path


@pytest.mark.skipif(os.name != "posix", reason="pipes of POSIX")
@pytest.mark.parametrize("to", ["ply", "pcd", "las", "npz"])
def test_through_two_pipes(scan, to):
    out = run("convert", scan, "-", "--to", to)
    assert out.returncode == 0, out.stderr
    told = run("info", "-", "--json", "--full", input=out.stdout)
    assert told.returncode == 0, told.stderr
    facts = json.loads(told.stdout)
    assert facts["points"] == 300 and facts["attributes"].count("classification") == 1
    np.testing.assert_allclose(facts["bounds"], surfel.read(scan).bounds)
    back = run("convert", "-", "-", "--to", "xyz", input=out.stdout)
    assert len(back.stdout.splitlines()) == 301  # names in a comment, and the points


@pytest.mark.skipif(os.name != "posix", reason="pipes of POSIX")
def test_a_pipe_that_ends_too_early_or_holds_nothing(scan):
    for data in (b"", scan.read_bytes()[:2000], b"no cloud at all\n"):
        done = run("info", "-", input=data)
        assert done.returncode == 2 and done.stderr.startswith(b"surfel: -: ") and done.stdout == b""


def test_parts_of_a_file(scan, tmp_path, capsys):
    whole = surfel.read(scan)
    arguments = ["convert", str(scan), str(tmp_path / "a.csv"), "--json"]
    box = ["--bounds", "0", "0", "0", "5", "5", "10"]
    assert main([*arguments, *box, "--every", "2", "--class", "0", "--class", "2"]) == 0
    report = json.loads(capsys.readouterr().out)
    part = surfel.read(scan, bounds=((0, 0, 0), (5, 5, 10)), every=2, classes=(0, 2))
    assert report["points"] == len(part) == len(surfel.read(tmp_path / "a.csv")) and 0 < len(part) < len(whole)
    for wrong in (["--every", "0"], ["--level", "1"], ["--bounds", "5", "0", "0", "0", "5", "10"], ["--class", "-2"]):
        assert main([*arguments, *wrong]) == 2
        assert "surfel: " in capsys.readouterr().err


def test_info_of_a_file_of_ten_gigabytes(tmp_path):
    """A sparse LAS: its header says all, so nothing of it is read."""
    surfel.write(tmp_path / "a.las", np.arange(30.0).reshape(10, 3))
    data = bytearray((tmp_path / "a.las").read_bytes())
    start, record = int.from_bytes(data[96:100], "little"), int.from_bytes(data[105:107], "little")
    count = 10_000_000_000 // record
    data[107:111] = min(count, 2**32 - 1).to_bytes(4, "little")
    if data[25] == 4:  # the minor version, whose header has another count
        data[107:111] = (0).to_bytes(4, "little")
        data[247:255] = count.to_bytes(8, "little")
    with open(tmp_path / "big.las", "wb") as stream:
        stream.write(data[:start])
        stream.truncate(start + count * record)
    program = (
        "import sys, resource, surfel; before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss; "
        "told = surfel.info(sys.argv[1]); "
        "print(told['points'], (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "big.las")], capture_output=True, text=True, timeout=60
    )
    points, grown = map(int, done.stdout.split())
    assert points == count and grown < 100, done.stderr  # MB, numpy and the reader's own code included


@pytest.mark.data
@pytest.mark.slow
def test_every_file_of_the_data_folder(data_file, capsys):
    """``info --full`` and ``measure`` answer, or refuse in one clear line."""
    folder = data_file("MANIFEST.tsv").parent
    files = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.suffix not in (".tsv", ".md", ".conf", ".txt")]
    assert len(files) > 50
    for path in files:
        for command in (["info", str(path), "--full", "--json"], ["measure", str(path), "--lines", "4096", "--json"]):
            code = main(command)
            said = capsys.readouterr()
            if code == 0:
                answer = json.loads(said.out)
                assert answer["points"] > 0 or "area" in answer
            else:
                lines = [line for line in said.err.splitlines() if "compiling" not in line and "warning" not in line]
                assert code == 2 and len(lines) == 1 and len(lines[0]) > 30, (path, said.err)
