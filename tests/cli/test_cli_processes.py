"""The command line as a process of its own: signals, pipes, full disks, missing packages, and nothing half-written."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

posix = pytest.mark.skipif(os.name != "posix", reason="signals, pipes and limits of POSIX")


def surfel(*arguments, **options):
    command = [sys.executable, "-m", "surfel", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


def refused(done, code=2):
    """Return the one line of a refusal, and check that there is nothing else."""
    assert done.returncode == code, (done.returncode, done.stderr)
    lines = [line for line in done.stderr.splitlines() if "compiling kernels" not in line]
    assert len(lines) == 1 and lines[0].startswith("surfel: "), done.stderr
    assert done.stdout == ""
    return lines[0]


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """A sphere of radius 2, as random points with normals."""
    normals = np.random.default_rng(0).standard_normal((4000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    path = tmp_path_factory.mktemp("cloud with blanks") / "b\u00e4ll.npy"
    np.save(path, np.hstack([2.0 * normals, normals]))
    return path


def test_measure_answers_with_one_json_object(ball):
    done = surfel("measure", ball, "--json", "--quiet")
    assert done.returncode == 0 and done.stderr == ""
    data = json.loads(done.stdout)
    assert data["points"] == 4000
    assert data["area"]["value"] == pytest.approx(16 * np.pi, rel=0.01)
    assert data["volume"]["value"] == pytest.approx(32 / 3 * np.pi, rel=0.01)
    assert data["closed"] is True


def test_the_same_seed_prints_the_same_numbers(ball):
    first, again = (json.loads(surfel("measure", ball, "--json", "--seed", "5").stdout) for _ in range(2))
    for data in (first, again):
        del data["seconds"], data["compile_seconds"]
    assert first == again


def test_measure_prints_a_table(ball):
    done = surfel("measure", ball, "--units", "m")
    assert done.returncode == 0
    for word in ("area", "volume", "centroid", "closed", "spacing", "noise", "m^2", "m^3", "4,000 points"):
        assert word in done.stdout
    assert "Traceback" not in done.stderr


@posix
def test_ctrl_c_in_the_middle_of_the_work_is_130_and_one_line(ball):
    """The progress bar, which needs a terminal, tells when the work is in its middle."""
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "surfel", "measure", str(ball), "--method", "lines", "--lines", "2000000000"]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs, start_new_session=True)
    os.close(theirs)
    shown = b""
    try:
        while b"\x1b" not in shown:  # the first drawing of the bar
            shown += os.read(ours, 4096)
        time.sleep(0.3)
        assert child.poll() is None, "the work ended before it could be interrupted"
        child.send_signal(signal.SIGINT)
        while True:
            try:
                piece = os.read(ours, 4096)
            except OSError:  # the terminal is closed on the other side
                break
            if not piece:
                break
            shown += piece
        assert child.wait(timeout=60) == 130
    finally:
        child.kill()
        os.close(ours)
    assert child.stdout.read() == b""
    assert shown.rstrip().endswith(b"surfel: interrupted")
    assert b"Traceback" not in shown


def printing_to(stream, *arguments):
    """Run with this standard output, and return the exit code and what the standard error got."""
    command = [sys.executable, "-m", "surfel", *map(str, arguments)]
    done = subprocess.run(command, stdout=stream, stderr=subprocess.PIPE, text=True, timeout=300)
    return done.returncode, done.stderr


@posix
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_an_output_on_a_full_disk_is_told(ball):
    with open("/dev/full", "w") as full:
        code, said = printing_to(full, "info", ball, "--json")
    assert code == 2
    assert said.startswith("surfel: ") and said.count("\n") == 1


@posix
@pytest.mark.parametrize("arguments", [["info", "--json"], ["info"], ["--help"], ["--version"]])
def test_a_reader_that_has_gone_is_no_news(ball, arguments):
    read, write = os.pipe()
    os.close(read)
    with open(write, "w") as pipe:
        code, said = printing_to(pipe, *arguments, *([ball] if "info" in arguments else []))
    assert (code, said) == (141, "")


def limited_to(size):
    """Return what makes files of a child process end at ``size`` bytes, as on a full disk."""
    import resource

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return limit


@posix
def test_a_full_disk_leaves_the_old_file_and_nothing_else(ball, tmp_path):
    target = tmp_path / "out.ply"
    target.write_bytes(b"old")
    line = refused(surfel("convert", ball, target, preexec_fn=limited_to(2000)))
    assert "out.ply" in line
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


@posix
def test_a_picture_on_a_full_disk(ball, tmp_path):
    pytest.importorskip("matplotlib")
    target = tmp_path / "out.png"
    command = ("measure", ball, "--plot", target, "--lines", "1024")
    surfel(*command)  # kernels and fonts are cached now, and not under the limit
    assert target.stat().st_size > 2000
    target.unlink()
    line = refused(surfel(*command, preexec_fn=limited_to(2000)))
    assert "out.png" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("place", ["a folder", "under a file", "in no folder"])
def test_unwritable_targets(ball, tmp_path, place):
    (tmp_path / "file").write_bytes(b"x")
    (tmp_path / "folder.ply").mkdir()
    target = {
        "a folder": tmp_path / "folder.ply",
        "under a file": tmp_path / "file" / "out.ply",
        "in no folder": tmp_path / "nowhere" / "out.ply",
    }[place]
    before = sorted(tmp_path.rglob("*"))
    assert target.name in refused(surfel("convert", ball, target))
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("command", [["measure", "{}"], ["info", "{}"], ["convert", "{}", "out.ply"]])
@pytest.mark.parametrize("kind", ["missing", "a folder", "empty", "of no known format"])
def test_unreadable_files(tmp_path, command, kind):
    source = tmp_path / "source.ply"
    if kind == "a folder":
        source.mkdir()
    elif kind == "empty":
        source.touch()
    elif kind == "of no known format":
        source.write_bytes(b"\x00\x01\x02\x03" * 30)
    line = refused(surfel(*[word.format(source) for word in command], cwd=tmp_path))
    assert "source.ply" in line
    assert not (tmp_path / "out.ply").exists()


def test_a_missing_extra_is_told_in_one_line(ball, tmp_path):
    """A finder that knows no matplotlib stands before all others."""
    (tmp_path / "without.py").write_text(
        "import sys\n"
        "class Without:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.split('.')[0] == 'matplotlib':\n"
        "            raise ModuleNotFoundError(f'No module named {name!r}', name=name)\n"
        "sys.meta_path.insert(0, Without())\n"
        "from surfel.cli import main\n"
        "sys.exit(main())\n"
    )
    command = [sys.executable, str(tmp_path / "without.py"), "measure", str(ball), "--plot", str(tmp_path / "a.png")]
    line = refused(subprocess.run(command, capture_output=True, text=True))
    assert line == "surfel: this needs matplotlib, which is not installed: pip install 'surfel[plot]'"
    assert not (tmp_path / "a.png").exists()


def test_unknown_options_and_commands():
    assert "--colour" in refused(surfel("measure", "x.ply", "--colour"))
    assert "polish" in refused(surfel("polish"))


def test_sample_and_back(tmp_path):
    """A tetrahedron with legs of length 1: three right triangles and one equilateral."""
    (tmp_path / "t.off").write_text("OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n")
    area = 1.5 + np.sqrt(3) / 2
    for options, points in ((("-n", 500), 500), (("-n", 500, "--kind", "blue"), 500), (("--radius", 0.05), None)):
        done = surfel("sample", tmp_path / "t.off", *options, "-o", tmp_path / "t.ply", "--json")
        assert done.returncode == 0, done.stderr
        report = json.loads(done.stdout)
        assert set(report) == {"points", "area", "seconds"}
        assert report["area"] == pytest.approx(area)
        assert report["points"] == points if points else report["points"] > area / (np.pi * 0.05**2)
        held = json.loads(surfel("info", tmp_path / "t.ply", "--json").stdout)
        assert held["points"] == report["points"] and held["normals"]
    assert "mesh" in refused(surfel("sample", tmp_path / "t.ply", "-n", 3, "-o", tmp_path / "u.ply"))
